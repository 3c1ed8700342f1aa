"""Baseline of a dynamic run: the terms of the model before any cause is found."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hdbench.model.harmonics import amplitude_phase
from hdbench.model.motion import Motion, gauge_order_factor
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray

# orders of the contract's baseline where the profile says no others, relative to the gauges:
# report, section 4
_GAUGE_ORDERS = (2.0, 4.0)
# orders closer than this are one: no record of this bench tells them apart
_SAME_ORDER = 1e-6


def baseline_orders(profile: ProfileData) -> tuple[float, ...]:
    """Return the motor orders of the baseline.

    Parameters
    ----------
    profile : ProfileData
        Drive, and the ripple of its model.

    Returns
    -------
    tuple of float
        The profile's `model.baseline_orders` (2 and 4 where it has none) and every further ripple
        order of its model, relative to the gauges, times `gauge_order_factor`; increasing, each
        once.
    """
    orders: list[float] = []
    of_ripple = (component.order for component in profile.model.ripple)
    for wanted in (*(profile.model.baseline_orders or _GAUGE_ORDERS), *of_ripple):
        if all(abs(wanted - order) > _SAME_ORDER for order in orders):
            orders.append(wanted)
    factor = gauge_order_factor(profile.drive)
    return tuple(order * factor for order in sorted(orders))


def expected_torque_nm(motion: Motion, inertia_nm_s2: float) -> FloatArray:
    r"""Return the expected torque."""
    return np.asarray(inertia_nm_s2 * motion.acceleration_rad_s2)


def output_turns(motion: Motion) -> float:
    """Return the span of the output angle over the valid samples."""
    angle = motion.output_angle_rad[motion.valid]
    return float(np.ptp(angle)) / (2.0 * math.pi) if len(angle) else 0.0


def baseline_columns(
    motion: Motion, profile: ProfileData, *, load: float = 1.0
) -> tuple[FloatArray, tuple[str, ...], FloatArray]:
    """Return the baseline as a fixed torque and columns with free coefficients.

    Parameters
    ----------
    motion : Motion
        Motion of the record.
    profile : ProfileData
        Load inertia, gear ratio, flexspline and ripple orders.
    load : float
        Coefficient of the measured load torque.

    Returns
    -------
    fixed_nm : ndarray, shape (n_samples,)
        Expected torque with the coefficient J_load/N and, where the motion has one, the measured
        load torque, N m; NaN at lost samples.
    names : tuple of str
        ``zero``, ``ripple:<order>:cosine`` and ``ripple:<order>:sine`` for every order of
        `baseline_orders` (the order as the shortest decimal that gives it back), and
        ``misalignment:cosine`` and ``misalignment:sine`` where the output covers a whole turn.
    columns : ndarray, shape (n_samples, n_names)
        N m per unit of each coefficient, so that each coefficient is in N m.
    """
    drive = profile.drive
    fixed = expected_torque_nm(motion, drive.load_inertia_kg_m2 / drive.gear_ratio)
    if motion.load_torque_nm is not None and load != 0.0:
        fixed = fixed + load * motion.load_torque_nm
    names, columns = ["zero"], [np.ones(len(motion))]
    for order in baseline_orders(profile):
        angle = order * motion.angle_rad
        names += [f"ripple:{order!r}:cosine", f"ripple:{order!r}:sine"]
        columns += [np.cos(angle), np.sin(angle)]
    if output_turns(motion) >= 1.0:
        names += ["misalignment:cosine", "misalignment:sine"]
        columns += [np.cos(motion.output_angle_rad), np.sin(motion.output_angle_rad)]
    return fixed, tuple(names), np.column_stack(columns)


def baseline_numbers(
    names: Sequence[str], coefficients: Sequence[float]
) -> tuple[float | None, tuple[tuple[float, float, float], ...], tuple[float, float]]:
    """Return what the coefficients of a fitted baseline say."""
    values = dict(zip(names, (float(c) for c in coefficients), strict=True))
    if not all(math.isfinite(value) for value in values.values()):
        raise ValueError(f"baseline coefficients must be finite, got {values}")
    pairs: dict[str, tuple[float, float]] = {}
    for name in values:
        stem, _, part = name.rpartition(":")
        if part == "cosine":
            pairs[stem] = amplitude_phase(values[name], values[f"{stem}:sine"])[:2]
        elif part not in ("sine", "zero"):
            raise ValueError(f"unknown baseline term {name!r}")
    ripple = tuple(
        (float(stem.removeprefix("ripple:")), *pair)
        for stem, pair in pairs.items()
        if stem.startswith("ripple:")
    )
    return values.get("zero"), ripple, pairs.get("misalignment", (0.0, 0.0))
