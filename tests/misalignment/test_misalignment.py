"""Misalignment torque of constant-velocity runs."""

import math
from typing import Any

import numpy as np
import pytest
from known_traces import (
    Truth,
    bench,
    both_ways_velocity,
    covers,
    drawn_runs,
    known_trace,
    reversing_velocity,
    scale,
)
from scipy.stats import binom

from hdbench.errors import DataError
from hdbench.filter import preset
from hdbench.misalignment import evaluate_misalignment
from hdbench.records import Trace
from hdbench.results import MisalignmentResult

BENCH = bench()
FILTER = preset("report-6", BENCH)
# one output turn in 2.1 s keeps the tests short
FAST = 300.0


def evaluate(trace: Trace) -> MisalignmentResult:
    return evaluate_misalignment(trace, BENCH, scale=scale(), filter_model=FILTER)


def fast_trace(seed: int, turns: float = 2.0, **more: Any) -> Trace:
    """Return a trace of fast turns forth and back."""
    return known_trace(np.random.default_rng(seed), both_ways_velocity(turns, FAST), **more)


@pytest.fixture(scope="module")
def both_ways() -> dict[float, MisalignmentResult]:
    """Return results of two turns each way, in white noise and in coloured noise."""
    velocity = both_ways_velocity()
    return {
        colour: evaluate(known_trace(np.random.default_rng(1), velocity, colour=colour))
        for colour in (0.0, 0.9)
    }


@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_amplitude_and_phase_are_found_in_both_directions(colour, both_ways):
    found = both_ways[colour]
    # 99.9 % intervals: false alarm 0.2 %
    assert covers(found.amplitude_nm, 0.9)
    assert covers(found.phase_rad, 0.3)
    assert found.peak_to_peak_nm.value == 2.0 * found.amplitude_nm.value
    assert [math.copysign(1.0, s.motor_velocity_rad_s) for s in found.stretches] == [1.0, -1.0]
    # two turns each way, the settling time left out
    assert found.output_turns == pytest.approx(4.0, abs=0.1)
    assert found.motor_velocity_rad_s == pytest.approx(60.0, rel=1e-3)


def test_std_is_that_of_a_sinusoid_in_white_noise(both_ways):
    found = both_ways[0.0]
    # sigma sqrt(2 / n): 0.05 N m of noise and 0.7 mN m of the converter's steps; whole turns, so
    # that offsets and sinusoid are orthogonal to 1 %; std from 42 000 samples
    expected = 0.05 * math.sqrt(2.0 / found.n_samples)
    assert found.amplitude_nm.std == pytest.approx(expected, rel=0.03)


def test_a_zero_per_direction_does_not_reach_the_amplitude():
    velocity = both_ways_velocity(speed_rad_s=FAST)
    found = evaluate(fast_trace(3, extra_nm=0.7 * np.tanh(velocity / 3.0) + 0.2))
    assert covers(found.amplitude_nm, 0.9)
    forth, back = (part.offset_nm for part in found.stretches)
    assert covers(forth, 0.9)
    assert covers(back, -0.5)


def test_output_order_2_and_a_tone_are_told_apart_from_it():
    velocity = both_ways_velocity(speed_rad_s=FAST)
    angle = np.concatenate([[0.0], np.cumsum(velocity[:-1] * 0.001)])
    time = np.arange(len(velocity)) * 0.001
    extra = 0.15 * np.cos(2.0 * angle / 100.0 + 1.0) + 0.08 * np.cos(2.0 * np.pi * 50.0 * time)
    found = evaluate(fast_trace(4, extra_nm=extra))
    assert covers(found.amplitude_nm, 0.9)
    assert covers(found.output_order_2.amplitude_nm, 0.15)
    assert [round(line.frequency_hz, 1) for line in found.tones] == [50.0]


@pytest.mark.parametrize("n_runs", [12, pytest.param(24, marks=pytest.mark.campaign)])
def test_intervals_cover_the_truth_with_a_gain_of_three_dof(n_runs):
    velocity, hits = both_ways_velocity(speed_rad_s=FAST), np.zeros(2)
    for true_gain, gain, trace in drawn_runs(velocity, n_runs):
        found = evaluate_misalignment(trace, BENCH, scale=gain, filter_model=FILTER)
        truth = (found.amplitude_nm, 0.9 * true_gain / 6.6), (found.phase_rad, 0.3)
        hits += [covers(number, x, 0.95) for number, x in truth]
    # two counts, each at least binomial(n_runs, 0.95); false alarm 2 x 5e-4 = 1e-3
    assert np.all(hits >= binom.ppf(5e-4, n_runs, 0.95)), hits


def test_the_filter_takes_the_component_out(both_ways):
    found = both_ways[0.0]
    assert found.before.peak_to_peak_nm == found.peak_to_peak_nm
    # report-6 holds the output order; it is left with its transient and the noise that it follows
    assert found.after.peak_to_peak_nm.value < 0.05 * found.before.peak_to_peak_nm.value


def test_a_filter_without_the_output_order_leaves_it():
    model = preset("report-a1", BENCH)
    found = evaluate_misalignment(fast_trace(6), BENCH, scale=scale(), filter_model=model)
    # the transfer function of report-a1 to a slow torque at 300 rad/s is between 0.5 and 1.1
    assert found.after.peak_to_peak_nm.value > 0.4 * found.before.peak_to_peak_nm.value


def test_no_misalignment_is_called_small():
    found = evaluate(fast_trace(7, truth=Truth(misalignment=(0.0, 0.0))))
    assert found.small_amplitude
    assert covers(found.amplitude_nm, 0.0)
    assert [note.name for note in found.notes] == ["small-amplitude"]


def test_between_one_and_two_turns_is_marked():
    found = evaluate(fast_trace(8, 1.4))
    assert [note.name for note in found.notes] == ["few-output-turns"]
    assert covers(found.amplitude_nm, 0.9)


def test_less_than_one_turn_is_refused_with_what_is_needed():
    with pytest.raises(DataError, match="needed: at least 1 output turn"):
        evaluate(fast_trace(9, 0.6))


def test_a_motor_at_rest_is_refused():
    trace = known_trace(np.random.default_rng(10), reversing_velocity(3.0) * 0.0)
    with pytest.raises(DataError, match="steady"):
        evaluate(trace)


def test_a_trace_without_torque_is_refused_by_its_columns():
    bare = Trace({k: c for k, c in fast_trace(11).columns.items() if k != "torque_v"}, "bare")
    with pytest.raises(DataError, match="no torque channel") as caught:
        evaluate(bare)
    assert caught.value.where == "bare"


def test_the_filter_gets_the_block_of_the_output_order(both_ways):
    block = both_ways[0.0].filter
    assert (block.order, block.process_noise) == (0.01, 0.05)
