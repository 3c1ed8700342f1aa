"""Readings that are not as a plan has them: other repetitions, signs, steps, rows written twice."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from worked_example import calibration, experiment

from hdbench.calibration import evaluate_calibration
from hdbench.calibration.gains import plain_mean
from hdbench.errors import DataError
from hdbench.profile import load_profile
from hdbench.records import Loads
from hdbench.records.loads import read_loads
from hdbench.report.calibration.section import tables, verdict

ARM = load_profile("cim-tr-97-06").data.arm


def found(readings, **columns):
    loads = Loads(tuple(readings), extra_columns=columns)
    return evaluate_calibration(loads, max_consistency=0.05)


@pytest.mark.parametrize(
    ("places", "between", "within"),
    [
        pytest.param((0, 0, 1, 2), 0.02, 0.004, marks=pytest.mark.campaign),
        pytest.param((0, 0, 1, 2), 0.0, 0.01, marks=pytest.mark.campaign),
        ((0, 1, 1, 2, 2, 2, 3), 0.006, 0.006),
    ],
)
def test_the_interval_covers_where_positions_have_other_repetitions(places, between, within):
    rng = np.random.default_rng(12)
    numbers = [place for place in places for _ in range(2)]
    ways = [("cw",), ("ccw",)] * len(places)
    half = np.array([0.0035, -0.0035] * len(places))
    n_runs, hits = 250, 0
    for _ in range(n_runs):
        effect = between * rng.normal(size=4)[numbers]
        gains = 6.6 * (1.0 + effect + half + within * rng.normal(size=len(numbers)))
        mean = plain_mean(gains.tolist(), numbers, ways)
        k = stats.t.ppf(0.975, mean.dof)
        hits += bool(abs(mean.value - 6.6) <= k * mean.std)
    # 95 % by Satterthwaite's approximation, 94.4 to 96.5 in 2000 runs; false alarm 1e-3
    assert stats.binom.ppf(5e-4, n_runs, 0.944) <= hits <= stats.binom.ppf(0.9995, n_runs, 0.965)


def test_repeated_experiments_at_one_position_give_its_uncertainty_by_their_scatter():
    gains = [6.58, 6.60, 6.64]
    result = found([r for k, gain in enumerate(gains) for r in experiment(str(k), gain)])
    assert result.gain_basis == "repetitions"
    # rounding of three lines without noise
    expected = np.std(gains, ddof=1) / math.sqrt(3.0)
    assert result.gain_nm_per_v.std == pytest.approx(expected, rel=1e-9)
    assert result.gain_nm_per_v.dof == 2.0


def test_positions_read_a_milliradian_apart_are_one_position():
    exact = found(calibration())
    off_rad = {"cw": 1e-3, "ccw": 0.0}
    moved = [replace(r, position_rad=r.position_rad + off_rad[r.direction]) for r in calibration()]
    assert found(moved).gain_nm_per_v == exact.gain_nm_per_v
    jitter = [replace(r, position_rad=r.position_rad + 1e-4 * (k % 3)) for k, r in enumerate(moved)]
    assert found(jitter).gain_nm_per_v.dof == exact.gain_nm_per_v.dof


def test_a_gain_of_the_other_sign_makes_the_data_doubtful_and_is_kept():
    turned = [
        replace(r, reading_v=-r.reading_v) if r.experiment == "2-ccw" else r for r in calibration()
    ]
    result = found(turned)
    assert [flag.name for flag in result.flags] == ["gain-sign"]
    assert "experiment 2-ccw is negative" in result.flags[0].detail
    assert len(result.experiments) == 8
    assert result.accepted is False


def test_gains_that_cancel_in_pairs_have_no_relative_difference_of_direction():
    rows = [
        r
        for place in range(3)
        for way, gain in (("cw", 6.6), ("ccw", -6.6))
        for r in experiment(f"{place}-{way}", gain, position=float(place), way=way)
    ]
    rows += experiment("3-cw", 6.6, position=3.0)
    result = found(rows)
    assert result.direction is None
    assert result.flags


def test_a_bridge_wired_the_other_way_has_its_sign_in_both_equations():
    body = found(calibration(gains=(-6.5, -6.6, -6.7)))
    (equations,) = [t for t in tables(body) if t.title == "Equation both ways"]
    assert all(row[1].split()[2][0] == row[2].split()[2][0] == "\u2212" for row in equations.rows)


def test_rows_that_are_written_twice_are_noted():
    rows = calibration(noise=np.random.default_rng(3))
    (note,) = [n for n in found([*rows, rows[3]]).notes if n.name == "repeated-rows"]
    assert note.samples == 1
    assert f"reading {len(rows) + 1} is" in note.detail


def test_readings_without_any_scatter_show_no_outlier():
    assert found(calibration(gains=(6.6, 6.6, 6.6, 6.6))).to_json()["outliers"] == []


def test_a_wide_loop_that_scales_with_the_gain_is_no_reason_to_flag_a_reading():
    flagged = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        gains = 6.6 * (1.0 + 0.02 * rng.normal(size=4))
        told = found(calibration(gains, noise=rng, loop=2.0)).outliers
        flagged += any(outlier.kind == "reading" for outlier in told)
    # two groups of 5 % each; false alarm 1e-3
    assert flagged <= stats.binom.ppf(0.999, 40, 0.0975)


def test_a_step_that_one_position_alone_has_is_without_reproducibility_there():
    rows = calibration(gains=(6.5, 6.6, 6.7))
    rows += experiment("3-cw", 6.55, position=4.5, steps=(0.0, 10.0, 20.0, 25.0, 30.0, 40.0))
    steps = [s for s in found(rows).to_json()["steps"] if s["direction"] == "cw"]
    known = {s["torque_nm"]: s["reproducibility_v"] for s in steps}
    assert known.pop(25.0) is None
    for torque, spread in known.items():
        # four positions; rounding
        expected = np.std([torque / g for g in (6.5, 6.6, 6.7, 6.55)], ddof=1)
        assert spread == pytest.approx(expected, rel=1e-9)
    # three degrees of freedom of b, which is all there is at a middle step but the zero
    assert steps[0]["increasing"]["dof"] == pytest.approx(3.0, rel=1e-3)


def test_a_series_of_another_mounting_is_no_repetition():
    rows = [r for name, gain in (("a", 6.6), ("b", 6.7)) for r in experiment(name, gain)]
    names = tuple("0" if r.experiment == "a" else "1" for r in rows)
    assert all(step.repeatability_v is not None for step in found(rows).steps)
    assert all(step.repeatability_v is None for step in found(rows, mounting=names).steps)


def test_a_row_with_a_mass_and_no_torque_is_a_mass(tmp_path):
    path = tmp_path / "loads.csv"
    path.write_text(
        "experiment,position_rad,range,direction,series,torque_nm,mass_kg,reading_v\n"
        "a,0,full,ccw,up,,2,-1.5\n"
        "a,0,full,ccw,up,-5,,-0.7\n"
    )
    first, second = read_loads(path, ARM).readings
    # one product of doubles
    assert first.torque_nm == pytest.approx(-2.0 * ARM.gravity_m_s2 * ARM.length_m, rel=1e-15)
    assert second.torque_nm == -5.0
    path.write_text(
        "experiment,position_rad,range,direction,series,mass_kg,reading_v\na,0,full,cw,up,,1\n"
    )
    with pytest.raises(DataError, match="mass_kg"):
        read_loads(path, ARM)


def test_a_torque_beyond_any_machine_is_refused_with_its_experiment():
    rows = [replace(r, torque_nm=1e200 * r.torque_nm) for r in experiment("a", 6.6)]
    with pytest.raises(DataError, match="experiment a holds"):
        found(rows)


def test_a_record_that_is_not_accepted_names_the_limit():
    body = found(calibration(gains=(6.0, 6.6, 7.2)))
    assert verdict(body).text.endswith("; not held: consistency.")
