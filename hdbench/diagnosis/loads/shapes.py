"""Shapes of causes on standing readings: where they can lie, and their columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.loads.table import LoadTable
from hdbench.model import Cause, Parameter, shape_bounds
from hdbench.records.trace import FloatArray

__all__ = ["DISCRETE", "HELD", "columns_of", "shape_axis", "shape_limits", "with_simulated"]

# shape parameters that have values but no slope
DISCRETE = ("step_time_s", "reading")
# shape parameters that are held at the value that makes the share of the effect 1
HELD = ("limit_nm", "play_nm")
# bounds further apart than this ratio are stepped in equal ratios
_WIDE = 5.0


def with_simulated(table: LoadTable, simulated_nm: FloatArray) -> LoadTable:
    """Return the readings with the torque of a fit, for causes that act on the whole signal.

    Parameters
    ----------
    table : LoadTable
        Readings.
    simulated_nm : ndarray, shape (n_readings,)
        Torque in the channel, N m.

    Returns
    -------
    LoadTable
    """
    return replace(table, motion=replace(table.motion, simulated_nm=simulated_nm))


def columns_of(term: Term, table: LoadTable) -> FloatArray:
    """Return the columns of a term.

    Parameters
    ----------
    term : Term
        Term.
    table : LoadTable
        Readings.

    Returns
    -------
    ndarray, shape (n_readings, n_linear)
        N m per unit of each linear parameter.
    """
    return np.asarray(term.cause.columns(table.motion, term.shape), dtype=np.float64)


def shape_limits(
    cause: Cause, table: LoadTable, parameter: Parameter
) -> tuple[tuple[float, float], ...]:
    """Return the bands of one shape parameter on these readings.

    Torques go no further than twice the largest one, times no further than ten times the record:
    beyond, nothing of the shape is left to see. A limit is looked for up to 30 times the torque.

    Parameters
    ----------
    cause : Cause
        Cause.
    table : LoadTable
        Readings.
    parameter : Parameter
        One of its shape parameters.

    Returns
    -------
    tuple of (float, float)
        Ends of each band, unit of the parameter.
    """
    bands = shape_bounds(cause, table.motion)[parameter.name]
    top = float(np.abs(table.torque_nm).max())
    span = float(np.ptp(table.motion.time_s))
    least, most = {"N m": (0.0, 2.0 * top), "s": (0.0, 10.0 * span)}.get(
        parameter.unit, (-np.inf, np.inf)
    )
    if parameter.name == "step_time_s":
        least, most = -np.inf, np.inf
    if parameter.name == "limit_nm":
        least, most = 0.5 * top, 30.0 * top
    return tuple(
        (max(low, least), min(high, most)) for low, high in bands if max(low, least) < most
    )


def shape_axis(cause: Cause, table: LoadTable, parameter: Parameter, points: int) -> FloatArray:
    """Return the values of a shape parameter at which a cause is looked for.

    Parameters
    ----------
    cause : Cause
        Cause.
    table : LoadTable
        Readings.
    parameter : Parameter
        One of its shape parameters.
    points : int
        Values in each band of a parameter that has a slope.

    Returns
    -------
    ndarray, shape (n_values,)
        Unit of the parameter; every place between two readings for a step, every reading for an
        outlier.
    """
    if parameter.name == "step_time_s":
        time = np.unique(table.motion.time_s)
        return np.asarray(0.5 * (time[1:] + time[:-1]))
    if parameter.name == "reading":
        return np.flatnonzero(table.used).astype(np.float64)
    bands = shape_limits(cause, table, parameter)
    parts = []
    for low, high in bands:
        wide = low > 0.0 and high > _WIDE * low
        parts.append((np.geomspace if wide else np.linspace)(low, high, points))
    return np.concatenate(parts) if parts else np.zeros(0)
