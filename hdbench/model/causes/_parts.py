"""Parts that several causes share: columns, parameters, and the functions of a cause."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from hdbench.model.definition import Parameter, always, unbounded
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

Shape = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Computed:
    """The functions of a cause, as `Cause` has them, and the bands of its first shape parameter."""

    columns: Callable[[Motion, Shape], FloatArray]
    applicable: Callable[[Motion], str | None] = always
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


def no_shape(columns: Callable[[Motion], FloatArray]) -> Callable[..., FloatArray]:
    """Return `columns` in the form of a cause without shape parameters."""

    def with_shape(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        del shape
        return columns(motion)

    return with_shape


def lobe_angle(motion: Motion) -> FloatArray:
    """Return the phase of the ripple of the wave generator's two lobes, 2 G theta_m, rad."""
    return np.asarray(2.0 * motion.gauge_factor * motion.angle_rad)


def no_column(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    """Return the columns of a cause that adds no torque, shape (n_samples, 0)."""
    del shape
    return np.zeros((len(motion), 0))
