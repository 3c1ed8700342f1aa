"""The whole slice over the wire: three experiments on the embedded bench, and what they keep."""

import numpy as np
import pytest
from fakes import check_filtered, quiet

from hdbench.profile import Profile, parse_profile
from hdbench.records import Quantity
from hdbench.records.jsonfile import read_json
from hdbench.records.recovery import verify_run
from hdbench.records.tracefile import read_trace
from hdbench.session import BenchOptions, RunOutcome, evaluate_stored, run_experiment


@pytest.fixture(scope="module")
def bench(changed_profile) -> Profile:
    """Return the report's bench with shorter runs: fewer positions and masses, faster motion."""
    masses = {"ranges": ["full"], "full_masses_kg": [0.0, 4.0, 8.0]}
    masses |= {"positions": 2, "average_s": 0.25}
    reference = {"ripple.reference": {"frequency_hz": 0.125}}
    text = changed_profile(
        calibration=masses,
        misalignment={"velocity_rad_s": 350.0},
        ripple={"duration_s": 8.0},
        **reference,
    )
    return parse_profile(text, "test bench")


@pytest.fixture(scope="module")
def runs(bench: Profile, tmp_path_factory: pytest.TempPathFactory) -> dict[str, RunOutcome]:
    out = tmp_path_factory.mktemp("runs")
    done: dict[str, RunOutcome] = {}
    for kind in ("calibration", "misalignment", "ripple"):
        calibration = done["calibration"].folder.path if done else None
        misalignment = done["misalignment"].folder.path if kind == "ripple" else None
        options = BenchOptions(out=out, seed=5, calibration=calibration, misalignment=misalignment)
        done[kind] = run_experiment(kind, bench, options, quiet)
    return done


@pytest.mark.parametrize("kind", ["calibration", "misalignment", "ripple"])
def test_a_complete_run_verifies_and_loses_nothing(runs, kind):
    report = verify_run(runs[kind].folder.path)
    assert report.ok, report.problems
    assert report.status == "complete"
    assert runs[kind].doubts == ()
    if kind != "calibration":
        trace = read_trace(runs[kind].folder.trace)
        assert report.samples_in_journal == len(trace)
        assert np.all(np.isfinite(trace["torque_v"]))


@pytest.mark.parametrize("kind", ["misalignment", "ripple"])
def test_a_run_with_motion_is_scaled_and_filtered_as_its_manifest_says(runs, kind):
    gain = runs["calibration"].result.to_json()["gain_nm_per_v"]["value"]
    manifest, trace = runs[kind].folder.manifest, read_trace(runs[kind].folder.trace)
    assert manifest["calibration"]["gain_nm_per_v"]["value"] == gain
    assert runs["calibration"].folder.run_id in manifest["calibration"]["source"]
    assert len(manifest["calibration"]["sha256"]) == 64
    np.testing.assert_array_equal(trace["torque_nm"], trace["torque_v"] * gain)
    check_filtered(trace, manifest["filter"])
    if kind == "ripple":
        told = " ".join(manifest["filter"]["provenance"].values())
        assert runs["misalignment"].folder.run_id in told


def sizes(result):
    """Return the numbers that a result of any kind is about."""
    body = result.to_json()
    if "ripple" in body:
        return [line["amplitude_nm"] for line in body["ripple"]]
    return body.get("gain_nm_per_v") or body["amplitude_nm"]


@pytest.mark.parametrize("kind", ["calibration", "misalignment", "ripple"])
def test_evaluating_the_stored_run_again_gives_the_same_numbers(runs, bench, tmp_path, kind):
    folder, found = evaluate_stored(kind, runs[kind].folder.path, bench, out=tmp_path)
    assert sizes(found) == sizes(runs[kind].result)
    assert read_json(folder.result, None)["run"] == folder.run_id
    ran = runs[kind].folder.manifest["filter"]
    assert read_json(folder.path / "run.json", None)["filter"] == ran


def test_a_stored_trace_takes_the_named_misalignment_into_its_filter(runs, bench, tmp_path):
    misalignment = runs["misalignment"].folder
    folder, _ = evaluate_stored(
        "ripple",
        runs["ripple"].folder.trace,
        bench,
        out=tmp_path,
        misalignment=misalignment.path,
        filter_name="report-a1",
    )
    model = read_json(folder.path / "run.json", None)["filter"]
    assert misalignment.run_id in model["provenance"]["misalignment block"]
    assert 0.01 in [block["order"] for block in model["blocks"]]


def test_the_simulated_truth_is_within_the_stated_uncertainty(runs, bench):
    truth = bench.data.model
    told = {kind: run.result.to_json() for kind, run in runs.items()}
    lines = told["ripple"]["ripple"]
    for found, true in (
        (told["calibration"]["gain_nm_per_v"], bench.data.sensor.gain_nm_per_v),
        (told["misalignment"]["amplitude_nm"], truth.misalignment.amplitude_nm),
        (lines[0]["amplitude_nm"], truth.ripple[0].amplitude_nm),
        (lines[1]["amplitude_nm"], truth.ripple[1].amplitude_nm),
    ):
        # one of four is outside with 0.4 %; how often in 200 seeds: make coverage-campaign
        low, high = Quantity(found["value"], found["std"], found["dof"]).interval(0.999)
        assert low <= true <= high
