"""Causes of an extended model on the true motion of the emulated bench."""

from functools import cache

import numpy as np
import pytest
from plant_tools import AS_MODELLED, NM_PER_CODE, V_PER_CODE, quiet_profile, run

from hdbench.model import BenchModel, CauseTerm, catalogue
from hdbench.plant.bench import SimulatedBench, cause_volts
from hdbench.plant.converter import HALF_LENGTH_SAMPLES
from hdbench.plant.fixture import ArmLoad, Mount
from hdbench.plant.plantfile import FixtureSpec
from hdbench.plant.timeline import AnalogueChannels
from hdbench.profile.schema import ReferenceWave

QUIET = quiet_profile()
NM_PER_V = QUIET.sensor.gain_nm_per_v
CHANNELS = AnalogueChannels.build(QUIET, AS_MODELLED.data.motor, ())
FREE = Mount(False, 0.0, NM_PER_V, ArmLoad(0.0, 0.0, 9.81, FixtureSpec()), 0.0)
# 2 s of a sine of speed: 45 rad/s at 3 Hz
REFERENCE_V = 0.8 * np.sin(2.0 * np.pi * 3.0 * np.arange(2000) * 1e-3)


@pytest.mark.parametrize("name", catalogue())
def test_every_cause_can_be_emulated(name, middle_shape):
    cause = catalogue()[name]
    term = CauseTerm(name, middle_shape(cause), (0.1,) * len(cause.linear))
    model = BenchModel.from_profile(QUIET).with_cause(term)
    volts = cause_volts(model, CHANNELS, FREE, 1e-3, REFERENCE_V)
    assert volts.shape == (2000,)
    assert np.isfinite(volts).all()
    # a knee at some N m and a sharp limit above it lie beyond the torque of a free run
    beyond = name in ("piecewise-stiffness", "saturation")
    assert volts.any() == (catalogue()[name].additive and not beyond)


def test_a_gain_error_acts_on_the_torque_of_the_models_inertia():
    base = BenchModel.from_profile(QUIET)
    inertia = CauseTerm("inertia-error", {}, (0.5 * base.inertia_nm_s2 * 100.0,))
    gain = CauseTerm("gain-error", {}, (0.5,))
    one, other = (
        cause_volts(base.with_cause(term), CHANNELS, FREE, 1e-3, REFERENCE_V)
        for term in (inertia, gain)
    )
    # products of two factors in another order
    np.testing.assert_allclose(one, other, rtol=1e-13, atol=0)
    assert np.abs(one).max() > 0.01 / NM_PER_V


def test_crosstalk_is_that_of_the_current_which_the_bench_records():
    model = BenchModel.from_profile(QUIET).with_cause(CauseTerm("crosstalk", {}, (0.5,)))
    wave = ReferenceWave(wave="sine", amplitude_v=0.8, frequency_hz=3.0)
    talking, silent = (
        run(SimulatedBench(QUIET, AS_MODELLED, 1, model=emulated), wave, 2000)
        for emulated in (model, None)
    )
    added = (talking.torque_code - silent.torque_code.astype(float)) * NM_PER_CODE
    current = silent.current_code * V_PER_CODE * QUIET.servo.max_current_a / QUIET.daq.range_v
    # rounding of three channels to codes of 2 mN m, and the converter's filter of the current
    tolerance = 2.0 * NM_PER_CODE + 0.02 * 0.5 * np.abs(current).max()
    assert np.abs(added - 0.5 * current)[20:].max() < tolerance
    assert np.abs(added).max() > 10.0 * NM_PER_CODE


LOADS_KG = [0.0, 4.0, 8.0, 4.0, 0.0]


def hung(model: BenchModel, direction: int) -> np.ndarray:
    """Return the mean torque reading of each weight, N m, 10 s after it was hung."""
    bench = SimulatedBench(QUIET, AS_MODELLED, 1, model=model)
    bench.begin(sample_period_s=0.1, wave=None, duration_s=2000.0)
    found = []
    for mass in LOADS_KG:
        bench.set_fixture(locked=True, position_rad=0.5, mass_kg=mass, direction=direction)
        bench.advance(100)
        found.append(bench.advance(30).torque_code.mean() * NM_PER_CODE)
    return np.array(found)


@cache
def hung_without_cause(direction: int) -> np.ndarray:
    return hung(BenchModel.from_profile(QUIET), direction)


def added(term: CauseTerm, direction: int = 1) -> np.ndarray:
    """Return what a cause adds: a difference of noise-free readings, each rounded to a code."""
    model = BenchModel.from_profile(QUIET).with_cause(term)
    return hung(model, direction) - hung_without_cause(direction)


@pytest.mark.parametrize("direction", [1, -1])
def test_weights_on_a_locked_bench_show_a_cubic(direction):
    load = direction * np.array(LOADS_KG) * QUIET.arm.gravity_m_s2 * QUIET.arm.length_m
    got = added(CauseTerm("cubic-nonlinearity", {}, (0.02,)), direction)
    np.testing.assert_allclose(got, 0.02 * (load / 10.0) ** 3, rtol=0, atol=NM_PER_CODE)
    assert np.abs(got).max() > 100.0 * NM_PER_CODE


def test_weights_on_a_locked_bench_go_round_a_loop():
    got = added(CauseTerm("hysteresis", {"yield_nm": 1.0}, (0.3, 0.0)))
    # a weight is twenty times the yield: all elements slip, upwards then downwards
    np.testing.assert_allclose(got[1:3], 0.3, rtol=0, atol=NM_PER_CODE)
    np.testing.assert_allclose(got[3:], -0.3, rtol=0, atol=NM_PER_CODE)


def test_a_weight_that_hangs_long_creeps():
    got = added(CauseTerm("creep", {"time_constant_s": 15.0}, (0.01,)))
    weight = 4.0 * QUIET.arm.gravity_m_s2 * QUIET.arm.length_m
    # hung when the converter has seen half its filter beyond the last of 130 samples; readings are
    # means of 30 samples from the 100th on
    age_s = 0.1 * (100.0 + np.arange(30) - (HALF_LENGTH_SAMPLES - 1))
    left = np.exp(-age_s / 15.0).mean()
    assert got[1] == pytest.approx(0.01 * weight * (1.0 - left), abs=NM_PER_CODE)
    assert got[-1] > 5.0 * NM_PER_CODE


def test_a_bench_that_is_set_free_forgets_its_weights():
    model = BenchModel.from_profile(QUIET).with_cause(CauseTerm("gain-error", {}, (0.1,)))
    benches = [SimulatedBench(QUIET, AS_MODELLED, 1, model=m) for m in (model, None)]
    locked, free = [], []
    for bench in benches:
        bench.begin(sample_period_s=0.1, wave=None, duration_s=100.0)
        bench.set_fixture(locked=True, position_rad=0.0, mass_kg=4.0, direction=1)
        locked.append(bench.advance(200).torque_code[-1])
        bench.set_fixture(locked=False, position_rad=0.0, mass_kg=0.0, direction=1)
        free.append(bench.advance(50).torque_code[-1])
    assert locked[0] > locked[1] + 100
    assert free[0] == free[1]
