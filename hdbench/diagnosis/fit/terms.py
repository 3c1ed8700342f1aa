"""One cause with its shape as it stands in a fit, and its slopes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from hdbench.diagnosis.measured.record import Record
from hdbench.model import Cause, shape_bounds
from hdbench.records.trace import FloatArray

__all__ = [
    "Term",
    "fresh_columns",
    "harmonics",
    "moved_term",
    "smooth_shapes",
    "tangent_columns",
    "term_columns",
]

# relative change of a signature by which its slope over a shape parameter is formed
_SLOPE = 1e-4
# counting steps of an encoder make the noise of the acceleration slow and far from normal: nearer
# than this many standard deviations to it, noise still shows as an inertia of minus the load's
_ABOVE_NOISE = 10.0
# a shape parameter may move by this share of its value in one step
_STRIDE = 0.3


@dataclass(frozen=True, slots=True)
class Term:
    """A cause with its shape, as it stands in a fit.

    Parameters
    ----------
    cause : Cause
        Cause, of the catalogue or a line without a name.
    shape : mapping of str to float
        Shape parameters.
    known : bool
        True where the model that was handed in already held it.
    form : bool
        True for a part of the cause of the same name before it: the same at another shape.
    """

    cause: Cause
    shape: Mapping[str, float]
    known: bool = False
    form: bool = False


def term_columns(term: Term, record: Record) -> FloatArray:
    """Return the columns of a term on a record.

    What follows the acceleration counts only where that stands out of its own noise: the expected
    torque is made of the same samples, so that noise alone looks like an inertia of minus the
    load's.

    Parameters
    ----------
    term : Term
        Term.
    record : Record
        Record.

    Returns
    -------
    ndarray, shape (n, n_linear)
        N m per unit of each linear parameter; zero where not valid. Not writeable: the record keeps
        the columns that were asked for last.
    """
    return record.kept.columns(term.cause, term.shape, lambda: fresh_columns(term, record))


def fresh_columns(term: Term, record: Record) -> FloatArray:
    """Return the same, formed anew and not kept: for one of many shapes that are seen once.

    Parameters
    ----------
    term : Term
        Term.
    record : Record
        Record.

    Returns
    -------
    ndarray, shape (n, n_linear)
        As `term_columns` gives them, writeable.
    """
    motion, seen = record.motion, record.valid
    if term.cause.locked_to == "acceleration":
        floor = _ABOVE_NOISE * motion.acceleration_noise_rad_s2
        seen = seen & (np.abs(motion.acceleration_rad_s2) > floor)
    columns = term.cause.columns(motion, term.shape)
    return np.where(seen[:, None], columns, 0.0)


def harmonics(cause: Cause) -> list[list[int]]:
    """Return the columns of each harmonic: parameters whose names hold its number.

    Parameters
    ----------
    cause : Cause
        Cause.

    Returns
    -------
    list of list of int
        Empty for a cause whose parameters are not all cosines and sines of numbered harmonics.
    """
    found: dict[str, list[int]] = {}
    for place, parameter in enumerate(cause.linear):
        pieces = parameter.name.split("_")
        number = pieces[1] if len(pieces) > 1 else ""
        if pieces[0] not in ("cosine", "sine") or not number.replace(".", "").isdigit():
            return []
        found.setdefault(number, []).append(place)
    return list(found.values())


def smooth_shapes(term: Term) -> tuple[str, ...]:
    """Return the shape parameters that have a slope: a step in time and a held form have none.

    Parameters
    ----------
    term : Term
        Term.

    Returns
    -------
    tuple of str
    """
    if term.form:
        return ()
    return tuple(p.name for p in term.cause.shape if p.name != "step_time_s")


def tangent_columns(
    term: Term, linear: FloatArray, columns: FloatArray, record: Record
) -> FloatArray:
    """Return the slope of a term's torque over its smooth shape parameters.

    Parameters
    ----------
    term : Term
        Term.
    linear : ndarray, shape (n_linear,)
        Its linear parameters.
    columns : ndarray, shape (n, n_linear)
        Its columns at `term.shape`.
    record : Record
        Record.

    Returns
    -------
    ndarray, shape (n, n_smooth)
        N m per unit of each smooth shape parameter, by a one-sided difference so small that the
        torque changes by 1e-4 of itself.
    """
    torque = columns @ linear
    size = float(np.sqrt(torque @ torque))
    slopes = []
    for name in smooth_shapes(term):
        value = term.shape[name]
        step = 1e-7 * max(abs(value), 1e-3)
        moved = replace(term, shape={**term.shape, name: value + step})
        change = term_columns(moved, record) @ linear - torque
        ratio = float(np.sqrt(change @ change)) / size if size > 0.0 else 0.0
        if 0.0 < ratio < 0.1 * _SLOPE:
            step *= min(_SLOPE / ratio, 1e5)
            moved = replace(term, shape={**term.shape, name: value + step})
            change = term_columns(moved, record) @ linear - torque
        slopes.append(change / step)
    return np.column_stack(slopes) if slopes else np.zeros((len(torque), 0))


def moved_term(term: Term, moves: Mapping[str, float], record: Record) -> Term:
    """Return the term with its shape moved, cut to its bands and to a stride.

    Parameters
    ----------
    term : Term
        Term.
    moves : mapping of str to float
        Change of each shape parameter, its own unit.
    record : Record
        Record; its motion bounds the shapes.

    Returns
    -------
    Term
    """
    motion, on_output = record.motion, term.cause.locked_to == "output"
    bounds = shape_bounds(term.cause, motion)
    shape = dict(term.shape)
    for name, move in moves.items():
        value = shape[name]
        limit = _STRIDE * abs(value)
        if name == "order":
            turned = motion.output_angle_rad if on_output else motion.angle_rad
            limit = np.pi / max(float(np.ptp(turned[record.valid])), 1e-9)
        elif name == "frequency_hz":
            limit = 0.5 / float(np.ptp(motion.time_s[record.valid]))
        target = value + float(np.clip(move, -limit, limit))
        bands = bounds.get(name) or ((value, value),)
        inside = [float(np.clip(target, low, high)) for low, high in bands]
        shape[name] = min(inside, key=lambda x: abs(x - target))
    return replace(term, shape=shape)
