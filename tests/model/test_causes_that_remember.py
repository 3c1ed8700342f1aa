"""Causes that remember, on whole records and on those of next to nothing."""

import cmath
import math
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hdbench.model import Cause, Motion, catalogue, shape_bounds
from hdbench.model.causes import _memory, dynamics

Make = Callable[..., Motion]
Array = np.ndarray
J = 1.725e-2


def column(name: str, motion: Motion, **shape: float) -> Array:
    return catalogue()[name].columns(motion, shape)


def without(motion: Motion, lost: Array) -> Motion:
    """Return the motion with lost samples: no speed, no angle, not valid."""
    gone = {"velocity_rad_s", "angle_rad", "acceleration_rad_s2", "output_angle_rad"}
    changed = {f: np.where(lost, np.nan, getattr(motion, f)) for f in gone}
    return replace(motion, **changed, valid=~lost)


def kept(motion: Motion, keep: Array) -> Motion:
    """Return the samples `keep` alone."""
    columns = {f: getattr(motion, f) for f in motion.__slots__}
    cut = {f: v[keep] for f, v in columns.items() if isinstance(v, np.ndarray)}
    return replace(motion, **cut)


def test_presliding_is_dahls_equation(swinging):
    t0 = float(swinging.time_s[0])

    def slope(t: float, z: Array) -> Array:
        speed = 18.0 * math.cos(9.0 * t)
        return np.array([abs(speed) * (math.copysign(1.0, speed) - z[0]) / 0.4])

    # it moves at its first sample: a long way was done before
    begin = [math.copysign(1.0, math.cos(9.0 * t0))]
    want = solve_ivp(
        slope, (t0, float(swinging.time_s[-1])), begin, t_eval=swinging.time_s, max_step=1e-3,
        rtol=1e-9,
    ).y[0]  # fmt: skip
    got = column("presliding", swinging, breakaway_rad=0.4)[:, 0]
    # a reversal inside a sample of at most 2 ms shortens its way: 162 * (1e-3)^2 / 0.4 rad
    np.testing.assert_allclose(got, want, rtol=0, atol=5e-4)


def test_presliding_begins_at_zero_from_rest(make_motion):
    angle, velocity = np.array([[0.0, 0.0, 0.5], [0.0, 0.1, 50.0]])
    motion = make_motion(3, angle_rad=angle, velocity_rad_s=velocity)
    got = column("presliding", motion, breakaway_rad=0.5)[:, 0]
    np.testing.assert_allclose(got, [0.0, 0.0, 1.0 - math.exp(-1.0)], rtol=1e-14)


def slipping(torque: Array, largest: float, starts: Array) -> Array:
    """Return eight elements that slip, one sample after the other, over the sum of their yields."""
    yields = [largest * (2 * k + 1) / 16 for k in range(8)]
    total, held, before = [], [0.0] * 8, 0.0
    for x, start in zip(torque.tolist(), starts.tolist(), strict=True):
        held = [
            0.0 if start else max(-y, min(y, h + x - before))
            for h, y in zip(held, yields, strict=True)
        ]
        before = x
        total.append(sum(held) / sum(yields))
    return np.array(total)


@pytest.mark.parametrize("largest", [0.3, 4.0, 30.0])
def test_hysteresis_is_elements_that_slip(largest, swinging):
    starts = np.zeros(3000, dtype=bool)
    starts[[0, 1300]] = True
    motion = replace(swinging, starts=starts)
    want = slipping(motion.applied_nm, largest, starts)
    got = column("hysteresis", motion, yield_nm=largest)
    # sums of eight numbers, each a difference of torques up to 11 N m, over 4 yields of 0.3 N m
    np.testing.assert_allclose(got[:, 0], want, rtol=0, atol=1e-13)
    assert (got[:, 1] == motion.applied_nm).all()


@pytest.mark.parametrize("constant", [0.7, 50.0, 7000.0])
def test_creep_is_the_sum_over_the_past_of_the_load(constant, swinging):
    time, load = swinging.time_s, swinging.applied_nm
    want = []
    for k in range(0, 3000, 250):
        # 64 points per sample by the trapezoidal rule
        fine = np.linspace(time[0], time[k], 64 * k + 1)
        kernel = np.exp(-(time[k] - fine) / constant) / constant
        want.append(np.trapezoid(kernel * np.interp(fine, time, load), fine))
    got = column("creep", swinging, time_constant_s=constant)[::250, 0]
    # a corner of the load between two points: (slope of 50 N m/s) (step of 20 us), over 0.7 s
    np.testing.assert_allclose(got, want, rtol=1e-5, atol=2e-6)


def sweep(make: Make, top: float) -> Motion:
    """Return 4 s from rest to `top` rad/s and back, at 1 kHz."""
    time = np.arange(4000) * 1e-3
    rate = 2.0 * math.pi / 4.0
    return make(
        4000,
        time_s=time,
        angle_rad=0.5 * top * (time - np.sin(rate * time) / rate),
        velocity_rad_s=0.5 * top * (1.0 - np.cos(rate * time)),
        acceleration_rad_s2=0.5 * top * rate * np.sin(rate * time),
    )


@pytest.mark.parametrize(("gauge", "damping"), [(1.0, 0.03), (1.01, 0.3)])
def test_a_resonance_passes_ripple_as_its_equation_of_motion(gauge, damping, make_motion):
    motion = sweep(make_motion, 400.0)
    motion = replace(motion, gauge_factor=gauge)
    natural, rate = 2.0 * math.pi * 80.0, math.pi / 2.0

    def angle(t: float) -> float:
        return 200.0 * (t - math.sin(rate * t) / rate)

    def slope(t: float, x: Array) -> list[complex]:
        # cosine and sine are the two parts of one number, orders 2 and 4
        twice = cmath.exp(2j * gauge * angle(t))
        second, fourth, *speeds = x.tolist()
        pulls = (
            natural**2 * (force - twist) - 2 * damping * natural * speed
            for force, twist, speed in zip((twice, twice**2), (second, fourth), speeds, strict=True)
        )
        return [*speeds, *pulls]

    begin = np.array([1.0, 1.0, 0.0, 0.0], dtype=complex)
    orders = solve_ivp(
        slope, (0.0, 3.999), begin, t_eval=motion.time_s, method="DOP853", rtol=1e-6, atol=1e-6
    ).y[:2]
    want = np.stack([part for order in orders for part in (order.real, order.imag)])
    got = column("torsional-resonance", motion, resonance_hz=80.0, damping=damping).T
    assert np.abs(want[0]).max() > (1.6 if damping == 0.3 else 7.0)
    # the phase bends inside a sample by 4 * 314 rad/s^2 * (1 ms)^2 / 8, which the resonance sums up
    np.testing.assert_allclose(got, want, rtol=0, atol=1.5e-3 * np.abs(want).max())


def twisting(motion: Motion, cubic: float, stiffness: float, load: Callable[..., Any]) -> Array:
    """Return what gauges on a spring read, the load turning on it behind a standing motor."""
    loss = 2 * 0.03 * math.sqrt(stiffness * J)

    def spring(twist: Any, speed: Any) -> Any:
        return stiffness * twist + cubic * twist**3 + loss * speed

    def slope(t: float, x: Array) -> list[float]:
        return [x[1], (load(t) - spring(x[0], x[1])) / J]

    start = [load(0.0) / stiffness, 0.0]
    end = float(motion.time_s[-1])
    found = solve_ivp(
        slope, (0.0, end), start, t_eval=motion.time_s, method="DOP853", rtol=1e-8, atol=1e-12
    ).y
    return np.asarray(stiffness * found[0])


def standing(make: Make, n: int, load: Callable[..., Any]) -> Motion:
    """Return a load that changes on a standing motor."""
    time = np.arange(n) * 1e-3
    return make(n, time_s=time, load_torque_nm=load(time), acceleration_rad_s2=np.zeros(n))


def test_a_stiffening_spring_adds_what_its_equation_of_motion_says(make_motion):
    def load(t: Any) -> Any:
        return 6.0 * (1 - np.cos(2 * math.pi * 11.0 * t)) * np.sin(2 * math.pi * 3.0 * t)

    motion = standing(make_motion, 800, load)
    stiffness, s = 1.6e4, 0.02
    got = column("cubic-stiffness", motion)
    linear = twisting(motion, 0.0, stiffness, load)
    # s times 10 N m more at the twist of 10 N m
    bent = twisting(motion, s * 10.0 / (10.0 / stiffness) ** 3, stiffness, load)
    want = (bent - linear) / s
    assert np.abs(want).max() > 10.0
    # to first order in s: the next one is 3 s (12 / 10)^2 of it
    np.testing.assert_allclose(got[:, 0], want, rtol=0, atol=0.1 * np.abs(want).max())


def test_two_knees_of_a_spring_are_torque_beyond_them(make_motion):
    once, twice = (
        standing(make_motion, 2000, lambda t, top=top: top * np.sin(2 * math.pi * 2.0 * t))
        for top in (20.0, 40.0)
    )
    load = once.load_torque_nm
    got = column("piecewise-stiffness", once, knee_nm=4.0, knee_ratio=3.4)
    # far below the resonance the gauges miss what is beyond 4 and 13.6 N m
    for place, knee in ((0, 4.0), (1, 13.6)):
        beyond = np.sign(load) * np.maximum(np.abs(load) - knee, 0.0)
        # a knee rings by its change of slope, 251 N m/s at most, over 960 rad/s; what
        # rings from the start at rest is gone to 1e-6 after half a second
        late = slice(500, None)
        np.testing.assert_allclose(got[late, place], -beyond[late], rtol=0, atol=0.26)
    both = column("piecewise-stiffness", twice, knee_nm=8.0, knee_ratio=3.4)
    np.testing.assert_allclose(both, 2.0 * got, rtol=0, atol=1e-9)


@pytest.mark.parametrize("delay", [0.0, 0.0031, -0.0004, 0.00005])
def test_a_skew_is_the_signal_at_another_time(delay, make_motion):
    time = np.arange(3000) * 1e-3
    rate = 2 * math.pi * np.array([3.0, 40.0, 160.0])
    phases = np.array([0.3, 1.0, 2.0])

    def signal(at: Array) -> Array:
        return np.asarray(np.sin(np.outer(at, rate) + phases).sum(axis=1))

    motion = make_motion(3000, time_s=time, simulated_nm=signal(time))
    got = column("time-skew", motion, delay_s=delay)[:, 0]
    if delay:
        want = (signal(time - delay) - signal(time)) / delay
    else:
        want = -(np.cos(np.outer(time, rate) + phases) * rate).sum(axis=1)
    # a spline of degree 5 is 1e-3 of the fastest part off, as far as the delay turns it
    np.testing.assert_allclose(got[30:-30], want[30:-30], rtol=0, atol=1e-3 * rate[2])


def test_without_a_simulated_torque_a_skew_acts_on_the_load(make_motion):
    time = np.arange(2000) * 1e-3
    load = np.sin(20.0 * time)
    slow = make_motion(2000, time_s=time, load_torque_nm=load, inertia_nm_s2=0.0)
    got = column("time-skew", slow, delay_s=0.0)[:, 0]
    # a shift by 1e-7 s: half of it times the curvature of 400 N m/s^2
    np.testing.assert_allclose(got[20:-20], -20.0 * np.cos(20.0 * time)[20:-20], rtol=0, atol=3e-5)


def test_a_skew_is_formed_on_either_side_of_a_gap_alone(make_motion):
    time = np.arange(3000) * 1e-3
    valid = np.ones(3000, dtype=bool)
    valid[1400:1500] = False
    signal = np.sin(30.0 * time)
    motion = make_motion(3000, time_s=time, simulated_nm=signal, valid=valid)
    got = column("time-skew", motion, delay_s=0.002)[:, 0]
    assert np.isnan(got[1400:1500]).all()
    want = (np.sin(30.0 * (time - 0.002)) - signal) / 0.002
    # held for the two samples whose past lies in the gap
    inside = valid & (np.abs(np.arange(3000) - 1450) > 60) & (np.arange(3000) > 10)
    np.testing.assert_allclose(got[inside], want[inside], rtol=0, atol=1e-3)


REMEMBER: dict[str, dict[str, float]] = {
    "presliding": {"breakaway_rad": 0.3},
    "creep": {"time_constant_s": 2.0},
    "torsional-resonance": {"resonance_hz": 120.0, "damping": 0.05},
    "cubic-stiffness": {},
    "piecewise-stiffness": {"knee_nm": 3.0, "knee_ratio": 2.0},
    "hysteresis": {"yield_nm": 3.0},
}


@pytest.mark.parametrize("name", REMEMBER)
def test_lost_samples_are_as_if_they_had_never_been(name, swinging):
    lost = np.zeros(3000, dtype=bool)
    lost[[0, 17, 18, 19, 2999]] = True
    lost[1000:1400] = True
    broken = without(swinging, lost)
    got = column(name, broken, **REMEMBER[name])
    assert np.isnan(got[lost]).all()
    want = column(name, kept(swinging, ~lost), **REMEMBER[name])
    np.testing.assert_allclose(got[~lost], want, rtol=0, atol=1e-12 * np.abs(want).max())


@pytest.mark.parametrize("name", REMEMBER)
def test_nothing_is_carried_over_a_start(name, swinging):
    starts = np.zeros(3000, dtype=bool)
    starts[1234] = True
    got = column(name, replace(swinging, starts=starts), **REMEMBER[name])
    first = column(name, kept(swinging, np.arange(3000) < 1234), **REMEMBER[name])
    second = column(name, kept(swinging, np.arange(3000) >= 1234), **REMEMBER[name])
    want = np.vstack([first, second])
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-12 * np.abs(want).max())


def test_a_resonance_of_even_steps_is_that_of_uneven_ones():
    starts = np.zeros(20_001, dtype=bool)
    starts[[0, 1, 200, 9000, 20_000]] = True
    rng = np.random.default_rng(9)
    pole = 2.0 * np.pi * 30.0 * complex(-0.02, 1.0)
    phase = np.cumsum(0.2 + 0.01 * rng.standard_normal(len(starts)))
    rate = np.diff(phase, prepend=phase[:1]) / 1e-3
    one = np.exp(pole * np.full(1, 1e-3))
    many = np.repeat(one, len(starts))
    even, uneven = (
        _memory.resonance(np.exp(1j * phase), rate, decay, starts, pole) for decay in (one, many)
    )
    assert np.abs(even - uneven).max() < 1e-11 * np.abs(even).max()


def test_an_even_low_pass_gives_what_one_of_uneven_steps_gives(monkeypatch):
    time = np.arange(20_001) * 1e-3
    starts = np.zeros(len(time), dtype=bool)
    starts[[0, 200, 9000]] = True
    torque = 3.0 + np.cumsum(np.random.default_rng(8).standard_normal(len(time)))
    even = dynamics.low_pass(time, starts, 2.0 * np.pi * 150.0)(torque)
    monkeypatch.setattr(dynamics, "even_step", lambda *_: None)
    plain = dynamics.low_pass(time, starts, 2.0 * np.pi * 150.0)(torque)
    assert np.abs(even - plain).max() < 1e-9 * np.abs(plain).max()
    np.testing.assert_allclose(even[starts], torque[starts], rtol=1e-9)


def corners(cause: Cause, motion: Motion) -> list[dict[str, float]]:
    ends = [[x for band in bands for x in band] for bands in shape_bounds(cause, motion).values()]
    names = [p.name for p in cause.shape]
    return [dict(zip(names, point, strict=True)) for point in product(*ends)]


@pytest.mark.parametrize("name", catalogue())
def test_columns_are_finite_wherever_a_search_may_go(name, swinging):
    cause = catalogue()[name]
    for shape in corners(cause, swinging):
        assert np.isfinite(cause.columns(swinging, shape)).all()


def readings(make: Make) -> Motion:
    """Return 8 experiments of 11 readings: locked at 4 angles, loaded both ways, up and down."""
    steps = np.array([0, 8, 16, 24, 32, 40, 32, 24, 16, 8, 0.0])
    sign = np.tile([1.0, -1.0], 4)
    position = np.repeat(np.arange(4) * math.pi / 2, 22)
    starts = np.zeros(88, dtype=bool)
    starts[::11] = True
    return make(
        88,
        time_s=30.0 * np.arange(88),
        velocity_rad_s=np.zeros(88),
        acceleration_rad_s2=np.zeros(88),
        angle_rad=100.0 * position,
        output_angle_rad=position,
        load_torque_nm=np.concatenate([s * steps for s in sign]),
        starts=starts,
        motor_current_a=None,
        temperature_c=None,
    )


STATIC = {
    "position-dependent-gain", "gain-error", "cubic-nonlinearity", "hysteresis", "backlash",
    "saturation", "arm-sag", "side-force", "direction-asymmetry", "zero-step", "zero-drift",
    "warm-up", "creep",
}  # fmt: skip


def test_readings_under_locked_load_show_every_static_cause(make_motion):
    motion = readings(make_motion)
    shown = {n for n, c in catalogue().items() if c.applicable(motion) is None}
    assert shown >= STATIC
    assert not shown & {"coulomb-friction", "viscous-friction", "presliding", "time-skew"}
    for name in shown:
        cause = catalogue()[name]
        for shape in corners(cause, motion):
            assert np.isfinite(cause.columns(motion, shape)).all()


def test_the_gain_of_a_loop_in_readings_is_the_baselines(make_motion):
    motion = readings(make_motion)
    got = column("hysteresis", replace(motion, angle_source="position_rad"), yield_nm=20.0)
    assert got[:, 0].any()
    assert not got[:, 1].any()


def test_a_locked_arm_sags_by_the_square_of_its_load(make_motion):
    motion = readings(make_motion)
    load = motion.load_torque_nm
    assert load is not None
    got = column("arm-sag", motion)
    # F L cos(p + F L / k) with the small angle p below level, of its own for each direction
    k, p_cw, p_ccw = 1.2e4, 0.03, -0.01
    p = np.where(load > 0, p_cw, p_ccw)
    lost = load * np.cos(p + np.abs(load) / k) - load * np.cos(p)
    fit, *_ = np.linalg.lstsq(got, lost, rcond=None)
    # what is left is the cube: 40^3 / (2 k^2)
    assert np.abs(lost - got @ fit).max() < 1.01 * 40.0**3 / (2 * k * k)
    assert np.abs(lost).max() > 10 * 40.0**3 / (2 * k * k)


SPARSE: list[dict[str, Any]] = [
    {},
    {"load_torque_nm": None},
    {"load_torque_nm": "lost"},
    {"motor_current_a": "lost", "temperature_c": None},
    {"starts": "all"},
    {"velocity_rad_s": "none", "inertia_nm_s2": 0.0},
]


@pytest.mark.parametrize("valid", ["1", "0", "11", "0000000", "1000100", "1111111"])
@pytest.mark.parametrize("change", SPARSE, ids=str)
def test_a_record_of_next_to_nothing_is_no_error(change, valid, make_motion):
    n = len(valid)
    arrays = {"lost": np.full(n, np.nan), "none": np.zeros(n), "all": np.ones(n, dtype=bool)}
    filled = {k: arrays[v] if isinstance(v, str) else v for k, v in change.items()}
    seen = np.array([c == "1" for c in valid])
    motion = without(make_motion(n, **filled), ~seen)
    for name, cause in catalogue().items():
        reason = cause.applicable(motion)
        assert reason is None or reason
        for bands in shape_bounds(cause, motion).values():
            assert all(low < high for low, high in bands)
        shape = {p.name: (p.bands or ((p.lower, p.upper),))[0][0] for p in cause.shape}
        columns = cause.columns(motion, shape)
        assert columns.shape == (n, len(cause.linear))
        if not filled.keys() & {"load_torque_nm", *cause.channels}:
            assert np.isfinite(columns[seen]).all(), name
