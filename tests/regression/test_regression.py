import json
import shutil
from pathlib import Path
from xml.etree import ElementTree

import pytest

from hdbench.errors import DataError
from hdbench.profile import load_profile
from hdbench.records.tracefile import read_trace, write_trace
from hdbench.regression import Tolerance, compare_folder, compare_results

STORED = Path(__file__).parents[1] / "stored"


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    return shutil.copytree(STORED, tmp_path / "stored", ignore=shutil.ignore_patterns("*.py"))


def _edit(file: Path, path: tuple[str | int, ...], value: object) -> None:
    body = json.loads(file.read_text())
    place = body
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    file.write_text(json.dumps(body))


def test_the_stored_traces_give_the_stored_results():
    report = compare_folder(STORED)
    moved = [change.describe() for case in report.cases for change in case.changes]
    assert report.passed, moved
    kinds = {case.kind for case in report.cases}
    assert kinds == {"calibration", "misalignment", "ripple", "filter"}
    assert all(case.compared > 20 for case in report.cases)


def test_the_stored_results_are_the_truth_of_their_generator():
    def result(name):
        return json.loads((STORED / name / "expected.json").read_text())["result"]

    def near(quantity, truth):
        # five standard uncertainties: one seed out of a million is outside
        assert abs(quantity["value"] - truth) < 5.0 * quantity["std"]

    near(result("misalignment")["amplitude_nm"], 0.9)
    near(result("misalignment")["phase_rad"], 0.3)
    for line, truth in zip(result("ripple")["ripple"], ((0.4, 0.6), (0.2, -1.1)), strict=True):
        near(line["amplitude_nm"], truth[0])
        near(line["phase_rad"], truth[1])
    near(result("calibration")["gain_nm_per_v"], 6.6)


def test_the_stored_traces_are_small():
    size = sum(file.stat().st_size for file in STORED.rglob("*") if file.is_file())
    assert size < 2_000_000


def test_a_changed_inertia_is_caught_by_name(stored):
    profile = load_profile("cim-tr-97-06")
    text = profile.text.replace("load_inertia_kg_m2 = 1.725e-2", "load_inertia_kg_m2 = 1.9e-2")
    assert text != profile.text
    (stored / "filter" / "bench.toml").write_text(text)
    _edit(stored / "filter" / "case.json", ("profile",), "bench.toml")
    report = compare_folder(stored / "filter")
    assert not report.passed
    keys = {change.key for case in report.cases for change in case.changes if change.regression}
    assert "torque_filtered_rms_nm" in keys
    assert any(key.startswith("samples_nm") for key in keys)


def test_a_changed_gain_moves_the_amplitude_by_the_same_share(stored):
    gain = {"value": 6.6 * 1.01, "std": 0.0}
    _edit(stored / "misalignment" / "case.json", ("gain_nm_per_v",), gain)
    (case,) = compare_folder(stored / "misalignment").cases
    change = next(c for c in case.changes if c.key == "amplitude_nm.value")
    assert change.regression
    # the fit is linear in the torque up to the noise model, found by iteration
    assert change.found / change.expected == pytest.approx(1.01, rel=0, abs=1e-5)


@pytest.mark.parametrize("name", ["filter", "misalignment", "ripple"])
def test_torque_in_newton_metres_goes_before_volts_in_every_kind(stored, name):
    file = stored / name / json.loads((stored / name / "case.json").read_text())["input"]
    trace = read_trace(file)
    volts = trace["torque_v"]
    # the profile's 6.6 N m/V; the volts beside it no longer belong to it
    write_trace(file, trace.with_columns(torque_nm=6.6 * volts, torque_v=0.5 * volts))
    (case,) = compare_folder(stored / name).cases
    moved = [c.key for c in case.changes if c.regression]
    # the torque is in N m already: its gain is 1 and of no declared uncertainty, so the amplitudes'
    # std and dof lose the profile's share; no value may move
    values = [key for key in moved if not key.endswith((".std", ".dof"))]
    assert values in ([], ["torque_scale.gain_nm_per_v.value"])


def test_what_moved_is_told_in_units_of_its_tolerance(stored):
    file = stored / "calibration" / "expected.json"
    gain = json.loads(file.read_text())["result"]["gain_nm_per_v"]
    moved = gain["value"] + 0.1 * gain["std"]
    _edit(file, ("result", "gain_nm_per_v", "value"), moved)
    (case,) = compare_folder(stored / "calibration").cases
    (change,) = [c for c in case.changes if c.regression]
    assert change.key == "gain_nm_per_v.value"
    # a tenth of a sigma at a tolerance of a fiftieth of one
    assert change.in_tolerances == pytest.approx(5.0, rel=1e-6)


def test_a_missing_key_is_a_regression_and_a_new_one_is_not():
    changes, compared = compare_results({"a": 1.0, "gone": 2.0}, {"a": 1.0, "new": 3.0})
    assert compared == 1
    assert [(c.key, c.what, c.regression) for c in changes] == [
        ("gone", "missing", True),
        ("new", "new", False),
    ]


@pytest.mark.parametrize(
    ("expected", "found", "regressions"),
    [
        *((1.0, 1.0 + 1e-10, []), (0.0, 1e-13, [])),
        *((1.0, found, [True]) for found in (1.0 + 1e-6, None, float("nan"))),
        *((None, 1.0, [True]), (True, 1, [True]), ("named", "nothing-found", [True])),
    ],
)
def test_values_compare_as_they_should(expected, found, regressions):
    changes, _ = compare_results({"x": expected}, {"x": found})
    assert [c.regression for c in changes] == regressions


def test_words_and_hashes_are_told_but_are_no_regression():
    changes, _ = compare_results(
        {"sha256": "a", "gain_basis_reason": "old"}, {"sha256": "b", "gain_basis_reason": "new"}
    )
    assert [c.regression for c in changes] == [False, False]


def test_a_phase_may_wrap():
    before, after = (
        {"phase_rad": {"value": sign * 3.14159265, "std": 0.1}} for sign in (1.0, -1.0)
    )
    assert compare_results(before, after)[0] == ()


def test_a_tolerance_of_the_case_stands_before_the_defaults():
    own = (Tolerance("ripple[order=2.0].*", "test", rel=0.5),)
    before = {"ripple": [{"order": 2.0, "x": 1.0}, {"order": 4.0, "x": 1.0}]}
    after = {"ripple": [{"order": 2.0, "x": 1.4}, {"order": 4.0, "x": 1.4}]}
    changes, _ = compare_results(before, after, own)
    assert [c.key for c in changes] == ["ripple[order=4.0].x"]


def test_a_measured_order_that_moves_is_moved_and_not_missing():
    before = {"peaks": [{"order": 1.9593173486873736}, {"order": 2.0429017776150658}]}
    after = {"peaks": [{"order": 1.9593173486873736}, {"order": 2.0429017776}]}
    changes, _ = compare_results(before, after, (Tolerance("*", "test", rel=1e-13),))
    assert [(c.key, c.what) for c in changes] == [("peaks[1].order", "moved")]


def test_update_keeps_the_new_results_and_the_next_run_passes(stored):
    _edit(stored / "ripple" / "expected.json", ("result", "residual_rms_nm"), 9.0)
    assert not compare_folder(stored / "ripple").passed
    (case,) = compare_folder(stored / "ripple", update=True).cases
    assert [c.key for c in case.changes if c.regression] == ["residual_rms_nm"]
    assert compare_folder(stored / "ripple").passed


@pytest.mark.parametrize(
    ("name", "path", "value"),
    [
        ("case.json", ("kind",), "calibrate"),
        ("case.json", ("typo",), 1),
        ("case.json", ("input",), "nothing.csv"),
        ("case.json", ("profile",), "no-such-bench"),
        ("case.json", ("filter",), "report-7"),
        ("case.json", ("options",), {"from": 1.0}),
        ("case.json", ("gain_nm_per_v",), {"value": 6.6}),
        ("case.json", ("tolerances",), {"*": {"abs": -1.0, "reason": "x"}}),
        ("case.json", ("tolerances",), {"*": {"abs": 1.0}}),
        ("expected.json", ("result",), None),
        ("expected.json", ("schema",), "other"),
    ],
)
def test_a_broken_case_names_the_file_and_exits_4(name, path, value, stored):
    _edit(stored / "ripple" / name, path, value)
    (found,) = compare_folder(stored / "ripple").errors
    assert found.exit_code == 4
    assert found.where
    assert found.fix


def test_a_folder_without_cases_and_a_case_without_results_are_named(stored, tmp_path):
    with pytest.raises(DataError, match=r"case\.json"):
        compare_folder(tmp_path / "nothing")
    (stored / "ripple" / "expected.json").unlink()
    (lacking,) = compare_folder(stored / "ripple").errors
    assert "expected.json" in lacking.what


def test_the_command_passes_and_prints_one_json_object(stored, answer):
    body = answer("regress", stored / "calibration")
    assert body["schema"] == "hdbench/regression/1"
    assert body["passed"]


def test_the_command_exits_3_on_a_regression_and_writes_its_page(stored, tmp_path, hdbench, answer):
    _edit(stored / "calibration" / "expected.json", ("result", "consistency"), 0.5)
    page = tmp_path / "regress.html"
    text, said = hdbench("regress", stored / "calibration", "--report", page, code=3)
    assert "calibration: 1 quantities" in said
    assert "consistency: 0.5 ->" in text
    assert str(page) in text
    assert "consistency" in page.read_text()
    assert not answer("regress", stored / "calibration", code=3)["passed"]


@pytest.fixture
def junit(stored, tmp_path, hdbench):
    """Return a function that compares all stored cases, for the suite of the JUnit file."""

    def run(code):
        hdbench("regress", stored, "--junit", tmp_path / "regress.xml", code=code)
        return ElementTree.parse(tmp_path / "regress.xml").getroot().find("testsuite")

    return run


def test_junit_counts_a_failure_where_a_quantity_moved_and_names_it(stored, junit):
    _edit(stored / "ripple" / "expected.json", ("result", "ripple", 0, "order"), 3.0)
    suite = junit(3)
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("4", "1", "0")
    failed = [case for case in suite if case.find("failure") is not None]
    assert [case.get("name") for case in failed] == ["ripple"]
    assert "order" in failed[0].findtext("failure")


def test_an_invalid_case_is_an_error_and_the_others_are_still_compared(stored, junit):
    # a terminal escape in the name of a key has no place in XML
    (stored / "filter" / "case.json").write_text('{"schema": "hdbench/\x1b[31mcase"}')
    suite = junit(4)
    assert (suite.get("failures"), suite.get("errors")) == ("0", "1")
    compared = [case for case in suite if case.find("error") is None]
    assert len(compared) == 3
