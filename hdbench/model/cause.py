"""The catalogue of causes, checks of their numbers, and how results state them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from types import MappingProxyType

import numpy as np

from hdbench.errors import DataError
from hdbench.model.causes import ALL_CAUSES
from hdbench.model.definition import Cause, CauseTerm, Parameter, shape_bounds
from hdbench.model.harmonics import amplitude_phase, quadratures, standard_uncertainty
from hdbench.model.plugins import plugin_causes
from hdbench.records.trace import FloatArray

__all__ = [
    "Cause",
    "CauseTerm",
    "Parameter",
    "ParameterTable",
    "catalogue",
    "cause_named",
    "cause_parameters",
    "check_term",
    "shape_bounds",
]

ParameterTable = dict[str, dict[str, float | str | None]]


def catalogue(extra: Iterable[Cause] = ()) -> Mapping[str, Cause]:
    """Return every cause by name.

    Parameters
    ----------
    extra : iterable of Cause
        Further causes, such as a user's own.

    Returns
    -------
    mapping of str to Cause
        Read-only: in the order of the contract, then those that installed packages bring (entry
        point group ``hdbench.causes``), then `extra`.

    Raises
    ------
    DataError
        If a further cause takes a name that is taken, or an installed package cannot give its
        causes.
    """
    named = {cause.name: cause for cause in (*ALL_CAUSES, *plugin_causes())}
    for cause in extra:
        if cause.name in named:
            raise DataError(
                f"two causes have the name {cause.name!r}; needed: one",
                where=f"cause {cause.name!r}",
                fix="give the further cause a name of its own",
            )
        named[cause.name] = cause
    return MappingProxyType(named)


def cause_named(name: str, *, where: str, extra: Sequence[Cause] = ()) -> Cause:
    """Return the cause with this name.

    Parameters
    ----------
    name : str
        Name of a cause.
    where : str
        Place of the name, for the error.
    extra : sequence of Cause
        Further causes.

    Returns
    -------
    Cause

    Raises
    ------
    DataError
        If there is none, and the nearest name that exists is proposed; or an installed package
        cannot give its causes.
    """
    # no installed package is asked for a name that stands here
    for cause in (*ALL_CAUSES, *extra):
        if cause.name == name:
            return cause
    known = catalogue(extra)
    if name in known:
        return known[name]
    near = get_close_matches(name, known, n=1, cutoff=0.0)[0]
    raise DataError(
        f"unknown cause {name!r}; needed: a name of the catalogue, nearest is {near!r}",
        where=where,
        fix=f"write {near!r}, see `hdbench diagnose --list-causes`, or install what brings it",
    )


def check_term(term: CauseTerm, *, where: str, extra: Sequence[Cause] = ()) -> Cause:
    """Return the cause of `term` after making sure that its numbers fit.

    Parameters
    ----------
    term : CauseTerm
        A cause with numbers.
    where : str
        Place of the term, for the error.
    extra : sequence of Cause
        Further causes.

    Returns
    -------
    Cause

    Raises
    ------
    DataError
        If the cause is unknown, a parameter is missing, unknown, not finite or out of its domain.
    """
    cause = cause_named(term.name, where=where, extra=extra)
    needed = [parameter.name for parameter in cause.shape]
    if set(term.shape) != set(needed) or len(term.linear) != len(cause.linear):
        raise DataError(
            f"shape parameters {sorted(term.shape)} and {len(term.linear)} linear values for "
            f"{cause.name}; needed: {needed} and {len(cause.linear)}",
            where=where,
            fix=f"give {cause.name} exactly its parameters",
        )
    values = (*term.linear, *(term.shape[name] for name in needed))
    for parameter, value in zip((*cause.linear, *cause.shape), values, strict=True):
        if not parameter.contains(value):
            allowed = " or ".join(
                f"{low:g} to {high:g}" for low, high in _nearest(parameter, value)
            )
            raise DataError(
                f"{parameter.name} of {cause.name} is {value!r} {parameter.unit}; needed: "
                f"{allowed} {parameter.unit}",
                where=where,
                fix=f"give {parameter.name} a value in its domain",
            )
    return cause


def _nearest(parameter: Parameter, value: float) -> list[tuple[float, float]]:
    """Return the two bands of a domain that are nearest to a value outside of it."""
    bands = parameter.bands or ((parameter.lower, parameter.upper),)
    return sorted(sorted(bands, key=lambda band: min(abs(value - end) for end in band))[:2])


def cause_parameters(
    term: CauseTerm,
    covariance: FloatArray | None = None,
    *,
    extra: Sequence[Cause] = (),
) -> ParameterTable:
    """Return every parameter of a term with its uncertainty and unit.

    Parameters
    ----------
    term : CauseTerm
        A cause with numbers.
    covariance : ndarray, shape (n, n), or None
        Covariance of the linear, then the shape parameters (or of the linear ones alone); the
        term's own where None.
    extra : sequence of Cause
        Further causes, such as a user's own.

    Returns
    -------
    dict
        Name to ``{"value", "std", "unit"}``, `std` None where it is not known: amplitude and phase
        of each (cosine, sine) pair, then the shape and the linear parameters.

    Raises
    ------
    DataError
        If the numbers do not fit the cause.
    ValueError
        If `covariance` has another shape.
    """
    cause = check_term(term, where=f"cause {term.name!r}", extra=extra)
    matrix = _matrix(covariance if covariance is not None else term.covariance, cause)
    table: ParameterTable = {}
    names = [parameter.name for parameter in cause.linear]
    for pair in quadratures(cause):
        c, s = names.index(pair.cosine), names.index(pair.sine)
        part = None if matrix is None else matrix[np.ix_([c, s], [c, s])]
        amplitude, phase, a_std, p_std = amplitude_phase(term.linear[c], term.linear[s], part)
        table[pair.amplitude] = _entry(amplitude, a_std, pair.unit)
        table[pair.phase] = _entry(phase, p_std, "rad")
    n = len(cause.linear)
    for index, parameter in enumerate(cause.shape):
        std = _diagonal(matrix, n + index)
        table[parameter.name] = _entry(term.shape[parameter.name], std, parameter.unit)
    for index, parameter in enumerate(cause.linear):
        std = _diagonal(matrix, index)
        table[parameter.name] = _entry(term.linear[index], std, parameter.unit)
    return table


def _matrix(
    covariance: FloatArray | Sequence[Sequence[float]] | None, cause: Cause
) -> FloatArray | None:
    """Return the covariance as an array after checking its shape."""
    if covariance is None:
        return None
    matrix = np.asarray(covariance, dtype=np.float64)
    n, m = len(cause.linear), len(cause.linear) + len(cause.shape)
    if matrix.shape not in ((n, n), (m, m)):
        raise ValueError(
            f"covariance of {cause.name} has shape {matrix.shape}; needed: ({n}, {n}) or ({m}, {m})"
        )
    return matrix


def _diagonal(matrix: FloatArray | None, index: int) -> float | None:
    """Return the standard uncertainty at `index`, None where the matrix does not reach."""
    if matrix is None or index >= len(matrix):
        return None
    return standard_uncertainty(float(matrix[index, index]))


def _entry(value: float, std: float | None, unit: str) -> dict[str, float | str | None]:
    return {"value": float(value), "std": std, "unit": unit}
