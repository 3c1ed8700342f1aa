"""Parts that several causes share: cosine and sine columns, parameters, what a record must hold."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from hdbench.model.definition import Parameter
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

# far outside of what any bench with this kind of gear carries: bounds data errors, not physics
TORQUE_LIMIT_NM = 1000.0
# below this the motor counts as standing: three ADC steps of a tacho with 562 rad/s full range
_STANDING_RAD_S = 0.5

Applicable = Callable[[Motion], str | None]


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


def order_parameter(lower: float, upper: float) -> Parameter:
    """Return the shape parameter ``order``."""
    return Parameter("order", "1", lower, upper, "cycles per revolution of the wave generator")


def no_shape(columns: Callable[[Motion], FloatArray]) -> Callable[..., FloatArray]:
    """Return `columns` in the form of a cause without shape parameters."""

    def with_shape(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        del shape
        return columns(motion)

    return with_shape


def all_of(*conditions: Applicable) -> Applicable:
    """Return the condition whose reason is the first one that any of `conditions` gives."""

    def check(motion: Motion) -> str | None:
        return next((reason for c in conditions if (reason := c(motion)) is not None), None)

    return check


def _turns(angle_rad: FloatArray, motion: Motion) -> float:
    """Return the span of an angle over the valid samples, turns."""
    return float(np.ptp(angle_rad[motion.valid])) / (2.0 * np.pi) if motion.valid.any() else 0.0


def motor_turns(needed: float) -> Applicable:
    """Return the condition that the wave generator covers `needed` turns."""

    def check(motion: Motion) -> str | None:
        turns = _turns(motion.angle_rad, motion)
        if turns >= needed:
            return None
        return f"the wave generator covers {turns:.3g} turns; needed: {needed:.3g}"

    return check


def output_turns(needed: float) -> Applicable:
    """Return the condition that the output covers `needed` turns."""

    def check(motion: Motion) -> str | None:
        turns = _turns(motion.output_angle_rad, motion)
        if turns >= needed:
            return None
        return f"the output covers {turns:.3g} turns; needed: {needed:.3g}"

    return check


def has_load(motion: Motion) -> str | None:
    """Return why a cause that needs a known load torque does not apply, or None."""
    if motion.load_torque_nm is None:
        return "the record has no load_torque_nm; needed: a known load on the output, N m"
    known = motion.load_torque_nm[motion.valid & np.isfinite(motion.load_torque_nm)]
    if len(known) == 0 or not float(np.abs(known).max()) > 0.0:
        return "load_torque_nm is zero throughout; needed: a load on the output, N m"
    return None


def moves_and_reverses(motion: Motion) -> str | None:
    """Return why dry friction cannot be told from the zero here, or None."""
    velocity = motion.velocity_rad_s[motion.valid]
    states = (velocity > _STANDING_RAD_S, velocity < -_STANDING_RAD_S)
    standing = ~(states[0] | states[1])
    seen = sum(bool(state.any()) for state in (*states, standing))
    if seen >= 2:
        return None
    return (
        f"the motor keeps one direction (or stands) throughout, within {_STANDING_RAD_S} rad/s; "
        "needed: a reversal, or rest and motion"
    )
