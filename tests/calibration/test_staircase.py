"""Plateaus of raw readings: found without being told, glitches and stuck samples left out."""

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from publicdata import DATA, needs_data

from hdbench.calibration import evaluate_calibration
from hdbench.calibration.staircase.importing import StaircasePlan, import_staircase
from hdbench.calibration.staircase.plateaus import find_glitches, find_plateaus, find_stuck
from hdbench.errors import DataError, UsageError
from hdbench.importing.recipe import Recipe
from hdbench.profile import load_profile
from hdbench.records.loads import read_loads

LB = (0.0, 10.0, 20.0, 30.0, 40.0, 30.0, 20.0, 10.0, 0.0)
BENCH = load_profile("cim-tr-97-06").data
CELL = DATA / "swing_loadcell_cal" / "LoadCellCalibrationData.txt"
# samples of the two loaded cells that are near -8.38e6 counts, rows from 0
GLITCHES = {11: [73, 440, 731, 1052], 12: [8, 94, 338, 1041]}


def cell_plan(column: int, loads: tuple[float, ...] = LB, **more: object) -> StaircasePlan:
    maps = {"time_s": "1*0.001", "reading_v": str(column)}
    recipe = Recipe("loads", maps, delimiter="comma", no_header=True)
    return StaircasePlan(recipe, loads, "lb", **more)


@needs_data
# the last: readings that lost a glitch; two of column 12 stand in one plateau
@pytest.mark.parametrize(("column", "counts_per_lb", "hit"), [(11, 997.0, 4), (12, 1004.0, 3)])
def test_a_load_cell_under_dead_weights_has_nine_plateaus_and_its_sensitivity(
    tmp_path, column, counts_per_lb, hit
):
    out = tmp_path / "loads.csv"
    report = import_staircase(cell_plan(column), CELL, out, BENCH.arm)
    body = json.loads(json.dumps(report.to_dict(), allow_nan=False))
    assert len(body["plateaus"]) == 9
    assert body["reading_per_load"] == pytest.approx(counts_per_lb, abs=0.5)
    # the four glitches, found where the raw file has them
    raw = np.loadtxt(CELL, delimiter=",")
    times = (raw[:, 0] - raw[0, 0]) / 1000.0
    np.testing.assert_allclose(body["glitches_at_s"], times[GLITCHES[column]], atol=1e-9)
    # no average holds one: -8e6 counts in some hundred samples would move it by 60000
    assert all(5000.0 < p["mean"] < 60000.0 and p["std"] < 200.0 for p in body["plateaus"])
    found = evaluate_calibration(read_loads(out, BENCH.arm), max_consistency=0.05, bench=BENCH)
    result = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert result["course"]["n_excluded_samples"] == 4
    assert len(result["course"]["excluded_at_s"]) == 4
    assert "marked-glitches" in [note["name"] for note in result["notes"]]
    assert sum(r["flags"] == ["glitches"] for r in result["readings"]) == hit
    # sensitivity in counts per pound force on the arm
    pound = 0.45359237 * BENCH.arm.gravity_m_s2 * BENCH.arm.length_m
    assert pound / result["gain_nm_per_v"]["value"] == pytest.approx(counts_per_lb, abs=0.5)
    assert len(result["steps"]) == 4
    assert result["steps"][0]["reversibility_v"] is not None


def staircase(levels, noise, seed, hold=80):
    """Return samples at 10 Hz: levels joined by ramps of fifteen samples."""
    parts = [np.full(hold, levels[0])]
    for before, after in itertools.pairwise(levels):
        parts += [np.linspace(before, after, 15), np.full(hold, after)]
    x = np.concatenate(parts)
    return x + noise * np.random.default_rng(seed).normal(size=len(x)), levels


@settings(max_examples=30, deadline=None)
@given(
    n=st.integers(1, 12),
    scale=st.sampled_from([1e-4, 1.0, 1e5]),
    offset=st.sampled_from([0.0, -3.0, 200.0]),
    seed=st.integers(0, 10_000),
)
def test_any_staircase_is_found_with_its_levels(n, scale, offset, seed):
    rng = np.random.default_rng(seed)
    levels = [offset + float(k) for k in np.cumsum(rng.choice([-1.0, 1.0, 2.0], size=n))]
    x, truth = staircase(levels, 0.02, rng)
    found = find_plateaus(np.arange(len(x)) / 10.0, scale * x)
    assert len(found.plateaus) == n
    # six standard deviations of a mean of fifty samples of noise 0.02
    np.testing.assert_allclose(
        [p.mean / scale for p in found.plateaus], truth, rtol=0.0, atol=6 * 0.02 / 50**0.5
    )


def test_glitches_anywhere_are_left_out_of_every_average():
    rng = np.random.default_rng(1)
    x, levels = staircase([0.0, 1.0, 2.0, 1.0, 0.0], 0.01, rng)
    bad = rng.choice(np.arange(5, len(x) - 5), size=12, replace=False)
    spoilt = x.copy()
    spoilt[bad] += rng.choice([-50.0, 30.0], size=12)
    found = find_plateaus(np.arange(len(x)) / 10.0, spoilt)
    np.testing.assert_allclose(np.array(found.glitches_at_s) * 10.0, np.sort(bad), atol=1e-9)
    np.testing.assert_allclose([p.mean for p in found.plateaus], levels, atol=0.01)


def test_pairs_and_ends_of_a_record_may_be_glitches_and_steps_are_none():
    x, _ = staircase([0.0, 5.0, 0.0], 0.01, 2, hold=60)
    assert not find_glitches(x).any()
    x[0] = x[40] = x[41] = 100.0
    assert list(np.flatnonzero(find_glitches(x))) == [0, 40, 41]


def test_a_converter_that_stood_still_is_found_and_left_out():
    rng = np.random.default_rng(3)
    x, _ = staircase([0.0, 1.0, 0.0], 0.01, rng, hold=150)
    x[200:260] = x[200]
    stuck = find_stuck(x)
    assert (stuck.sum(), stuck[200], stuck[259]) == (59, False, True)
    found = find_plateaus(np.arange(len(x)) / 10.0, x)
    assert len(found.stuck_at_s) == 59
    assert len(found.plateaus) == 3
    # a display that usually repeats is not stuck
    assert not find_stuck(np.repeat(rng.normal(size=10), 50)).any()


def test_a_zero_that_does_not_flicker_is_kept_and_marked():
    x, levels = staircase([0.0, 1.0, 2.0, 1.0], 0.01, 7, hold=100)
    x[:100] = 0.0
    found = find_plateaus(np.arange(len(x)) / 10.0, x)
    np.testing.assert_allclose([p.mean for p in found.plateaus], levels, atol=0.01)
    assert len(found.plateaus[0].stuck_at_s) > 60


def test_missing_samples_are_no_glitches_and_no_readings():
    x, levels = staircase([0.0, 1.0, 0.0], 0.01, 4)
    x[::7] = np.nan
    found = find_plateaus(np.arange(len(x)) / 10.0, x)
    assert found.glitches_at_s == ()
    np.testing.assert_allclose([p.mean for p in found.plateaus], levels, atol=0.01)


@pytest.mark.parametrize(
    ("x", "n"), [([], 0), ([1.0] * 5, 0), ([np.nan] * 100, 0), ([3.0] * 100, 1)]
)
def test_short_empty_and_constant_records_are_taken(x, n):
    found = find_plateaus(np.arange(len(x)) / 10.0, np.array(x))
    assert len(found.plateaus) == n


def test_an_impossible_shortest_plateau_is_refused():
    with pytest.raises(ValueError, match="least"):
        find_plateaus(np.arange(3.0), np.arange(3.0), float("nan"))


def written(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "raw.csv"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("constants", "maps", "error", "text"),
    [
        ({"series": "up"}, ("t", "v"), UsageError, "no meaning for a staircase"),
        ({"direction": "left"}, ("t", "v"), UsageError, "direction is 'left'"),
        ({"position_rad": "nan"}, ("t", "v"), UsageError, "position_rad"),
        ({}, (None, "v"), UsageError, "no time"),
        ({}, ("t", None), UsageError, "no readings"),
        ({}, ("v", "v"), DataError, "time does not rise"),
        ({}, ("t", "v"), DataError, "found 0 plateaus for 9 loads"),
    ],
)
def test_a_staircase_that_cannot_be_brought_in_says_why(tmp_path, constants, maps, error, text):
    file = written(tmp_path, "t,v\n" + "".join(f"{k},{k % 3}\n" for k in range(9)))
    names = zip(("time_s", "reading_v"), maps, strict=True)
    columns = {name: source for name, source in names if source}
    plan = StaircasePlan(Recipe("loads", columns, constants), LB)
    with pytest.raises(error, match=text) as caught:
        import_staircase(plan, file, tmp_path / "out.csv", BENCH.arm)
    assert caught.value.fix
    assert not (tmp_path / "out.csv").exists()


def test_the_input_is_never_overwritten(tmp_path):
    file = written(tmp_path, "t,v\n0,1\n1,2\n")
    plan = StaircasePlan(Recipe("loads", {"time_s": "t", "reading_v": "v"}), LB)
    with pytest.raises(UsageError, match="is the input"):
        import_staircase(plan, file, file, BENCH.arm)
