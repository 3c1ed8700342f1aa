"""Evidence of a name: shapes integrated, harmonics chosen, what a spring or an encoder can do."""

import numpy as np
import pytest

from hdbench.diagnosis import diagnose_trace
from hdbench.diagnosis.fit.families import refine_term
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.measured.record import prepare_record
from hdbench.diagnosis.naming.evidence import evidence
from hdbench.diagnosis.naming.nameless import line_terms
from hdbench.diagnosis.noise.whitened import Whitener, make_space
from hdbench.model import BenchModel, catalogue
from hdbench.profile import load_profile
from hdbench.records import Trace

PROFILE = load_profile("cim-tr-97-06")
NOISE_NM = 0.05
# half of n_eff = e^4 for each amplitude, as docs/diagnosis.md says
AMPLITUDE_NATS = 2.0


def trace_of(extra, n=16_000, noise_nm=NOISE_NM, counts=None, speed_of=None):
    """Shaft that swings (or turns evenly) under a load of both signs."""
    rng = np.random.default_rng(3)
    time = np.arange(n) * 1e-3
    swing = 2.0 * np.pi / 4.0
    speed = 60.0 * np.sin(swing * time) if speed_of is None else np.full(n, speed_of)
    angle = 60.0 / swing * (1.0 - np.cos(swing * time)) if speed_of is None else speed_of * time
    accel = 60.0 * swing * np.cos(swing * time) if speed_of is None else np.zeros(n)
    load = 20.0 * np.sin(2.0 * np.pi * time / 9.7) if speed_of is None else np.zeros(n)
    torque = 0.4 * np.cos(2 * angle) + 0.2 * np.cos(4 * angle) + 1.725e-4 * accel + load
    torque = torque + extra(angle, speed, load) + noise_nm * rng.standard_normal(n)
    read = angle if counts is None else np.floor(angle * counts / (2 * np.pi)) / counts * 2 * np.pi
    columns = {
        "time_s": time,
        "motor_velocity_rad_s": speed,
        "motor_angle_rad": read,
        "torque_nm": torque,
    }
    if speed_of is None:
        columns["load_torque_nm"] = load
    return Trace(columns)


def record_and_space(trace):
    # at the ends of a record the acceleration has no window about it
    masked = np.ones(len(trace.time_s), dtype=bool)
    masked[50:-50] = False
    record = prepare_record(trace, PROFILE.data, BenchModel.from_profile(PROFILE.data), masked)
    white = Whitener(np.ones(1), NOISE_NM, record.valid, record.valid)
    return record, make_space(white, record.base, record.response_nm)


def base_of(record):
    return np.linalg.svd(record.base[record.valid], full_matrices=False)[0]


def gains(record, base, columns):
    """Half the fall of the whitened sum of squares by plain least squares."""
    seen = record.valid
    left = columns[seen] - base @ (base.T @ columns[seen])
    target = record.response_nm[seen] - base @ (base.T @ record.response_nm[seen])
    solution = np.linalg.lstsq(left, target, rcond=None)[0]
    return 0.5 * float(target @ left @ solution) / NOISE_NM**2


def test_a_shape_is_integrated_over_its_domain():
    record, space = record_and_space(trace_of(lambda a, w, load: 0.02 * np.tanh(w / 3.0)))
    cause = catalogue()["coulomb-friction"]
    found = refine_term(space, record, Term(cause, {"transition_rad_s": 2.0}))
    # even in the logarithm from 0.05 to 20 rad/s, by a sum over 400 of them
    places = np.geomspace(0.05, 20.0, 400)
    base = base_of(record)
    speed = record.motion.velocity_rad_s
    nats = np.array([gains(record, base, np.tanh(speed / q)[:, None]) for q in places])
    exact = np.logaddexp.reduce(nats) - np.log(len(nats)) - AMPLITUDE_NATS
    assert evidence(space, record, found, 1.0) == pytest.approx(exact, abs=0.5)


def test_a_term_that_will_not_come_near_what_is_wanted_is_given_up():
    record, space = record_and_space(trace_of(lambda a, w, load: 0.02 * np.tanh(w / 3.0)))
    term = Term(catalogue()["coulomb-friction"], {"transition_rad_s": 6.0})
    best = refine_term(space, record, term)
    assert best.within
    assert refine_term(space, record, term, best.statistic - 1.0) == best
    assert not refine_term(space, record, term, 2.0 * best.statistic).within


@pytest.mark.parametrize("order", [2.13, 4.9])
def test_a_line_over_the_output_is_refined_to_its_order(order):
    def extra(angle, _speed, _load):
        return 0.02 * np.cos(order * angle / 100.0 + 0.4)

    record, space = record_and_space(trace_of(extra, speed_of=120.0))
    # three output turns: half a resolution cell away
    cell = 1.0 / (np.ptp(record.motion.output_angle_rad) / (2.0 * np.pi))
    near = order + 0.4 * cell
    (line,) = (
        term
        for term in line_terms("output-order", near, (), record.motion, cell)
        if "order" in term.shape
    )
    found = refine_term(space, record, line)
    # the bound of a line's place in so many turns, sqrt(6) / (pi d) cells
    bound = np.sqrt(6.0) / (np.pi * np.sqrt(found.statistic)) * cell
    assert found.term.shape["order"] == pytest.approx(order, abs=4.0 * bound)


def test_a_harmonic_that_is_not_there_costs_no_more_than_the_choice():
    inertia = 1.725e-4

    def error(angle, speed, load):
        return -inertia * 3e-2 * speed**2 * np.cos(2.0 * angle)

    record, space = record_and_space(trace_of(error))
    cause = catalogue()["kinematic-error"]
    found = refine_term(space, record, Term(cause, {}))
    columns = cause.columns(record.motion, {})
    # of seven subsets of three harmonics the one of order 2 alone
    alone = gains(record, base_of(record), columns[:, 2:4]) - 2.0 * AMPLITUDE_NATS - np.log(7.0)
    told = evidence(space, record, found, 1.0)
    assert told > 0.5 * found.statistic - 6.0 * AMPLITUDE_NATS
    # noise of the other subsets adds to the mean of all
    assert alone - 0.2 < told < alone + 2.0


def test_a_curve_that_no_spring_has_is_no_spring():
    found = diagnose_trace(trace_of(lambda a, w, load: 3e-6 * load**3), PROFILE)
    (cause,) = found.causes
    assert cause.name == "cubic-nonlinearity"
    assert "cubic-stiffness" not in (*cause.group, *cause.rivals)
    assert cause.probability is not None
    assert 0.5 < cause.probability <= 1.0


def test_counting_steps_of_the_encoder_are_no_part_of_the_residual():
    record, space = record_and_space(
        trace_of(lambda a, w, load: 0.0, noise_nm=0.0, counts=4000, speed_of=41.84)
    )
    steps = (
        record.response_nm
        - record.columns @ (np.linalg.lstsq(record.columns, record.response_nm, rcond=None)[0])
    )
    left = NOISE_NM * space.residual
    # a step of 1.6 mrad is 0.5 mrad rms; the ripple's slope makes 0.5 mN m of it
    assert np.std(steps[record.valid]) > 2e-4
    assert np.std(left[record.valid]) < 0.25 * np.std(steps[record.valid])


def line_at(order):
    def extra(angle, _speed, _load):
        return 0.02 * np.cos(order * angle + 0.7)

    return diagnose_trace(trace_of(extra), PROFILE, materiality=0.0)


def test_a_single_line_at_an_order_that_is_not_whole_may_be_a_bearings():
    (cause,) = line_at(3.37).causes
    names = {cause.name, *cause.group, *cause.rivals}
    assert {"bearing-defect", "ripple-harmonic"} <= names
    assert cause.parameters["order"]["value"] == pytest.approx(3.37, abs=0.005)


def test_a_single_line_at_a_whole_order_is_a_ripple():
    (cause,) = line_at(6.0).causes
    assert (cause.name, cause.rivals) == ("ripple-harmonic", ())
