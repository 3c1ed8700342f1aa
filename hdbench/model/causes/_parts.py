"""Columns, parameters and conditions that several causes share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from hdbench.model.definition import Parameter, always, unbounded
from hdbench.model.motion import Motion, turns_of
from hdbench.records.trace import FloatArray

# below this the motor counts as standing: three ADC steps of a tacho with 562 rad/s full range
STANDING_RAD_S = 0.5
# an acceleration that never leaves its own noise by this much cannot carry a torque: the largest
# of a million normal samples lies near 5 standard deviations
_ABOVE_NOISE = 6.0
# noise of the acceleration is in the expected torque, hence with a minus in the residual: it looks
# like a gain of minus its share of the mean square, 1 % here
_RMS_ABOVE_NOISE = 10.0
# a tenth of this expected torque is 50 mN m, the noise of one sample on the bench of the report:
# below it no share of the torque that any drive has can be seen
_INERTIAL_NM = 0.5

Applicable = Callable[[Motion], str | None]


def all_of(*conditions: Applicable) -> Applicable:
    """Return the condition whose reason is the first one that any of `conditions` gives."""

    def check(motion: Motion) -> str | None:
        return next((reason for c in conditions if (reason := c(motion)) is not None), None)

    return check


def _covers(what: str, angle_rad: Callable[[Motion], FloatArray], needed: float) -> Applicable:
    def check(motion: Motion) -> str | None:
        turns = turns_of(angle_rad(motion), motion)
        if turns >= needed:
            return None
        return f"the {what} covers {turns:.3g} turns; needed: {needed:.3g}"

    return check


def motor_turns(needed: float) -> Applicable:
    """Return the condition that the wave generator covers `needed` turns."""
    return _covers("wave generator", lambda motion: motion.angle_rad, needed)


def output_turns(needed: float) -> Applicable:
    """Return the condition that the output covers `needed` turns."""
    return _covers("output", lambda motion: motion.output_angle_rad, needed)


def has_load(motion: Motion) -> str | None:
    """Return why a cause that needs a known load torque does not apply, or None."""
    if motion.load_torque_nm is None:
        return "the record has no load_torque_nm; needed: a known load on the output, N m"
    if not largest_size(motion.load_torque_nm, motion) > 0.0:
        return "load_torque_nm is zero throughout; needed: a load on the output, N m"
    return None


def moves_and_reverses(motion: Motion) -> str | None:
    """Return why dry friction cannot be told from the zero here, or None."""
    velocity = motion.velocity_rad_s[motion.valid]
    states = (velocity > STANDING_RAD_S, velocity < -STANDING_RAD_S)
    standing = ~(states[0] | states[1])
    seen = sum(bool(state.any()) for state in (*states, standing))
    if seen >= 2:
        return None
    return (
        f"the motor keeps one direction (or stands) throughout, within {STANDING_RAD_S} rad/s; "
        "needed: a reversal, or rest and motion"
    )


def reverses(motion: Motion) -> str | None:
    """Return why nothing can differ between the directions here, or None."""
    velocity = motion.velocity_rad_s[motion.valid]
    if bool((velocity > STANDING_RAD_S).any()) and bool((velocity < -STANDING_RAD_S).any()):
        return None
    return "the motor turns in one direction alone; needed: a reversal"


def accelerates(motion: Motion) -> str | None:
    """Return why the acceleration carries no torque that could be told from its noise, or None."""
    largest = largest_size(motion.acceleration_rad_s2, motion)
    if largest > _ABOVE_NOISE * motion.acceleration_noise_rad_s2:
        return None
    return (
        f"the acceleration stays within {largest:.3g} rad/s^2 at a noise of "
        f"{motion.acceleration_noise_rad_s2:.3g} rad/s^2; needed: a speed that changes faster"
    )


def known_torque(motion: Motion) -> str | None:
    """Return why no torque through the flexspline is known here, or None."""
    reason = has_load(motion)
    acceleration = motion.acceleration_rad_s2[motion.valid]
    size = float(np.sqrt(np.mean(acceleration**2))) if len(acceleration) else 0.0
    moved = size > _RMS_ABOVE_NOISE * motion.acceleration_noise_rad_s2
    if reason is None or (motion.inertia_nm_s2 > 0.0 and moved):
        return None
    return f"{reason}, or a speed that changes faster"


def loaded(motion: Motion) -> str | None:
    """Return why the torque through the flexspline is too small for a share of it, or None."""
    reason = has_load(motion)
    inertial = motion.inertia_nm_s2 * largest_size(motion.acceleration_rad_s2, motion)
    if reason is None or inertial >= _INERTIAL_NM:
        return None
    return f"{reason}, or an expected torque of {_INERTIAL_NM:g} N m"


def known_applied_nm(motion: Motion) -> FloatArray:
    """Return the torque through the flexspline at the samples where it is known."""
    applied = motion.applied_nm
    return applied[motion.valid & np.isfinite(applied)]


def both_signs(motion: Motion) -> str | None:
    """Return why a cause that needs torque of both signs does not apply, or None."""
    torque = known_applied_nm(motion)
    low, high = (float(torque.min()), float(torque.max())) if len(torque) else (0.0, 0.0)
    # a hundredth of the largest torque: less of the other sign is noise of the torque itself
    least = 0.01 * max(high, -low)
    if low < -least and high > least:
        return None
    return f"the torque lies between {low:.3g} and {high:.3g} N m; needed: both signs"


def torque_turns(motion: Motion) -> str | None:
    """Return why the torque does not go up and down far enough for a loop, or None."""
    torque = known_applied_nm(motion)
    span = float(np.ptp(torque)) if len(torque) else 0.0
    rise = float((torque - np.minimum.accumulate(torque)).max()) if len(torque) else 0.0
    fall = float((np.maximum.accumulate(torque) - torque).max()) if len(torque) else 0.0
    # a fifth of the range: a smaller way back shows no second branch of a loop
    if span > 0.0 and min(rise, fall) >= 0.2 * span:
        return None
    return (
        f"the torque rises by {rise:.3g} N m and falls by {fall:.3g} N m; needed: both by a fifth "
        "of its range, that is loading and unloading"
    )


def speed_varies(motion: Motion) -> str | None:
    """Return why what follows the speed cannot be told from the zero, or None."""
    return _varies(motion.velocity_rad_s[motion.valid])


def size_of_speed_varies(motion: Motion) -> str | None:
    """Return why what follows the size of the speed cannot be told from the zero, or None."""
    return _varies(np.abs(motion.velocity_rad_s[motion.valid]))


def _varies(speed: FloatArray) -> str | None:
    """Return why a speed counts as constant, or None."""
    low, high = np.percentile(speed, (1.0, 99.0)) if len(speed) else (0.0, 0.0)
    spread, largest = float(high - low), float(max(abs(low), abs(high)))
    # 5 % of the speed: below it the torque of viscous friction is a constant, that is a zero
    if spread > 0.05 * largest and spread > 0.0:
        return None
    return (
        f"the speed varies by {spread:.3g} rad/s of {largest:.3g} rad/s; needed: more than 5 % to "
        "tell it from the zero"
    )


def lasts(needed_s: float) -> Applicable:
    """Return the condition that the record lasts `needed_s`."""

    def check(motion: Motion) -> str | None:
        span = float(motion.time_s[-1] - motion.time_s[0])
        if span >= needed_s:
            return None
        return f"the record lasts {span:.3g} s; needed: {needed_s:g} s"

    return check


def largest_size(values: FloatArray, motion: Motion) -> float:
    """Return the largest magnitude over the valid samples, 0 where there is none."""
    known = np.abs(values[motion.valid & np.isfinite(values)])
    return float(known.max()) if len(known) else 0.0


Shape = Mapping[str, float]
Columns = Callable[[Motion, Shape], FloatArray]


@dataclass(frozen=True, slots=True)
class Computed:
    """The functions of a cause, as `Cause` has them, and the bands of its first shape parameter."""

    columns: Columns
    applicable: Applicable = always
    reach: Callable[[Motion], Mapping[str, tuple[float, float]]] = unbounded
    change_motion: Callable[[Motion, Shape], Motion] | None = None
    possible: Callable[[Motion, Shape], FloatArray] | None = None
    bands: tuple[tuple[float, float], ...] = ()


# far outside of what any bench with this kind of gear carries: bounds data errors, not physics
TORQUE_LIMIT_NM = 1000.0
# a share of a known torque: ten times all of it bounds data errors, not physics
RATIO_LIMIT = 10.0
# amplitudes that grow with speed or load are stated at these, so that all stand in N m
REFERENCE_SPEED_RAD_S = 100.0
REFERENCE_LOAD_NM = 10.0


def pair(phase_rad: FloatArray, envelope: FloatArray | float = 1.0) -> FloatArray:
    """Return envelope times cosine and sine of `phase_rad`, shape (n_samples, 2)."""
    return np.column_stack((envelope * np.cos(phase_rad), envelope * np.sin(phase_rad)))


def single(column: FloatArray) -> FloatArray:
    """Return one column as an array of shape (n_samples, 1)."""
    return column[:, None]


def torque_parameter(name: str, description: str) -> Parameter:
    """Return a linear parameter in N m."""
    return Parameter(name, "N m", -TORQUE_LIMIT_NM, TORQUE_LIMIT_NM, description)


def pair_parameters(what: str, tag: str = "") -> tuple[Parameter, Parameter]:
    """Return the parameters ``cosine<tag>_nm`` and ``sine<tag>_nm``."""
    return (
        torque_parameter(f"cosine{tag}_nm", f"cosine part of {what}"),
        torque_parameter(f"sine{tag}_nm", f"sine part of {what}"),
    )


def ratio_parameter(name: str, description: str) -> Parameter:
    """Return a linear parameter without unit."""
    return Parameter(name, "1", -RATIO_LIMIT, RATIO_LIMIT, description)


# rolling elements slip, and no angle is exact: an order this near to a whole one is a whole one
WHOLE = 0.02

Bands = tuple[tuple[float, float], ...]


def whole_orders(lower: int, upper: int, *, without: tuple[int, ...] = ()) -> Bands:
    """Return the orders of what is counted: poles, slots, teeth."""
    orders = [order for order in range(lower, upper + 1) if order not in without]
    return tuple((order - WHOLE, order + WHOLE) for order in orders)


def broken_orders(lower: float, upper: int) -> Bands:
    """Return the orders of what rolls: no whole number."""
    ends = [lower, *(n + side for n in range(1, upper) for side in (-WHOLE, WHOLE)), upper - WHOLE]
    return tuple(zip(ends[::2], ends[1::2], strict=True))


def lobe_angle(motion: Motion) -> FloatArray:
    """Return the phase of the ripple of the wave generator's two lobes, 2 G theta_m, rad."""
    return np.asarray(2.0 * motion.gauge_factor * motion.angle_rad)


def no_column(motion: Motion, _: Shape) -> FloatArray:
    """Return the columns of a cause that adds no torque, shape (n_samples, 0)."""
    return np.zeros((len(motion), 0))
