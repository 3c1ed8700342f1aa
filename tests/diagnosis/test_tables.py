"""Tables: what no name of the catalogue covers is told by its axes, and by no name."""

import numpy as np
import pytest
from discovery_records import fitted, swinging
from swinging_shaft import NOISE_NM, record, reversing, trace_of

from hdbench.diagnosis import diagnose_trace
from hdbench.diagnosis.discovery import lines
from hdbench.diagnosis.discovery.lines import modulated_looks, plan_scans
from hdbench.diagnosis.discovery.tables import Axis
from hdbench.profile import load_profile

PROFILE = load_profile("cim-tr-97-06")


@pytest.mark.parametrize("period", [0.0, 2.0 * np.pi])
def test_a_table_holds_functions_over_fewer_knots(period):
    knots = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False) if period else np.arange(13.0) ** 1.5
    values = np.linspace(knots[0], knots[-1], 500)
    axis = Axis("velocity", "rad/s", values, knots, period)
    table = axis.hats(len(knots))
    # splines hold straight lines, and a wave of 24 knots to 5/384 of their distance to the fourth
    if period:
        assert np.allclose(table @ np.cos(knots), np.cos(values), atol=7e-5)
    else:
        assert np.allclose(table @ knots, values)
    for level in axis.levels(len(knots)):
        coarse = table @ level
        assert np.allclose(coarse.sum(axis=1), 1.0)
        # each is one at its own knot, and zero where another one is
        owners = np.flatnonzero(np.isclose(level.max(axis=1), 1.0) & (level > 0.99).any(axis=1))
        assert len(owners) == level.shape[1]
        assert np.allclose(level[owners], np.eye(level.shape[1]), atol=1e-12)


@pytest.mark.campaign
def test_a_function_of_the_speed_that_is_no_law_has_no_name():
    bend = reversing(lambda _a, w, _x: 0.004 * np.sqrt(np.abs(np.abs(w) - 35.0)), n=12_000)
    found = diagnose_trace(bend, PROFILE)
    assert found.causes == ()
    assert [place.domain for place in found.unexplained] == ["velocity"]


def test_a_line_that_is_explained_already_is_no_table(monkeypatch):
    fit = fitted(swinging(3000))
    assert modulated_looks(fit, fit.beside(), plan_scans(fit.record))
    monkeypatch.setattr(lines, "_line_beside", lambda *_: (0.0, 0))
    assert modulated_looks(fit, fit.beside(), plan_scans(fit.record)) == []


@pytest.mark.campaign
def test_a_line_that_follows_the_load_is_told_with_it():
    wave = reversing(lambda a, _w, x: 0.03 * (1.0 + 0.06 * x) * np.cos(3.3 * a + 0.7), n=12_000)
    found = diagnose_trace(wave, PROFILE)
    (place,) = found.unexplained
    assert (place.domain, place.second_domain) == ("motor-order", "load")
    assert place.location == pytest.approx(3.3, abs=0.1)


@pytest.mark.parametrize(
    ("torque", "domain", "second", "place"),
    [
        # an amplitude that swings in time is no ripple, though a line holds two thirds of it
        (lambda t, _, a: (1 + 1.5 * np.cos(0.4 * t)) * np.cos(9.7 * a), "motor-order", "time", 9.7),
        pytest.param(
            lambda _, w, a: (w / 60 - 5) * np.cos(0.057 * a),
            "output-order",
            "velocity",
            5.7,
            marks=pytest.mark.campaign,
        ),
    ],
)
def test_a_line_whose_size_follows_another_axis_is_told_with_both(torque, domain, second, place):
    def wave(time, angle, speed):
        return 0.5 * NOISE_NM * torque(time, speed, angle)

    found = diagnose_trace(record(wave, motion=(300.0, 120.0, 7.0), n=16_000), PROFILE)
    assert found.causes == ()
    (told,) = found.unexplained
    assert (told.domain, told.second_domain) == (domain, second)
    # a quarter of the width of a line over 764 turns of the motor, or 7.64 of the output
    turns = 764.0 if domain == "motor-order" else 7.64
    assert told.location == pytest.approx(place, abs=0.25 / turns)


def test_a_ripple_that_is_another_in_each_direction_is_told():
    # the form error of the ripple takes it in, whose wave it has
    trace = reversing(lambda a, w, _x: 0.02 * np.sign(w) * np.cos(2.0 * a + 0.9), n=12_000)
    found = diagnose_trace(trace, PROFILE)
    assert found.causes == ()
    (place,) = found.unexplained
    assert {place.domain, place.second_domain} == {"motor-order", "velocity"}
    assert place.location == 2.0


def test_slow_bursts_below_the_scatter_of_the_samples_are_seen():
    def pulses(time, _angle, _speed):
        starts = np.array([1.3, 2.9, 3.1, 5.2, 7.7, 8.8])
        inside = time[:, None] - starts[None, :]
        shape = np.sin(np.pi * inside / 0.03) * ((inside >= 0.0) & (inside < 0.03))
        return 2.1 * NOISE_NM * shape.sum(axis=1)

    found = diagnose_trace(record(pulses), PROFILE, materiality=0.001)
    assert found.causes == ()
    assert {place.domain for place in found.unexplained} == {"time"}


def test_a_law_of_three_waves_is_told_over_the_speed_and_not_as_slow_noise():
    # two periods of 6 s: slow noise could stand for most of it, a table of straight lines could not
    rng, time = np.random.default_rng(5), np.arange(12_000) * 1e-3
    rate = 2.0 * np.pi / 6.0
    speed, angle = 120.0 * np.sin(rate * time), 120.0 / rate * (1.0 - np.cos(rate * time))
    torque = 1.725e-4 * 120.0 * rate * np.cos(rate * time) + 0.05 * rng.standard_normal(12_000)
    torque += 0.4 * np.cos(2.0 * angle) + 0.2 * np.cos(4.0 * angle - 1.5)
    torque += np.sin(3.0 * np.pi * speed / 120.0)
    trace = trace_of(time, np.round(speed, 2), np.floor(angle / 1e-4) * 1e-4, torque)
    (place,) = diagnose_trace(trace, PROFILE).unexplained
    assert place.domain == "velocity"
