"""Calibration by the report's method."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from publicdata import needs_data
from scipy import stats
from worked_example import ARM, EIGHT, FLAT, experiment, torque_arm

from hdbench.calibration import consistency_interval, evaluate_calibration
from hdbench.errors import DataError
from hdbench.records import Loads


def loads_of(gains: list[float], *, noise_v: float = 0.0, seed: int = 0) -> Loads:
    """Return loads whose experiments have exactly these gains, and reading noise."""
    rng = np.random.default_rng(seed)
    readings = []
    for i, gain in enumerate(gains):
        place, way = (i // 2) * math.pi / 2.0, ("cw", "ccw")[i % 2]
        readings += experiment(str(i), gain, position=place, way=way, noise=rng, noise_v=noise_v)
    return Loads(tuple(readings))


@needs_data
@pytest.mark.parametrize(
    ("series", "key"),
    [
        (("ascending", "descending"), "all"),
        *(((series,), series) for series in ("ascending", "descending")),
    ],
)
def test_torque_arm_gives_its_published_regression(series, key):
    file = ARM / "torque_arm_calibration.json"
    published = json.loads(file.read_text())[f"linear regression {key}"]
    result = evaluate_calibration(torque_arm(*series), max_consistency=0.05)
    # the same regression in double precision; 1e-9 is rounding with margin
    assert result.gain_nm_per_v.value == pytest.approx(published["slope"], rel=1e-9)
    assert result.gain_nm_per_v.std == pytest.approx(published["std_err"], rel=1e-9)
    line = result.experiments[0]
    assert line.intercept_nm == pytest.approx(published["intercept"], rel=1e-8)


def test_mean_gain_has_the_uncertainty_of_a_mean_over_positions():
    gain = evaluate_calibration(loads_of(FLAT), max_consistency=0.05).gain_nm_per_v
    means = np.mean(EIGHT, axis=1)
    # values without noise: rounding of the lines
    assert gain.value == pytest.approx(6.6, rel=1e-12)
    assert gain.std == pytest.approx(stats.sem(means), rel=1e-9)
    assert gain.dof == 3.0
    # published analysis of these eight gains: half width 0.22456 with 3 dof
    low, high = gain.interval()
    assert (high - low) / 2.0 == pytest.approx(0.22456, abs=5e-6)


def test_consistency_is_the_sample_coefficient_of_variation():
    result = evaluate_calibration(loads_of(FLAT), max_consistency=0.05)
    # scipy is another implementation of std (ddof 1) over mean
    assert result.consistency == pytest.approx(stats.variation(FLAT, ddof=1), rel=1e-9)
    assert result.accepted is True
    assert evaluate_calibration(loads_of(FLAT), max_consistency=0.02).accepted is False
    # gains that share positions know their spread less well
    assert result.consistency_interval_positions[1] is not None
    assert result.consistency_interval[1] is not None
    assert result.consistency_interval_positions[1] > 1.5 * result.consistency_interval[1]


def test_two_percent_from_eight_is_known_from_1_3_to_4_1_percent():
    of_s = [0.02 * math.sqrt(7.0 / stats.chi2.ppf(p, 7)) for p in (0.975, 0.025)]
    # the interval of a coefficient of variation differs from that of s by terms of C^2 = 4e-4
    assert consistency_interval(0.02, 7) == pytest.approx(of_s, rel=2e-3)


def test_a_single_position_says_what_its_uncertainty_leaves_out():
    result = evaluate_calibration(loads_of([6.6], noise_v=0.01), max_consistency=0.05)
    assert result.gain_basis == "residual"
    assert "leaves out the spread between positions" in result.gain_basis_reason
    assert result.consistency is None
    assert result.accepted is None


def test_unbalanced_positions_are_marked():
    result = evaluate_calibration(loads_of(FLAT[:7]), max_consistency=0.05)
    assert result.gain_basis == "positions-unbalanced"
    assert [note.name for note in result.notes] == ["gain-positions-unbalanced"]
    # readings without noise: rounding of seven lines
    assert result.gain_nm_per_v.value == pytest.approx(np.mean(FLAT[:7]), rel=1e-9)


def test_a_reading_off_the_line_is_marked_and_kept():
    readings = list(loads_of([6.6], noise_v=0.001).readings)
    readings[3] = replace(readings[3], reading_v=readings[3].reading_v + 0.1)
    result = evaluate_calibration(Loads(tuple(readings)), max_consistency=0.05)
    assert result.experiments[0].doubtful == (3,)
    assert result.experiments[0].n == len(readings)


def test_clean_experiments_seldom_show_a_doubtful_reading():
    marked = 0
    for seed in range(150):
        loads = loads_of([6.6], noise_v=0.01, seed=seed)
        marked += bool(evaluate_calibration(loads, max_consistency=0.05).experiments[0].doubtful)
    # at most one in twenty by the stated level (Bonferroni: slightly fewer); false alarm 1e-3
    assert marked <= stats.binom.ppf(0.999, 150, 0.05)


def test_steps_hold_the_hysteresis_of_each_load():
    lifted = (
        replace(r, reading_v=r.reading_v + (0.03 if r.series == "down" else 0.0))
        for r in loads_of([5.0]).readings
    )
    result = evaluate_calibration(Loads(tuple(lifted)), max_consistency=0.05)
    line = result.experiments[0]
    steps = [step for step in result.experiment_steps if step.experiment == line.id]
    assert [step.torque_nm for step in steps] == [0.0, 10.0, 20.0, 30.0, 40.0]
    # 30 mV at every load; rounding of means
    np.testing.assert_allclose([step.hysteresis_v for step in steps], 0.03, rtol=1e-12)
    assert line.hysteresis_nm == pytest.approx(0.03 * line.gain_nm_per_v, rel=1e-9)


def test_steps_and_class_are_those_of_the_readings():
    body = evaluate_calibration(loads_of(FLAT, noise_v=0.01), max_consistency=0.05).to_json()
    assert isinstance(body["experiments"][0]["gain_nm_per_v"], float)
    # four loads in two directions; five with the zero in each of eight experiments
    assert len(body["steps"]) == 8
    assert len(body["experiment_steps"]) == 40
    # every gain differs by about 2 % between positions: outside b of class 2
    assert body["class"] == 5.0


ONE = loads_of([6.6]).readings


@pytest.mark.parametrize(
    ("readings", "text"),
    [
        ((), "0 readings"),
        (ONE[:2], "at least 3 readings"),
        ((*ONE, replace(ONE[0], position_rad=1.0)), "2 values of position_rad"),
        (tuple(replace(ONE[0], torque_nm=t) for t in range(3)), "no line fits experiment 0"),
    ],
)
def test_loads_without_a_line_are_refused(readings, text):
    with pytest.raises(DataError, match=text) as caught:
        evaluate_calibration(Loads(readings), max_consistency=0.05)
    assert caught.value.fix
