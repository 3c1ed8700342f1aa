"""Where a curve without a name stands out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.fit.jointfit import JointFit
from hdbench.diagnosis.fit.terms import Term, term_columns
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.naming.curves import CURVE_PREFIX, DIRECTION

__all__ = ["CurvePlace", "curve_place", "is_curve"]


@dataclass(frozen=True, slots=True)
class CurvePlace:
    """Where a curve stands out most.

    Parameters
    ----------
    domain, unit : str
        Domain of the contract, and unit of the place.
    location : float
        Place where the curve is farthest from its mean.
    extent : tuple of float
        Range around it in which it is at least half as far.
    size_nm : float
        How far, N m.
    """

    domain: str
    unit: str
    location: float
    extent: tuple[float, float]
    size_nm: float


def is_curve(term: Term) -> bool:
    """Return whether a term is a curve without a name.

    Parameters
    ----------
    term : Term
        Term.

    Returns
    -------
    bool
    """
    return term.cause.name.startswith(CURVE_PREFIX)


def curve_place(record: Record, fit: JointFit, place: int) -> CurvePlace:
    """Return where a fitted curve stands out most.

    Parameters
    ----------
    record : Record
        Record.
    fit : JointFit
        Joint fit.
    place : int
        Index of the curve in it.

    Returns
    -------
    CurvePlace
        Of curves over the output angle the angle within a turn, rad.
    """
    motion, valid = record.motion, record.valid
    name = fit.terms[place].cause.name.removeprefix(CURVE_PREFIX)
    if name == DIRECTION:
        return _order_place(record, fit, place)
    kind = name.partition(" (")[0]
    turned = np.mod(motion.output_angle_rad, 2.0 * np.pi)
    domain, unit, axis = {
        "velocity": ("velocity", "rad/s", motion.velocity_rad_s),
        "torque": ("torque", "N m", motion.applied_nm),
        "time": ("time", "s", motion.time_s),
    }.get(kind, ("output-order", "rad", turned))
    torque = (term_columns(fit.terms[place], record) @ fit.linear[place])[valid]
    away = np.abs(torque - torque.mean())
    values = axis[valid]
    worst = int(np.argmax(away))
    near = np.abs(values - values[worst]) <= 0.25 * float(np.ptp(values))
    high = values[near & (away >= 0.5 * away[worst])]
    return CurvePlace(
        domain,
        unit,
        float(values[worst]),
        (float(high.min()), float(high.max())),
        float(away[worst]),
    )


def _order_place(record: Record, fit: JointFit, place: int) -> CurvePlace:
    """Return the order of a fitted ripple that changes sign with the direction."""
    order = fit.terms[place].shape["order"]
    turns = float(np.ptp(record.motion.angle_rad[record.valid])) / (2.0 * np.pi)
    half = 0.5 / max(turns, 1e-9)
    size = float(np.hypot(*fit.linear[place]))
    return CurvePlace("motor-order", "1", order, (order - half, order + half), size)
