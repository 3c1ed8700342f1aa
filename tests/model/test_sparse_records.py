from __future__ import annotations

import math
from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import pytest

from hdbench.model import Cause, Motion, catalogue, shape_bounds

Make = Callable[..., Motion]
Array = np.ndarray
J = 1.725e-2


def column(name: str, motion: Motion, **shape: float) -> Array:
    return catalogue()[name].columns(motion, shape)


def without(motion: Motion, lost: Array) -> Motion:
    """Return the motion with lost samples: no speed, no angle, not valid."""
    gone = {"velocity_rad_s", "angle_rad", "acceleration_rad_s2", "output_angle_rad"}
    parts = {f: getattr(motion, f) for f in motion.__slots__}
    changed = {f: np.where(lost, np.nan, parts[f]) for f in gone}
    return Motion(**{**parts, **changed, "valid": ~lost})


def corners(cause: Cause, motion: Motion) -> list[dict[str, float]]:
    ends = [[x for band in bands for x in band] for bands in shape_bounds(cause, motion).values()]
    names = [p.name for p in cause.shape]
    return [dict(zip(names, point, strict=True)) for point in product(*ends)]


@pytest.mark.parametrize("name", catalogue())
def test_columns_are_finite_wherever_a_search_may_go(name: str, swinging: Motion) -> None:
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


def test_readings_under_locked_load_show_every_static_cause(make_motion: Make) -> None:
    motion = readings(make_motion)
    shown = {n for n, c in catalogue().items() if c.applicable(motion) is None}
    assert shown >= STATIC
    assert not shown & {"coulomb-friction", "viscous-friction", "presliding", "time-skew"}
    for name in shown:
        cause = catalogue()[name]
        for shape in corners(cause, motion):
            assert np.isfinite(cause.columns(motion, shape)).all()


def test_the_gain_of_a_loop_in_readings_is_the_baselines(make_motion: Make) -> None:
    motion = readings(make_motion)
    parts = {f: getattr(motion, f) for f in motion.__slots__}
    got = column("hysteresis", Motion(**{**parts, "angle_source": "position_rad"}), yield_nm=20.0)
    assert got[:, 0].any()
    assert not got[:, 1].any()


def test_a_locked_arm_sags_by_the_square_of_its_load(make_motion: Make) -> None:
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


def test_side_force_and_direction_asymmetry_span_the_same_space(make_motion: Make) -> None:
    motion = readings(make_motion)
    side, both = column("side-force", motion), column("direction-asymmetry", motion)
    np.testing.assert_allclose(10.0 * side, both, rtol=1e-15)


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
def test_a_record_of_next_to_nothing_is_no_error(
    change: dict[str, Any], valid: str, make_motion: Make
) -> None:
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
