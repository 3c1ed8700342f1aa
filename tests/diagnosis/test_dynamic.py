"""A diagnosis keeps the contract: keys, verdicts, flags, extended model."""

import json

import numpy as np
import pytest

from hdbench.diagnosis import DiagnosisOptions, diagnose_loads, diagnose_run, diagnose_trace
from hdbench.errors import DataError
from hdbench.model import load_model, simulate_like
from hdbench.profile import load_profile
from hdbench.records import LoadReading, Loads, Trace, read_json, write_trace

PROFILE = load_profile("cim-tr-97-06")
KEYS = {
    "verdict",
    "causes",
    "minor",
    "unexplained",
    "data_flags",
    "minimum_detectable",
    "simulated",
    "extended",
    "model_file",
}
CAUSE_KEYS = {
    "name",
    "group",
    "rivals",
    "parameters",
    "evidence_nats",
    "false_alarm_probability",
    "gain",
    "separating_experiment",
}


def bench_trace(extra=lambda time, angle, speed: 0.0, n=10_000, seed=0):
    rng = np.random.default_rng(seed)
    time = np.arange(n) * 1e-3
    speed = 90.0 + 40.0 * np.sin(2.0 * np.pi * time / 9.0)
    drive = 40.0 * 2.0 * np.pi / 9.0 * np.cos(2.0 * np.pi * time / 9.0)
    angle = np.concatenate([[0.0], np.cumsum(speed)[:-1] * 1e-3])
    torque = 0.4 * np.cos(2 * angle + 0.6) + 0.2 * np.cos(4 * angle - 1.1)
    torque += 0.9 * np.cos(angle / 100 + 0.3) + 1.725e-4 * drive
    torque += 0.05 * rng.standard_normal(n) + extra(time, angle, speed)
    columns = {
        "time_s": time,
        "motor_velocity_rad_s": speed,
        "motor_angle_rad": angle,
        "torque_nm": torque,
    }
    return Trace(columns)


def with_torque(trace, change):
    torque = trace["torque_nm"].copy()
    change(torque)
    return trace.with_columns(torque_nm=torque)


def flags(result):
    return {flag.name: flag.samples for flag in result.data_flags}


@pytest.fixture(scope="module")
def line():
    return diagnose_trace(bench_trace(lambda t, a, w: 0.1 * np.cos(3.37 * a)), PROFILE)


def test_result_has_the_contracts_keys_and_no_nan(line):
    body = line.to_json()
    assert set(body) >= KEYS
    assert body["verdict"] == "named"
    (cause,) = body["causes"]
    assert set(cause) >= CAUSE_KEYS
    assert set(cause["gain"]) == {
        "heldout_rms_before_nm",
        "heldout_rms_after_nm",
        "explained_fraction",
        "interval",
    }
    json.dumps(body, allow_nan=False)


def test_gain_is_what_the_hidden_amplitude_makes_of_the_noise(line):
    (cause,) = line.causes
    # A^2 / 2 of variance on top of 0.05^2
    before = np.sqrt(0.05**2 + 0.1**2 / 2.0)
    # scatter of an rms of 10 000 samples is 0.7 %
    assert cause.gain.heldout_rms_before_nm == pytest.approx(before, rel=0.03)
    assert cause.gain.heldout_rms_after_nm == pytest.approx(0.05, rel=0.03)
    low, high = cause.gain.interval
    assert low < cause.gain.explained_fraction < high


def test_two_effects_are_both_named():
    trace = bench_trace(
        lambda t, a, w: 0.08 * np.cos(6 * a) + 0.06 * np.cos(2 * np.pi * 37.3 * t), n=15_000
    )
    result = diagnose_trace(trace, PROFILE)
    assert {cause.name for cause in result.causes} == {"ripple-harmonic", "structural-tone"}
    places = {c.name: c.parameters for c in result.causes}
    order = places["ripple-harmonic"]["order"]
    tone = places["structural-tone"]["frequency_hz"]
    # four standard deviations: 1.3e-4 that a right interval misses
    assert abs(order.value - 6.0) < 4.0 * order.std
    assert abs(tone.value - 37.3) < 4.0 * tone.std


def test_a_step_is_named_once_and_placed_to_the_sample():
    trace = bench_trace(lambda t, a, w: 0.12 * (t >= 6.1234))
    result = diagnose_trace(trace, PROFILE)
    (cause,) = result.causes
    assert cause.name == "zero-step"
    assert result.minor == ()
    # a step of 2.4 sigma is placed within some (sigma / step)^2 samples
    assert cause.parameters["step_time_s"].value == pytest.approx(6.1234, abs=0.005)


def test_a_trace_with_speed_alone_raises_no_alarm_from_its_integrated_angle():
    injected = bench_trace(seed=4)
    time, speed = injected["time_s"], injected["motor_velocity_rad_s"]
    # true angle of the sine of speed, in closed form
    angle = 90.0 * time + 40.0 * 9.0 / (2.0 * np.pi) * (1.0 - np.cos(2.0 * np.pi * time / 9.0))
    rng = np.random.default_rng(4)
    torque = 0.4 * np.cos(2 * angle) + 0.2 * np.cos(4 * angle) + 0.9 * np.cos(angle / 100)
    drive = 40.0 * 2.0 * np.pi / 9.0 * np.cos(2.0 * np.pi * time / 9.0)
    torque += 1.725e-4 * drive + 0.05 * rng.standard_normal(len(time))
    trace = Trace({"time_s": time, "motor_velocity_rad_s": speed, "torque_nm": torque})
    result = diagnose_trace(trace, PROFILE, materiality=0.0)
    assert result.verdict == "nothing-found"


def test_mains_hum_and_a_tone_are_one_group():
    trace = bench_trace(lambda t, a, w: 0.08 * np.cos(2 * np.pi * 50.02 * t))
    (cause,) = diagnose_trace(trace, PROFILE).causes
    assert set(cause.group) == {"mains-hum", "structural-tone"}


def test_once_per_turn_is_named_by_its_law_of_amplitude():
    trace = bench_trace(lambda t, a, w: 0.1 * (w / 100.0) ** 2 * np.cos(a), n=15_000)
    (cause,) = diagnose_trace(trace, PROFILE).causes
    assert cause.name == "motor-unbalance"


def test_same_input_gives_the_same_result():
    trace = bench_trace(lambda t, a, w: 0.05 * np.cos(5 * a), n=3000)
    one, two = (diagnose_trace(trace, PROFILE, seed=3).to_json() for _ in range(2))
    assert json.dumps(one) == json.dumps(two)


def test_minimum_detectable_amplitude_is_indeed_found():
    clean = diagnose_trace(bench_trace(n=6000, seed=1), PROFILE)
    limit = {one.name: one.amplitude_nm for one in clean.minimum_detectable}["ripple-harmonic"]
    found = 0
    for seed in range(2):
        trace = bench_trace(lambda t, a, w: 1.4 * limit * np.cos(7.3 * a), n=6000, seed=seed)
        result = diagnose_trace(trace, PROFILE, materiality=0.0, seed=seed)
        found += any(
            abs(c.parameters["order"].value - 7.3) < 0.01
            for c in result.causes
            if "order" in c.parameters
        )
    # 40 % above the 90 % limit, that is 2.5 sigma more: missed once in 7000
    assert found == 2


def test_faults_are_flagged_masked_and_the_diagnosis_goes_on():
    def harm(torque):
        torque[2000:2040] = np.nan
        torque[[500, 5000, 7777]] += 5.0
        torque[8000:8050] = torque[8000]

    trace = with_torque(bench_trace(lambda t, a, w: 0.1 * np.cos(3.37 * a)), harm)
    result = diagnose_trace(trace, PROFILE)
    found = flags(result)
    assert found["missed-samples"] == 40
    assert found["spikes"] == 3
    assert 49 <= found["stuck-value"] <= 51
    spikes, line = result.causes
    assert spikes.name == "spikes"
    # a single line at an order that is not whole is one of a bearing, or of whatever else
    assert {line.name, *line.rivals} == {"bearing-defect", "ripple-harmonic"}
    assert line.parameters["order"].value == pytest.approx(3.37, abs=1e-3)


def test_clipped_samples_are_flagged():
    trace = with_torque(bench_trace(n=5000), lambda x: np.clip(x, None, 1.0, out=x))
    clipped = int((trace["torque_nm"] == 1.0).sum())
    assert flags(diagnose_trace(trace, PROFILE))["saturation"] == clipped


def test_missing_torque_is_an_error_that_says_what_is_needed():
    trace = bench_trace(n=100)
    bare = Trace({k: v for k, v in trace.columns.items() if k != "torque_nm"})
    with pytest.raises(DataError, match="torque_nm in N m"):
        diagnose_trace(bare, PROFILE)


@pytest.mark.parametrize("materiality", [-0.1, 1.0, float("nan")])
def test_materiality_out_of_its_domain_is_refused(materiality):
    with pytest.raises(ValueError, match="materiality"):
        diagnose_trace(bench_trace(n=200), PROFILE, materiality=materiality)


def test_materiality_zero_moves_small_causes_up():
    trace = bench_trace(lambda t, a, w: 0.005 * np.cos(7.3 * a))
    usual, strict = (diagnose_trace(trace, PROFILE, materiality=m) for m in (0.01, 0.0))
    assert (len(usual.causes), len(usual.minor)) == (0, 1)
    assert usual.verdict == "nothing-found"
    assert (len(strict.causes), len(strict.minor)) == (1, 0)


def test_run_folder_holds_the_extended_model_with_which_nothing_more_is_found(tmp_path):
    file = tmp_path / "trace.csv"
    write_trace(file, bench_trace(lambda t, a, w: 0.1 * np.cos(3.37 * a + 0.4)))
    folder, result = diagnose_run(file, PROFILE, out=tmp_path / "runs")
    assert result.to_json() == read_json(folder / "result.json", "hdbench/diagnosis/1")
    names = set(read_json(folder / "run.json")["files"])
    assert {"result.json", "model.json", "residual.csv", "order_spectrum.csv"} <= names
    model = load_model(folder / "model.json")
    options = DiagnosisOptions(folder / "model.json")
    again, second = diagnose_run(file, PROFILE, out=tmp_path / "runs", options=options)
    assert second.verdict == "nothing-found"
    assert again != folder
    simulated = simulate_like(bench_trace(), PROFILE.data, model)["torque_nm"]
    measured = bench_trace(lambda t, a, w: 0.1 * np.cos(3.37 * a + 0.4))["torque_nm"]
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
