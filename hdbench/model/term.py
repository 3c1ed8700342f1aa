"""The torque of causes with numbers, and the motion without their faults."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from hdbench.errors import DataError
from hdbench.model.cause import Cause, CauseTerm, check_term
from hdbench.model.causes.kinematic import TRANSMISSION_ERROR, angle_error_rad
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = [
    "signal_motion",
    "summed_torque_nm",
    "term_torque_nm",
    "undone_faults",
    "with_signal",
]

# angle over which the slope of a ripple is formed: 2e-6 off at order 360, the highest of any cause,
# and as much by the rounding of an angle of 1e4 turns
_ANGLE_STEP_RAD = 1e-5


def term_torque_nm(term: CauseTerm, motion: Motion, *, extra: Sequence[Cause] = ()) -> FloatArray:
    """Return the torque of one cause.

    Parameters
    ----------
    term : CauseTerm
        A cause with numbers.
    motion : Motion
        Motion at every sample.
    extra : sequence of Cause
        Causes beside the catalogue.

    Returns
    -------
    ndarray, shape (n_samples,)
        N m.

    Raises
    ------
    DataError
        If the numbers do not fit the cause, the record lacks a channel that it needs, or the
        columns of a user's own cause have another shape.
    """
    cause = check_term(term, where=f"cause {term.name!r}", extra=extra)
    for channel in cause.channels:
        if getattr(motion, channel) is None:
            raise DataError(
                f"the model's cause {cause.name} needs {channel}, which the record does not have",
                where=f"cause {cause.name!r}",
                fix=f"give a record with a column {channel}, or take the cause out of the model",
            )
    linear = np.asarray(term.linear, dtype=np.float64)
    columns = np.asarray(cause.columns(motion, term.shape))
    if columns.shape != (len(motion), len(linear)):
        raise DataError(
            f"the columns of {cause.name} have shape {columns.shape}; needed: "
            f"{(len(motion), len(linear))}, one column for each linear parameter",
            where=f"cause {cause.name!r}",
            fix="mend the function `columns` of this cause",
        )
    return np.asarray(columns @ linear)


def summed_torque_nm(
    terms: Iterable[CauseTerm],
    motion: Motion,
    baseline_nm: Callable[[Motion], FloatArray],
    *,
    extra: Sequence[Cause] = (),
) -> FloatArray:
    """Return the torque of several causes."""
    early, late = _early_and_late(terms, extra)
    torque = _summed(early, motion, extra)
    if late:
        on = signal_motion((*early, *late), motion, baseline_nm, extra=extra)
        torque = torque + _summed(late, on, extra)
    return torque


def signal_motion(
    terms: Iterable[CauseTerm],
    motion: Motion,
    baseline_nm: Callable[[Motion], FloatArray],
    *,
    extra: Sequence[Cause] = (),
) -> Motion:
    """Return the motion with the signal that causes of the whole signal act on."""
    early, late = _early_and_late(terms, extra)
    errors = [angle_error_rad(motion, t.linear) for t in late if t.name == TRANSMISSION_ERROR]
    error = sum(errors, np.zeros(len(motion)))
    return with_signal(motion, lambda on: baseline_nm(on) + _summed(early, on, extra), error)


def _early_and_late(
    terms: Iterable[CauseTerm], extra: Sequence[Cause]
) -> tuple[list[CauseTerm], list[CauseTerm]]:
    """Return the causes that are part of the signal, and those that act on all of it."""
    parts: tuple[list[CauseTerm], list[CauseTerm]] = ([], [])
    for term in terms:
        cause = check_term(term, where=f"cause {term.name!r}", extra=extra)
        parts[cause.whole_signal].append(term)
    return parts


def _summed(terms: Iterable[CauseTerm], motion: Motion, extra: Sequence[Cause]) -> FloatArray:
    return sum((term_torque_nm(t, motion, extra=extra) for t in terms), np.zeros(len(motion)))


def with_signal(
    motion: Motion,
    torque_nm: Callable[[Motion], FloatArray],
    error_rad: FloatArray | float = 0.0,
) -> Motion:
    """Return the motion with a simulated torque, for causes that act on the whole signal.

    Parameters
    ----------
    motion : Motion
        Motion at every sample.
    torque_nm : callable
        Simulated torque on a motion, N m, shape (n_samples,).
    error_rad : ndarray of shape (n_samples,) or float
        Error of the recorded motor angle, rad.

    Returns
    -------
    Motion
        With `simulated_nm`, and its slope over the motor angle at the same output angle, from the
        true angle to the recorded one.
    """
    way = np.where(np.abs(error_rad) > 2.0 * _ANGLE_STEP_RAD, error_rad, 2.0 * _ANGLE_STEP_RAD)
    middle = motion.angle_rad - 0.5 * error_rad
    ahead, behind = (
        torque_nm(replace(motion, angle_rad=middle + half)) for half in (0.5 * way, -0.5 * way)
    )
    slope = (ahead - behind) / way
    return replace(motion, simulated_nm=torque_nm(motion), ripple_slope_nm_per_rad=slope)


def undone_faults(
    terms: Iterable[CauseTerm], motion: Motion, *, extra: Sequence[Cause] = ()
) -> Motion:
    """Return the motion that the bench had, without the faults of angle and clock."""
    for term in terms:
        cause = check_term(term, where=f"cause {term.name!r}", extra=extra)
        if cause.change_motion is not None:
            motion = cause.change_motion(motion, term.shape)
    return motion
