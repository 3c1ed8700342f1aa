"""The simulated bench as a whole against the closed form of its model."""

import json
import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plant_tools import (
    AS_MODELLED,
    NM_PER_CODE,
    V_PER_CODE,
    WORN,
    constant,
    plant,
    profile,
    quiet_profile,
    run,
)

from hdbench.errors import UsageError
from hdbench.model import BenchModel, CauseTerm
from hdbench.plant.bench import SimulatedBench
from hdbench.plant.converter import RawSamples
from hdbench.profile.schema import HarmonicParameters, ProfileData, ReferenceWave

NOISY, QUIET = profile(), quiet_profile()
TRAPEZOID = NOISY.ripple.reference


def _columns(samples: RawSamples) -> np.ndarray:
    return np.vstack([samples.codes.T, samples.encoder_count])


def _steady_torque(data: ProfileData, angle: np.ndarray, factor: float = 1.0) -> np.ndarray:
    """Return zero, ripple and misalignment by the profile's definition; no acceleration."""
    model = data.model
    waves = [(1.0 / data.drive.gear_ratio, model.misalignment)]
    waves += [(part.order * factor, part) for part in model.ripple]
    return model.zero_nm + sum(
        part.amplitude_nm * np.cos(order * angle + part.phase_rad) for order, part in waves
    )


def _ramp_angle(time_s: np.ndarray, speed: float) -> np.ndarray:
    """Return the angle of a start to a constant speed, once the loop has settled.

    The loop runs at 2500 rad/s^2 until the rest is 2500 / k, then falls off with 1 / k.
    """
    k = 2 * math.pi * 15.0
    tail = min(speed, 2500.0 / k)
    ramp = (speed - tail) / 2500.0
    return speed * time_s - speed * ramp + 0.5 * 2500.0 * ramp**2 - tail / k


def _torque_error(
    bench: SimulatedBench, expected: Callable[[np.ndarray], np.ndarray], speed: float = 60.0
) -> float:
    """Return the largest error of the torque at a speed against a function of the angle, N m."""
    samples = run(bench, constant(speed / 56.2565), 3000)
    time = np.arange(3000) * 1e-3
    error = samples.torque_code * NM_PER_CODE - expected(_ramp_angle(time, speed))
    return float(np.abs(error[time > 0.5]).max())


# half a code of rounding, and the filter's ripple of 0.03 % on 0.6 N m of ripple
TORQUE_ERROR_NM = 0.5 * NM_PER_CODE + 2e-4


@pytest.mark.parametrize(("flexspline", "factor"), [("standing", 1.0), ("turning", 1.01)])
@pytest.mark.parametrize("speed", [20.0, 60.0, 156.0])
def test_quiet_torque_is_the_model_within_one_code(flexspline, factor, speed):
    data = quiet_profile(drive={"flexspline": flexspline}, model={"zero_nm": 0.7})
    bench = SimulatedBench(data, AS_MODELLED, 1)
    error_nm = _torque_error(bench, lambda angle: _steady_torque(data, angle, factor), speed)
    assert error_nm <= TORQUE_ERROR_NM


def test_tacho_current_and_reference_at_constant_speed():
    volt = 2.0
    spec = plant(motor={"coulomb_nm": 0.03, "viscous_nm_s_per_rad": 1e-4})
    samples = run(SimulatedBench(QUIET, spec, 1), constant(volt), 2000)
    # reference and tacho have one scale on this bench
    assert set(samples.reference_code[1500:]) == {round(volt / V_PER_CODE)}
    assert set(samples.tacho_code[1500:]) == {round(volt / V_PER_CODE)}
    speed = volt * 56.2565
    friction = 0.03 * 2 / math.pi * math.atan(speed) + 1e-4 * speed
    # ten amperes at ten volts; half a code
    current = samples.current_code[1500:] * V_PER_CODE * 10.0 / 10.0
    np.testing.assert_allclose(current, friction / 0.05, rtol=0, atol=0.51 * V_PER_CODE)


def test_sampling_at_ten_milliseconds_gives_the_same_motion():
    fast = run(SimulatedBench(QUIET, AS_MODELLED, 1), constant(1.0), 2000, 1e-3)
    slow = run(SimulatedBench(QUIET, AS_MODELLED, 1), constant(1.0), 200, 1e-2)
    np.testing.assert_array_equal(fast.encoder_count[::10], slow.encoder_count)
    # settled: the tacho has no more transient, and half a code of rounding on both
    np.testing.assert_allclose(fast.tacho_code[1000::10], slow.tacho_code[100:], rtol=0, atol=1)


def test_noise_has_the_size_the_profile_states_and_is_white():
    n = 40_000
    samples = run(SimulatedBench(NOISY, AS_MODELLED, 4), None, n)
    torque = samples.torque_code * NM_PER_CODE
    torque -= torque.mean()
    # sigma is known to 1/sqrt(2 n) = 0.35 %, correlation to 1/sqrt(n) = 0.5 %: five sigma, 6e-7
    assert torque.std() == pytest.approx(0.05, rel=0.018)
    for lag in (1, 2, 7):
        assert abs(np.mean(torque[lag:] * torque[:-lag])) / torque.var() < 0.025
    tacho = samples.tacho_code * V_PER_CODE
    # rounding adds q^2 / 12 to 1 mV squared: 0.4 %
    assert tacho.std() == pytest.approx(math.hypot(0.001, V_PER_CODE / math.sqrt(12)), rel=0.018)


@settings(max_examples=12)
@given(
    st.lists(st.integers(0, 700), min_size=0, max_size=8).map(sorted),
    st.sampled_from([AS_MODELLED, WORN]),
)
def test_any_split_gives_the_same_bits(cuts, spec):
    wave = TRAPEZOID.model_copy(update={"frequency_hz": 2.0})
    whole = _columns(run(SimulatedBench(NOISY, spec, 9), wave, 700))
    bench = SimulatedBench(NOISY, spec, 9)
    bench.begin(sample_period_s=1e-3, wave=wave, duration_s=0.7)
    parts = [_columns(bench.advance(b - a)) for a, b in pairwise([0, *cuts, 700])]
    np.testing.assert_array_equal(np.concatenate(parts, axis=1), whole)


@settings(max_examples=12)
@given(st.integers(0, 300), st.lists(st.integers(0, 300), max_size=4).map(sorted))
def test_a_halt_gives_the_same_bits_however_samples_were_asked_for(at, cuts):
    results = []
    for places in ([0, at], [0, *[c for c in cuts if c < at], at]):
        bench = SimulatedBench(NOISY, WORN, 2)
        bench.begin(sample_period_s=1e-3, wave=constant(2.0), duration_s=1.0)
        parts = [_columns(bench.advance(b - a)) for a, b in pairwise(places)]
        bench.halt()
        parts.append(_columns(bench.advance(400)))
        results.append(np.concatenate(parts, axis=1))
    np.testing.assert_array_equal(results[0], results[1])


def test_the_same_seed_gives_the_same_bits_and_another_seed_or_acquisition_does_not():
    bench = SimulatedBench(NOISY, WORN, 3)
    first, again = (_columns(run(bench, TRAPEZOID, 500)) for _ in range(2))
    same, other = (
        _columns(run(SimulatedBench(NOISY, WORN, seed), TRAPEZOID, 500)) for seed in (3, 4)
    )
    np.testing.assert_array_equal(first, same)
    for noisy in (again, other):
        np.testing.assert_array_equal(first[4], noisy[4])
        assert (first[0] != noisy[0]).mean() > 0.9


def test_halt_brakes_within_the_limit_to_standstill():
    bench = SimulatedBench(QUIET, AS_MODELLED, 1)
    bench.begin(sample_period_s=1e-3, wave=constant(6.0), duration_s=5.0)
    bench.advance(1000)
    assert bench.enabled
    # what is left of the start after a second: 80 time constants, rounding
    assert bench.velocity_rad_s == pytest.approx(6.0 * 56.2565, rel=1e-9)
    bench.halt()
    assert bench.reference_v == 0.0
    assert bench.enabled
    speeds = [bench.velocity_rad_s]
    for _ in range(400):
        bench.advance(1)
        speeds.append(bench.velocity_rad_s)
    # 2500 rad/s^2 for a millisecond
    assert np.abs(np.diff(speeds)).max() <= 2.5 * (1 + 1e-9)
    assert abs(speeds[-1]) < 4e-4
    assert not bench.enabled
    # ramp of 311 rad/s at 2500 rad/s^2, then 11.2 time constants of 10.6 ms down to 4e-4 rad/s
    still = next(i for i, value in enumerate(speeds[1:]) if abs(value) < 4e-4)
    assert still * 1e-3 == pytest.approx(311.0 / 2500.0 + 11.1 / (2 * math.pi * 15), abs=0.003)


@pytest.mark.parametrize("taken", [1, 2, 40, 56, 57, 58, 120, 121, 122])
def test_a_halt_acts_when_the_filter_has_seen_the_last_sample(taken):
    bench = SimulatedBench(QUIET, AS_MODELLED, 1)
    bench.begin(sample_period_s=1e-3, wave=constant(2.0), duration_s=5.0)
    bench.advance(taken)
    bench.halt()
    reference = bench.advance(60).reference_code
    # eight samples after the last one taken, that is seven after the next
    assert np.flatnonzero(reference == 0)[0] == 7
    assert np.all(reference[:7] == round(2.0 / V_PER_CODE))
    assert not reference[7:].any()


@pytest.mark.parametrize(
    ("volt", "speed"), [(2.0, 2.0 * 56.2565), (9.0, QUIET.limits.velocity_rad_s)]
)
def test_the_motor_keeps_turning_within_its_limit_until_it_is_halted(volt, speed):
    bench = SimulatedBench(QUIET, AS_MODELLED, 1)
    run(bench, constant(volt), 500)
    bench.advance(500)
    # a second is 94 time constants: rounding is left
    assert bench.velocity_rad_s == pytest.approx(speed, rel=1e-9)


def test_without_a_wave_nothing_moves_and_the_drive_is_off():
    bench = SimulatedBench(QUIET, AS_MODELLED, 1)
    samples = run(bench, None, 300)
    assert not bench.enabled
    assert bench.velocity_rad_s == 0.0
    assert not samples.encoder_count.any()
    assert len(set(samples.torque_code)) == 1


def test_encoder_goes_back_over_its_counts_after_a_reversal():
    square = ReferenceWave(wave="square", amplitude_v=1.0, frequency_hz=1.0)
    counts = run(SimulatedBench(QUIET, AS_MODELLED, 1), square, 1001).encoder_count
    steps = np.diff(counts)
    top = int(np.argmax(counts))
    assert np.all(steps[:top] >= 0)
    assert np.all(steps[top:] <= 0)
    # from the reversal the speed falls at 2500 rad/s^2 and passes zero after 22.5 ms
    assert top in (522, 523)
    highest = _ramp_angle(np.array([0.5]), 56.2565)[0] + 56.2565**2 / (2 * 2500.0)
    # one count
    assert counts[top] * 2 * math.pi / 4000 == pytest.approx(highest, abs=2 * math.pi / 4000)


@pytest.mark.parametrize(("zero_nm", "code"), [(70.0, 32767), (-70.0, -32768)])
def test_saturated_codes_stay_at_the_ends_of_the_range(zero_nm, code):
    data = quiet_profile(model={"zero_nm": zero_nm})
    assert set(run(SimulatedBench(data, AS_MODELLED, 1), None, 100).torque_code) == {code}


def test_as_modelled_has_no_effect_and_worn_shows_its_own():
    assert SimulatedBench(NOISY, AS_MODELLED, 5).truth()["effects"] == []
    still = quiet_profile(model={"ripple": (), "zero_nm": 0.0})
    effect = {"kind": "motor-order", "order": 3.0, "amplitude_nm": 0.2, "phase_rad": 0.5}
    bench = SimulatedBench(still, plant(effects=[effect]), 5)

    def expected(angle):
        return _steady_torque(still, angle) + 0.2 * np.cos(3 * angle + 0.5)

    assert _torque_error(bench, expected) <= TORQUE_ERROR_NM


@pytest.mark.parametrize(
    ("kind", "suffix", "volt", "level_nm"),
    [
        ("output-friction", "", 2.0, 4.0 * 2 / math.pi * math.atan(2.0 * 56.2565 / 100 / 1e-3)),
        # both directions push the torque the same way; 1e-6 of the level is missing at 1.1 rad/s
        ("asymmetric-friction", "_difference", -2.0, 4.0),
    ],
)
def test_friction_of_the_output_is_in_torque_and_current(kind, suffix, volt, level_nm):
    effect = {
        "kind": kind,
        f"coulomb{suffix}_nm": 4.0,
        f"viscous{suffix}_nm_s_per_rad": 0.0,
        "transition_rad_s": 1e-3,
    }
    runs = [
        run(SimulatedBench(QUIET, plant(effects=effects), 5), constant(volt), 1500)
        for effects in ([effect], [])
    ]
    torque = (runs[0].torque_code - runs[1].torque_code.astype(float))[1000:] * NM_PER_CODE
    # both are rounded to a code
    np.testing.assert_allclose(torque, level_nm, rtol=0, atol=1.01 * NM_PER_CODE)
    current = (runs[0].current_code - runs[1].current_code.astype(float))[1000:] * V_PER_CODE
    np.testing.assert_allclose(current, level_nm / 100 / 0.05, rtol=0, atol=1.01 * V_PER_CODE)


def test_a_wandering_encoder_leaves_torque_and_tacho_where_they_are():
    effect = {"kind": "transmission-error", "order": 1.0, "amplitude_rad": 0.3, "phase_rad": 0.0}
    wandering, true = (
        run(SimulatedBench(QUIET, plant(effects=effects), 5), constant(2.0), 6000)
        for effects in ([effect], [])
    )
    assert (wandering.torque_code == true.torque_code).all()
    assert (wandering.tacho_code == true.tacho_code).all()
    assert wandering.encoder_count[0] == 0
    per_count = 2 * math.pi / QUIET.encoder.counts_per_turn
    output = true.encoder_count * per_count / QUIET.drive.gear_ratio
    # the angles are rounded to a count each
    error = (wandering.encoder_count - true.encoder_count) * per_count
    want = 0.3 * (np.cos(output) - 1)
    np.testing.assert_allclose(error, want, rtol=0, atol=1.01 * per_count)


def test_truth_is_json_and_states_what_the_profile_says():
    data = quiet_profile(drive={"flexspline": "turning"})
    bench = SimulatedBench(data, WORN, 5)
    bench.begin(sample_period_s=1e-3, wave=None, duration_s=1.0)
    truth = json.loads(json.dumps(bench.truth(), allow_nan=False))
    assert truth["gain_nm_per_v"] == 6.6
    # order times 1 + 1/100, rounded
    assert [part["order"] for part in truth["ripple"]] == pytest.approx([2.02, 4.04], rel=1e-12)
    assert len(truth["gain_at_position"]) == 24
    tones = [effect for effect in truth["effects"] if effect["kind"] == "tone"]
    assert all(isinstance(tone["phase_rad"], float) for tone in tones)


def test_orders_that_gauges_cannot_leave_are_simulated_too():
    part = HarmonicParameters(order=3.5, amplitude_nm=0.3, phase_rad=0.2)
    data = quiet_profile(model={"ripple": (part,)})
    bench = SimulatedBench(data, AS_MODELLED, 1)
    assert _torque_error(bench, lambda angle: _steady_torque(data, angle)) <= TORQUE_ERROR_NM


def test_an_extended_model_is_emulated_with_its_causes():
    term = CauseTerm("ripple-harmonic", {"order": 6.0}, (0.3, 0.0))
    model = BenchModel.from_profile(QUIET).with_cause(term)
    bench = SimulatedBench(QUIET, AS_MODELLED, 1, model=model)

    def expected(angle):
        return _steady_torque(QUIET, angle) + 0.3 * np.cos(6 * angle)

    assert _torque_error(bench, expected) <= TORQUE_ERROR_NM
    assert bench.truth()["causes"] == ["ripple-harmonic"]
    bench.halt()
    assert len(bench.advance(100).codes) == 100


def test_samples_before_an_acquisition_are_refused():
    with pytest.raises(UsageError, match="begun"):
        SimulatedBench(NOISY, AS_MODELLED, 1).advance(1)
    with pytest.raises(UsageError, match="negative"):
        SimulatedBench(NOISY, AS_MODELLED, -1)


def test_before_its_first_acquisition_the_bench_stands():
    bench = SimulatedBench(NOISY, AS_MODELLED, 1)
    bench.halt()
    assert (bench.reference_v, bench.velocity_rad_s, bench.enabled) == (0.0, 0.0, False)
