"""The forms in which readings are searched for a cause."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hdbench.diagnosis.loads.loops import loop_forms
from hdbench.model import Cause, Motion, Parameter
from hdbench.model.definition import unbounded
from hdbench.records.trace import FloatArray

__all__ = ["form_of", "in_form", "load_causes", "outlier_cause", "whole_linear", "whole_shape"]

# readings at a few levels do not give a sharpness of their own: the limiter is tanh itself, has a
# knee, is within 2 % of a hard stop, or is one
_SHARPNESS = {"": 1.0, "with a knee": 2.0, "with a sharp knee": 6.0, "with a hard stop": 64.0}
# names that static readings can show; what moves, sounds or turns the motor is not among them
_NAMES = (
    "cubic-nonlinearity",
    "hysteresis",
    "backlash",
    "saturation",
    "arm-sag",
    "direction-asymmetry",
    "side-force",
    "position-dependent-gain",
    "creep",
    "zero-step",
    "zero-drift",
    "warm-up",
)


def load_causes(
    causes: tuple[Cause, ...], extra: tuple[Cause, ...], motion: Motion
) -> tuple[Cause, ...]:
    """Return the causes that static readings can show.

    Parameters
    ----------
    causes : tuple of Cause
        Catalogue.
    extra : tuple of Cause
        Causes of the user's own; all additive ones are tried.
    motion : Motion
        The readings as a standing motion.

    Returns
    -------
    tuple of Cause
        Those that the motion allows, in every form in which they are looked for.
    """
    named = {cause.name: cause for cause in causes}
    chosen = [part for name in _NAMES if name in named for part in _parts(named[name])]
    chosen += [cause for cause in extra if cause.additive]
    return tuple(cause for cause in chosen if cause.applicable(motion) is None)


def _parts(cause: Cause) -> tuple[Cause, ...]:
    """Return the forms in which a cause is looked for.

    A gain of two harmonics: each of them alone, and both. A sagging arm: without and with its
    tilt under no load. Hysteresis: as `loop_forms` says. Saturation: of four
    sharpnesses. Any other cause: as it is.
    """
    if cause.name == "hysteresis":
        # its second column is a gain, which readings have of their own
        return loop_forms(_part(cause, 0, 1))
    if cause.name == "saturation":
        return tuple(_sharp(cause, form) for form in _SHARPNESS)
    if cause.name == "position-dependent-gain":
        return (_part(cause, 0, 2), _part(cause, 2, 4), cause)
    if cause.name == "arm-sag":
        return (_part(cause, 0, 1), cause)
    return (cause,)


def form_of(cause: Cause) -> str:
    """Return in which form a cause was looked for; empty for the catalogue's own.

    Parameters
    ----------
    cause : Cause
        Cause of a term.

    Returns
    -------
    str
    """
    return cause.locked_to.partition(", ")[2]


def in_form(cause: Cause, form: str) -> Cause:
    """Return a cause of the catalogue in a form that `form_of` named; as it is where there is none.

    Parameters
    ----------
    cause : Cause
        Cause of the catalogue.
    form : str
        Name of the form.

    Returns
    -------
    Cause
    """
    return next((part for part in _parts(cause) if form and form_of(part) == form), cause)


def _sharp(cause: Cause, form: str) -> Cause:
    """Return a saturation whose sharpness is given."""
    power = _SHARPNESS[form]

    def columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        return cause.columns(motion, {**shape, "sharpness": power})

    shape = tuple(p for p in cause.shape if p.name != "sharpness")
    locked = f"load, {form}" if form else "load"
    # the limit is held where its share is 1: it may be as far as any trace of it is seen
    return replace(cause, columns=columns, shape=shape, locked_to=locked, reach=unbounded)


def whole_shape(cause: Cause, part: Cause, shape: Mapping[str, float]) -> dict[str, float]:
    """Return the shape of a cause that was fitted in a form that holds some of it.

    Parameters
    ----------
    cause : Cause
        Cause of the catalogue.
    part : Cause
        The cause as it was fitted.
    shape : mapping of str to float
        Its shape.

    Returns
    -------
    dict
        All shape parameters of `cause`.
    """
    held = {"sharpness": _SHARPNESS.get(form_of(part), 1.0)}
    return {p.name: shape.get(p.name, held.get(p.name, p.lower)) for p in cause.shape}


def _part(cause: Cause, first: int, last: int) -> Cause:
    """Return the cause with the columns from `first` up to `last` alone."""

    def columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        return cause.columns(motion, shape)[:, first:last]

    return replace(cause, linear=cause.linear[first:last], columns=columns)


def whole_linear(
    cause: Cause, part: Cause, linear: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the parameters of a cause that was fitted in part; those left out are 0.

    Parameters
    ----------
    cause : Cause
        Cause of the catalogue.
    part : Cause
        The cause as it was fitted.
    linear : ndarray, shape (k,)
        Its linear parameters.
    covariance : ndarray, shape (k + q, k + q)
        Covariance of the linear, then the shape parameters.

    Returns
    -------
    linear : ndarray, shape (n,)
        All linear parameters of `cause`.
    covariance : ndarray, shape (n + q, n + q)
        Zero for those left out.
    """
    names = [p.name for p in (*cause.linear, *cause.shape)]
    index = [names.index(p.name) for p in (*part.linear, *part.shape)]
    full, matrix = np.zeros(len(cause.linear)), np.zeros((len(names), len(names)))
    full[index[: len(linear)]] = linear
    matrix[np.ix_(index, index)] = covariance
    return full, matrix


def _outlier_columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    return np.asarray(np.arange(len(motion)) == round(shape["reading"]), dtype=np.float64)[:, None]


def outlier_cause() -> Cause:
    """Return one reading that stands apart: no name of the catalogue has it.

    Returns
    -------
    Cause
        Shape parameter ``reading``, its index from 0, and ``offset_nm``, N m.
    """
    which = Parameter("reading", "1", 0.0, 1e9, "index of the reading")
    offset = Parameter("offset_nm", "N m", -np.inf, np.inf, "how far it stands apart")
    return Cause(
        name="outlier",
        equation="o where the reading is the one named",
        shape=(which,),
        linear=(offset,),
        locked_to="time",
        parity="",
        channel="acquisition",
        look_alikes=(),
        experiment="repeat the reading",
        source="",
        columns=_outlier_columns,
        harmonic=False,
    )
