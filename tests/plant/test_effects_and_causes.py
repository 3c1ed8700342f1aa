"""Effects of the plant are what the catalogue's causes of the same name explain."""

import math
from typing import Any

import numpy as np
import pytest
from plant_tools import NM_PER_CODE, V_PER_CODE, constant, plant, quiet_profile, run

from hdbench.model import (
    BenchModel,
    Motion,
    baseline_columns,
    catalogue,
    motion_from_trace,
    with_signal,
)
from hdbench.plant.bench import SimulatedBench
from hdbench.profile.schema import MisalignmentParameters, ReferenceWave
from hdbench.records.trace import FloatArray, Trace

PROFILE = quiet_profile(
    encoder={"counts_per_turn": 2_000_000},
    model={"misalignment": MisalignmentParameters(amplitude_nm=0.0)},
)


def recorded(effect: dict[str, Any], wave: ReferenceWave) -> tuple[Motion, FloatArray]:
    bench = SimulatedBench(PROFILE, plant(effects=[effect]), 5)
    raw = run(bench, wave, 20_000)
    columns = {
        "time_s": 1e-3 * np.arange(20_000),
        "motor_velocity_rad_s": raw.tacho_code * V_PER_CODE * PROFILE.tacho.gain_rad_s_per_v,
        "encoder_count": raw.encoder_count.astype(np.float64),
    }
    return motion_from_trace(Trace(columns), PROFILE), raw.torque_code * NM_PER_CODE


def explained(name: str, shape: dict[str, float], motion: Motion, torque: FloatArray) -> FloatArray:
    """Return the linear parameters of a cause, fitted with the baseline, and check what is left."""
    fixed, names, columns = baseline_columns(motion, PROFILE)
    # not where the reference jumps and a 20 ms acceleration cannot follow
    good = motion.valid & (np.abs(motion.acceleration_rad_s2) < 500.0)
    baseline = np.linalg.lstsq(columns[good], (torque - fixed)[good], rcond=None)[0]
    model = BenchModel.from_profile(PROFILE).with_baseline(names, baseline.tolist())
    before = (torque - fixed - columns @ baseline)[good]
    motion = with_signal(motion, model.torque_nm)
    assert catalogue()[name].applicable(motion) is None
    own = catalogue()[name].columns(motion, shape)
    design = np.hstack([own, columns])
    fit = np.linalg.lstsq(design[good], (torque - fixed)[good], rcond=None)[0]
    left = (torque - fixed - design @ fit)[good]
    assert left.std() < 0.1 * before.std()
    return fit[: own.shape[1]]


def test_a_wandering_encoder_is_a_transmission_error():
    effect = {"kind": "transmission-error", "order": 1.0, "amplitude_rad": 0.05, "phase_rad": 0.7}
    motion, torque = recorded(effect, constant(1.2))
    fit = explained("transmission-error", {}, motion, torque)
    # first order in an error of 0.05 rad at orders 2 and 4: up to 0.2^2 / 8 of it, 0.5 %
    want = [0.05 * math.cos(0.7), -0.05 * math.sin(0.7)]
    np.testing.assert_allclose(fit[2:4], want, rtol=0, atol=2.5e-4)
    np.testing.assert_allclose(fit[[0, 1, 4, 5]], 0.0, rtol=0, atol=2.5e-4)


def test_the_motor_s_poles_are_cogging():
    effect = {"kind": "cogging", "order": 6.0, "amplitude_nm": 0.2, "phase_rad": 0.4}
    motion, torque = recorded({**effect, "decay": 0.2}, constant(0.5))
    fit = explained("cogging", {"order": 6.0}, motion, torque)
    waves = [0.2 * 0.2 ** (k - 1) * np.exp(-0.4j * k) for k in (1, 2, 3, 6)]
    want = [part for wave in waves for part in (wave.real, wave.imag)]
    # the anti-alias filter passes 0.1 %; a code is 2 mN m, 20 000 of them average out
    np.testing.assert_allclose(fit, want, rtol=0, atol=3e-4)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_friction_by_direction_is_asymmetric(sign):
    effect = {
        "kind": "asymmetric-friction",
        "coulomb_difference_nm": 0.2 * sign,
        "viscous_difference_nm_s_per_rad": 0.3,
        "transition_rad_s": 0.005,
    }
    edges = {"rise": 0.3, "duty": 0.3, "fall": 0.3}
    wave = ReferenceWave(wave="trapezoid", amplitude_v=2.0, frequency_hz=0.1, **edges)
    motion, torque = recorded(effect, wave)
    dry, viscous = explained("asymmetric-friction", {}, motion, torque)
    # per output speed in the plant, per motor speed in the cause
    assert viscous == pytest.approx(0.003, rel=0.02)
    # the two laws differ for a while near standstill, which the trapezoid has
    assert dry == pytest.approx(0.2 * sign, abs=0.03)
