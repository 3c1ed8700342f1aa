"""A diagnosis keeps the contract: keys, verdicts, flags, extended model."""

import json

import numpy as np
import pytest
from swinging_shaft import record

from hdbench.diagnosis import DiagnosisOptions, diagnose_loads, diagnose_run, diagnose_trace
from hdbench.diagnosis.discovery.baseline import parse_baseline
from hdbench.errors import DataError, UsageError
from hdbench.model import load_model, simulate_like
from hdbench.profile import load_profile
from hdbench.records import LoadReading, Loads, Trace, read_json, write_trace

PROFILE = load_profile("cim-tr-97-06")


def flags(result):
    return {flag.name: flag.samples for flag in result.data_flags}


def line(_time, angle, _speed):
    return 0.1 * np.cos(3.37 * angle + 0.4)


@pytest.fixture(scope="module")
def found():
    return diagnose_trace(record(line), PROFILE)


def test_gain_is_what_the_hidden_amplitude_makes_of_the_noise(found):
    (cause,) = found.causes
    # A^2 / 2 of variance on top of 0.05^2
    before = np.sqrt(0.05**2 + 0.1**2 / 2.0)
    # scatter of an rms of 10 000 samples is 0.7 %
    assert cause.gain.heldout_rms_before_nm == pytest.approx(before, rel=0.03)
    assert cause.gain.heldout_rms_after_nm == pytest.approx(0.05, rel=0.03)
    low, high = cause.gain.interval
    assert low < cause.gain.explained_fraction < high


def test_minimum_detectable_amplitude_is_indeed_found():
    clean = diagnose_trace(record(n=6000, seed=1), PROFILE)
    limit = {one.name: one.amplitude_nm for one in clean.minimum_detectable}["ripple-harmonic"]
    for seed in range(2):
        trace = record(lambda t, a, w: 1.4 * limit * np.cos(7.3 * a), n=6000, seed=seed)
        result = diagnose_trace(trace, PROFILE, materiality=0.0, seed=seed)
        orders = [c.parameters["order"].value for c in result.causes if "order" in c.parameters]
        # 40 % above the 90 % limit, that is 2.5 sigma more: missed once in 7000
        assert any(abs(order - 7.3) < 0.01 for order in orders)


def test_faults_are_flagged_masked_and_the_diagnosis_goes_on():
    trace = record(line)
    torque = trace["torque_nm"].copy()
    torque[2000:2040] = np.nan
    torque[[500, 5000, 7777]] += 5.0
    torque[8000:8050] = torque[8000]
    result = diagnose_trace(trace.with_columns(torque_nm=torque), PROFILE)
    found = flags(result)
    assert found["missed-samples"] == 40
    assert found["spikes"] == 3
    assert 49 <= found["stuck-value"] <= 51
    spikes, order = result.causes
    assert spikes.name == "spikes"
    # a single line at an order that is not whole is one of a bearing, or of whatever else
    assert {order.name, *order.rivals} == {"bearing-defect", "ripple-harmonic"}
    assert order.parameters["order"].value == pytest.approx(3.37, abs=1e-3)


def test_clipped_samples_are_flagged():
    trace = record(n=5000)
    clipped = np.minimum(trace["torque_nm"], 1.0)
    result = diagnose_trace(trace.with_columns(torque_nm=clipped), PROFILE)
    assert flags(result)["saturation"] == int((clipped == 1.0).sum())


def test_missing_torque_is_an_error_that_says_what_is_needed():
    trace = record(n=100)
    bare = Trace({k: v for k, v in trace.columns.items() if k != "torque_nm"})
    with pytest.raises(DataError, match="torque_nm in N m"):
        diagnose_trace(bare, PROFILE)


@pytest.mark.parametrize("materiality", [-0.1, 1.0, float("nan")])
def test_materiality_out_of_its_domain_is_refused(materiality):
    with pytest.raises(ValueError, match="materiality"):
        diagnose_trace(record(n=200), PROFILE, materiality=materiality)


def test_materiality_zero_moves_small_causes_up():
    trace = record(lambda t, a, w: 0.0055 * np.cos(7.3 * a), seed=1)
    usual, strict = (diagnose_trace(trace, PROFILE, materiality=m) for m in (0.01, 0.0))
    assert (len(usual.causes), len(usual.minor)) == (0, 1)
    assert usual.verdict == "nothing-found"
    assert (len(strict.causes), len(strict.minor)) == (1, 0)


def test_run_folder_holds_the_extended_model_with_which_nothing_more_is_found(found, tmp_path):
    file = tmp_path / "trace.csv"
    write_trace(file, record(line))
    folder, result = diagnose_run(file, PROFILE, out=tmp_path / "runs")
    stored = result.to_json()
    assert stored == read_json(folder / "result.json", "hdbench/diagnosis/1")
    # the same record gives the same result
    for key in ("verdict", "causes", "minor", "unexplained", "simulated", "minimum_detectable"):
        assert json.dumps(found.to_json()[key]) == json.dumps(stored[key]), key
    names = set(read_json(folder / "run.json")["files"])
    assert {"result.json", "model.json", "residual.csv", "order_spectrum.csv"} <= names
    model = load_model(folder / "model.json")
    options = DiagnosisOptions(folder / "model.json")
    again, second = diagnose_run(file, PROFILE, out=tmp_path / "runs", options=options)
    assert second.verdict == "nothing-found"
    assert again != folder
    simulated = simulate_like(record(), PROFILE.data, model)["torque_nm"]
    measured = record(line)["torque_nm"]
    # what is left is the noise of 0.05 N m; 10 000 samples know it to 0.7 %
    assert np.nanstd(measured - simulated) == pytest.approx(0.05, rel=0.03)


def readings(noise_nm=0.0, n_experiments=2):
    rng = np.random.default_rng(0)
    return Loads(
        tuple(
            LoadReading(f"e{e}", 0.0, "full", "cw", "up", load, load / 6.6 + 0.01 * e + bump)
            for e in range(n_experiments)
            for load in (0.0, 10.0, 20.0, 30.0)
            for bump in (noise_nm / 6.6 * rng.standard_normal(),)
        )
    )


def test_loads_get_their_baselines_residual_and_an_honest_verdict():
    result = diagnose_loads(readings(noise_nm=0.02), PROFILE)
    assert result.verdict == "nothing-found"
    # five free readings: chi^2 with 5 dof within (0.2, 20) of 5 with 99.8 %, held-out is larger
    assert 0.004 < result.simulated.heldout_rms_nm < 0.08


@pytest.mark.parametrize(
    "term", ["misalignment", "+misalignment", "-zero", "+order:nan", "-order:"]
)
def test_what_is_no_term_of_the_baseline_is_told(term):
    with pytest.raises(UsageError, match="-order:NUMBER"):
        parse_baseline([term])
