"""Tables: what no name of the catalogue covers is told by its axes, and by no name."""

import numpy as np
import pytest
from swinging_shaft import NOISE_NM, record, reversing

from hdbench.diagnosis import diagnose_trace
from hdbench.diagnosis.discovery.tables import Axis
from hdbench.profile import load_profile

PROFILE = load_profile("cim-tr-97-06")


@pytest.mark.parametrize("period", [0.0, 2.0 * np.pi])
def test_a_table_holds_functions_over_fewer_knots(period):
    knots = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False) if period else np.arange(13.0) ** 1.5
    values = np.linspace(knots[0], knots[-1], 500)
    axis = Axis("velocity", "rad/s", values, knots, period)
    for level in axis.levels(len(knots)):
        # a function over every n-th knot is 1 at its own knot and straight between its neighbours
        coarse = axis.hats(len(knots)) @ level
        tops = values[np.argmax(coarse, axis=0)]
        assert np.allclose(coarse.sum(axis=1), 1.0)
        own = np.append(tops, knots[0] + period) if period else tops
        straight = np.interp(values, own, np.append(1.0, np.zeros(len(own) - 1)))
        inside = values < own[-1]
        if not period:
            assert np.allclose(coarse[inside, 0], straight[inside], atol=0.02)


def test_a_function_of_the_speed_that_is_no_law_has_no_name():
    bend = reversing(lambda _a, w, _x: 0.004 * np.sqrt(np.abs(np.abs(w) - 35.0)), n=12_000)
    found = diagnose_trace(bend, PROFILE)
    assert found.causes == ()
    assert [place.domain for place in found.unexplained] == ["velocity"]


def test_a_line_that_follows_the_load_is_told_with_it():
    wave = reversing(lambda a, _w, x: 0.03 * (1.0 + 0.06 * x) * np.cos(3.3 * a + 0.7), n=12_000)
    found = diagnose_trace(wave, PROFILE)
    (place,) = found.unexplained
    assert (place.domain, place.second_domain) == ("motor-order", "load")
    assert place.location == pytest.approx(3.3, abs=0.1)


def test_slow_bursts_below_the_scatter_of_the_samples_are_seen():
    def pulses(time, _angle, _speed):
        starts = np.array([1.3, 2.9, 3.1, 5.2, 7.7, 8.8])
        inside = time[:, None] - starts[None, :]
        shape = np.sin(np.pi * inside / 0.03) * ((inside >= 0.0) & (inside < 0.03))
        return 2.1 * NOISE_NM * shape.sum(axis=1)

    found = diagnose_trace(record(pulses), PROFILE, materiality=0.001)
    assert found.causes == ()
    assert {place.domain for place in found.unexplained} == {"time"}
