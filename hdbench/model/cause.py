"""Catalogue of causes, those of installed packages and of a user's files, and their numbers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from difflib import get_close_matches
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from hdbench.errors import DataError, HdbenchError
from hdbench.model.causefile import load_causes
from hdbench.model.causes import ALL_CAUSES, CAUSE_GROUPS
from hdbench.model.definition import (
    Cause,
    CauseTerm,
    Parameter,
    amplitude_phase,
    quadratures,
    standard_uncertainty,
)
from hdbench.records.trace import FloatArray

CAUSES_GROUP = "hdbench.causes"


@cache
def plugin_causes() -> tuple[Cause, ...]:
    """Return the causes of all installed packages."""
    found: dict[str, Cause] = {cause.name: cause for cause in ALL_CAUSES}
    own: list[Cause] = []
    for entry in sorted(entry_points(group=CAUSES_GROUP), key=lambda e: (e.name, e.value)):
        for cause in _causes_of(entry):
            if cause.name in found:
                raise _error(entry, f"brings the cause {cause.name!r}, a name that is taken")
            found[cause.name] = cause
            own.append(cause)
    return tuple(own)


def _causes_of(entry: EntryPoint) -> Iterator[Cause]:
    """Yield the causes of an entry point: a cause, a sequence of them, or a callable for those."""
    try:
        thing = entry.load()
        if callable(thing) and not isinstance(thing, Cause):
            thing = thing()
        causes = list(thing) if isinstance(thing, Sequence) else [thing]
    except HdbenchError:
        raise
    except Exception as error:  # whatever a package's own code raises
        words = f"cannot give its causes: {type(error).__name__}: {error}"
        raise _error(entry, words) from error
    for cause in causes:
        if not isinstance(cause, Cause):
            kind = type(cause).__name__
            raise _error(entry, f"gives {kind}; needed: hdbench.model.Cause, or a sequence of it")
        yield cause


def _error(entry: EntryPoint, what: str) -> DataError:
    name = entry.dist.name if entry.dist is not None else "unknown"
    return DataError(
        f"distribution {name!r} {what}",
        where=f"entry point {entry.name} = {entry.value} of group {CAUSES_GROUP}",
        fix=f"mend or uninstall {name}",
    )


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


def check_term(term: CauseTerm, *, where: str = "", extra: Sequence[Cause] = ()) -> Cause:
    """Return the cause of `term` after making sure that its numbers fit.

    Parameters
    ----------
    term : CauseTerm
        A cause with numbers.
    where : str
        Place of the term, for the error; empty names the cause.
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
    where = where or f"cause {term.name!r}"
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


def cause_parameters(term: CauseTerm, *, extra: Sequence[Cause] = ()) -> ParameterTable:
    """Return every parameter of a term with its uncertainty and unit.

    Parameters
    ----------
    term : CauseTerm
        A cause with numbers; its covariance is that of the linear, then the shape parameters, or
        of the linear ones alone.
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
        If the covariance has another shape.
    """
    cause = check_term(term, extra=extra)
    matrix = _matrix(term, cause)
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


def _matrix(term: CauseTerm, cause: Cause) -> FloatArray | None:
    """Return the covariance as an array after checking its shape."""
    if term.covariance is None:
        return None
    matrix = np.asarray(term.covariance, dtype=np.float64)
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


def user_causes(paths: Iterable[Path]) -> tuple[Cause, ...]:
    """Return the causes of several causes files.

    Parameters
    ----------
    paths : iterable of Path
        TOML files as ``docs/causes.md`` describes them.

    Returns
    -------
    tuple of Cause
        In order of the files; hand them on as `BenchModel.with_extra`, or as `extra`.

    Raises
    ------
    DataError
        If a file is invalid, or a name stands in two files or in an installed package.
    """
    origin = {cause.name: "an installed package" for cause in plugin_causes()}
    found: list[Cause] = []
    for path in paths:
        for cause in load_causes(path):
            if cause.name in origin:
                raise DataError(
                    f"the cause {cause.name!r} stands in {origin[cause.name]} too; needed: a name "
                    "of its own",
                    where=str(path),
                    fix="rename one of the two",
                )
            origin[cause.name] = str(path)
            found.append(cause)
    return tuple(found)


# group of causes that are no names of the contract
_OWN = "user's own"
# what is told of a cause beside its equation and parameters
_TOLD = ("additive", "channels", "locked_to", "parity", "channel", "look_alikes", "experiment",
         "source")  # fmt: skip


def describe_cause(cause: Cause) -> dict[str, Any]:
    """Return a cause as plain data.

    Parameters
    ----------
    cause : Cause
        A cause.

    Returns
    -------
    dict
        ``name``, ``group`` of the contract, ``equation``, ``parameters`` (name, kind ``shape`` or
        ``linear``, unit, domain as ``lower``, ``upper`` and ``bands``, description), ``additive``
        (False for causes of noise and acquisition), ``channels`` that it needs, ``locked_to``,
        ``parity``, ``channel`` of origin, ``look_alikes``, ``experiment`` that separates them, and
        ``source``; JSON-able.
    """
    groups = (name for name, causes in CAUSE_GROUPS.items() if cause in causes)
    return {
        "name": cause.name,
        "group": next(groups, _OWN),
        "equation": cause.equation,
        "parameters": [
            *(_parameter(p, "shape") for p in cause.shape),
            *(_parameter(p, "linear") for p in cause.linear),
        ],
        **{name: _plain(getattr(cause, name)) for name in _TOLD},
    }


def _plain(value: object) -> object:
    return list(value) if isinstance(value, tuple) else value


def describe_causes(extra: Iterable[Cause] = ()) -> list[dict[str, Any]]:
    """Return every cause as plain data.

    Parameters
    ----------
    extra : iterable of Cause
        Causes of the user's own.

    Returns
    -------
    list of dict
        As `describe_cause`: the names of the contract in its order, then those of installed
        packages, then `extra`.

    Raises
    ------
    DataError
        If a name is taken twice, or an installed package cannot give its causes.
    """
    return [describe_cause(cause) for cause in catalogue(extra).values()]


def _parameter(parameter: Parameter, kind: str) -> dict[str, Any]:
    known = asdict(parameter) | {"kind": kind, "bands": [list(band) for band in parameter.bands]}
    names = ("name", "kind", "unit", "lower", "upper", "bands", "description")
    return {name: known[name] for name in names}
