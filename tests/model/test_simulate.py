import json
import math

import numpy as np
import pytest

from hdbench.errors import UsageError
from hdbench.model import (
    BenchModel,
    CauseTerm,
    catalogue,
    save_model,
    simulate_like,
    simulate_run,
    with_noise,
)
from hdbench.profile.schema import ReferenceWave
from hdbench.records.trace import Trace
from hdbench.records.tracefile import read_trace, write_trace


def run_of(bench, wave, duration, noise=0.0, model=None):
    model = model or BenchModel.from_profile(bench)
    options = {"wave": wave, "noise_nm": noise, "rng": np.random.default_rng(3)}
    return simulate_run(bench, model, duration_s=duration, **options)


def test_a_small_step_of_reference_gives_the_first_order_answer(bench):
    run = run_of(bench, ReferenceWave(wave="constant", bias_v=0.1), 0.5)
    rate = 2.0 * math.pi * 15.0
    target = 56.2565 * 0.1
    time = run.time_s
    want = target * (1.0 - np.exp(-rate * time))
    # the lag is exact for a constant command: rounding of 5000 steps
    np.testing.assert_allclose(run["motor_velocity_rad_s"], want, rtol=0, atol=1e-10)
    angle = target * (time - (1.0 - np.exp(-rate * time)) / rate)
    # trapezoidal rule in steps of 0.1 ms: step^2 / 12 times the change of the derivative
    error = 1e-8 / 12 * target * rate
    np.testing.assert_allclose(run["motor_angle_rad"], angle, rtol=0, atol=1.01 * error)


def test_a_large_step_of_reference_runs_into_the_acceleration_limit(bench):
    run = run_of(bench, ReferenceWave(wave="constant", bias_v=5.0), 0.5)
    early = run.time_s < 0.09
    want = 2500.0 * run.time_s[early]
    # 900 additions of 0.25, exact to rounding
    np.testing.assert_allclose(run["motor_velocity_rad_s"][early], want, rtol=0, atol=1e-9)
    expected = 1.725e-4 * 2500.0
    ripple = 0.4 + 0.2
    middle = run["torque_nm"][30:80]
    # inertia's 0.43 N m under ripple of at most 0.6 and a misalignment of 0.9 cos(0.3) = 0.860
    assert (np.abs(middle - expected - 0.9 * math.cos(0.3)) <= ripple + 0.01).all()


def test_noise_has_the_size_asked_for_and_comes_from_the_seed(bench):
    wave = ReferenceWave(wave="constant", bias_v=1.0)
    clean, noisy = run_of(bench, wave, 10.0), run_of(bench, wave, 10.0, noise=0.05)
    added = noisy["torque_nm"] - clean["torque_nm"]
    # 10 000 samples know a standard deviation to 0.7 %: 4 sigma
    assert float(added.std()) == pytest.approx(0.05, rel=0.028, abs=0)
    again = run_of(bench, wave, 10.0, noise=0.05)
    assert again["torque_nm"].tobytes() == noisy["torque_nm"].tobytes()


@pytest.mark.parametrize("duration", [math.nan, 0.0, 0.004, 1e9])
def test_a_run_of_no_length_or_too_long_is_refused(bench, duration):
    with pytest.raises(UsageError, match="duration"):
        run_of(bench, ReferenceWave(wave="constant"), duration)


@pytest.mark.parametrize("noise", [-1.0, math.nan, math.inf])
def test_noise_that_is_none_is_refused(noise):
    trace = Trace({"time_s": np.arange(3.0), "torque_nm": np.zeros(3)})
    with pytest.raises(UsageError, match="noise"):
        with_noise(trace, noise, np.random.default_rng(0))


def test_measured_columns_are_kept_and_the_measured_torque_is_not(bench):
    rng = np.random.default_rng(8)
    time = np.arange(100) * 1e-3
    kept = {"time_s": time, "tacho_v": rng.normal(1.0, 0.001, 100), "encoder_count": 1e3 * time}
    torques = {name: rng.normal(size=100) for name in ("torque_v", "torque_filtered_online_nm")}
    measured = Trace({**kept, **torques})
    measured["tacho_v"][40] = np.nan
    simulated = simulate_like(measured, bench, BenchModel.from_profile(bench))
    assert list(simulated.columns) == [*kept, "torque_nm", "torque_true_nm"]
    assert simulated["encoder_count"] is measured["encoder_count"]
    assert np.flatnonzero(np.isnan(simulated["torque_nm"])).tolist() == [40]


@pytest.fixture
def simulated(hdbench):
    """Return a function that simulates into a file, for the JSON and what is said."""

    def run(out, *words, code=0):
        shown, said = hdbench("simulate", *words, "--out", out, "--json", code=code)
        return json.loads(shown), said

    return run


def test_the_command_simulates_alone_and_like_a_trace(tmp_path, simulated):
    alone, like = tmp_path / "alone.csv", tmp_path / "like.csv.gz"
    facts, _ = simulated(alone, "--duration", "2")
    assert facts["schema"] == "hdbench/simulation/1"
    assert facts["samples"] == 2000
    facts, _ = simulated(like, "--like", alone)
    assert facts["like"] == str(alone)
    # a trace file keeps every bit
    assert read_trace(like)["torque_nm"].tobytes() == read_trace(alone)["torque_nm"].tobytes()


def test_the_command_takes_an_extended_model(tmp_path, profile, simulated):
    path = tmp_path / "model.json"
    model = BenchModel.from_profile(profile.data)
    drift = CauseTerm("zero-drift", {}, (0.5,))
    save_model(path, model.with_cause(drift), profile=profile, provenance={})
    plain, drifting = tmp_path / "plain.csv", tmp_path / "drifting.csv"
    simulated(plain, "--duration", "1")
    simulated(drifting, "--duration", "1", "--model", path)
    added = read_trace(drifting)["torque_nm"] - read_trace(plain)["torque_nm"]
    # differences of torques of about 1 N m
    np.testing.assert_allclose(added, 0.5 * read_trace(plain).time_s, rtol=0, atol=1e-14)


def test_wrong_calls_write_nothing_and_never_over_what_was_measured(tmp_path, simulated):
    path = tmp_path / "trace.csv"
    simulated(path, "--duration", "1")
    before = path.read_bytes()
    for out, words in (
        (path, ("--like", path)),
        (path, ("--like", tmp_path)),
        # a measured motion has its own length
        (tmp_path / "x.csv", ("--like", path, "--duration", "2")),
        (tmp_path / "trace.txt", ("--duration", "1")),
    ):
        simulated(out, *words, code=2)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_simulation_without_a_single_torque_says_so(tmp_path, profile, simulated):
    path, model = tmp_path / "trace.csv", tmp_path / "model.json"
    simulated(path, "--duration", "1")
    lost = np.full(1000, np.nan)
    write_trace(path, read_trace(path).with_columns(load_torque_nm=lost))
    loaded = BenchModel.from_profile(profile.data).with_cause(CauseTerm("gain-error", {}, (0.1,)))
    save_model(model, loaded, profile=profile, provenance={})
    facts, _ = simulated(tmp_path / "o.csv", "--like", path, "--model", model, code=6)
    assert facts["torque_rms_nm"] is None


def test_lost_samples_make_the_simulation_doubtful(tmp_path, simulated):
    path, out = tmp_path / "trace.csv", tmp_path / "out.csv"
    simulated(path, "--duration", "1")
    trace = read_trace(path)
    velocity = trace["motor_velocity_rad_s"].copy()
    velocity[500] = np.nan
    write_trace(path, trace.with_columns(motor_velocity_rad_s=velocity))
    facts, said = simulated(out, "--like", path, code=6)
    assert facts["lost_samples"] == 1
    assert "1 of 1000 samples" in said
    assert np.flatnonzero(np.isnan(read_trace(out)["torque_nm"])).tolist() == [500]


def test_a_run_of_its_own_can_show_every_cause(bench, middle_shape):
    wave = ReferenceWave(wave="sine", amplitude_v=0.8, frequency_hz=2.0)
    base = BenchModel.from_profile(bench)
    plain = run_of(bench, wave, 0.5)
    for name, cause in catalogue().items():
        linear = (0.1,) * len(cause.linear)
        model = base.with_cause(CauseTerm(name, middle_shape(cause), linear))
        run = run_of(bench, wave, 0.5, model=model)
        again = simulate_like(run, bench, model)
        assert again["torque_nm"].tobytes() == run["torque_nm"].tobytes(), name
        changed = np.abs(run["torque_nm"] - plain["torque_nm"]).max() > 0.0
        # a fault of angle or clock moves this torque or not, by where it begins; a knee at 7 N m
        # and a sharp limit at 24 N m lie beyond the torque of a free run
        beyond = name in ("piecewise-stiffness", "saturation")
        unseen = cause.change_motion is not None or beyond
        assert changed == cause.additive or unseen, name
    # current at the acceleration limit is the amplifier's
    crosstalk = base.with_cause(CauseTerm("crosstalk", {}, (0.5,)))
    fast = ReferenceWave(wave="constant", bias_v=5.0)
    run = run_of(bench, fast, 0.1, model=crosstalk)
    # 1e-12: rounding of a difference of velocities over 1 ms
    assert run["motor_current_a"][20] == pytest.approx(bench.servo.max_current_a, rel=1e-12, abs=0)


def test_the_true_torque_is_what_is_left_without_ripple_misalignment_and_noise(bench):
    model = BenchModel.from_profile(bench)
    simulated = run_of(bench, bench.ripple.reference, 2.0, noise=0.05)
    angle, n = simulated["motor_angle_rad"], bench.drive.gear_ratio
    amplitude, phase = model.misalignment
    waves = amplitude * np.cos(angle / n + phase) + sum(
        a * np.cos(order * angle + p) for order, a, p in model.ripple
    )
    noise = simulated["torque_nm"] - simulated["torque_true_nm"] - waves
    # white noise of 0.05 N m in 2000 samples: its rms is known to 1.6 %
    assert np.std(noise) == pytest.approx(0.05, rel=0.1)
    assert np.abs(np.mean(noise)) < 0.01
