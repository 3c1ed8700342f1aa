"""Bench models as JSON files, schema ``hdbench/model/1``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from pydantic import Field, NonNegativeFloat

from hdbench.errors import DataError
from hdbench.model.bench import BenchModel
from hdbench.model.cause import (
    cause_named,
    cause_parameters,
    check_term,
)
from hdbench.model.causefile import declared_cause
from hdbench.model.definition import Cause, CauseTerm, quadratures
from hdbench.records.jsonfile import ProfileIdentity, read_json, result_header, write_json
from hdbench.results import Part

MODEL_SCHEMA = "hdbench/model/1"
_FIX = "correct the key, or write the model again with `hdbench diagnose`"
# amplitude and phase are written beside cosine and sine with 17 digits: only rounding may differ
_AGREE = 1e-9


class _Wave(Part, strict=True):
    amplitude_nm: NonNegativeFloat
    phase_rad: float


class _Ripple(_Wave, strict=True):
    order: NonNegativeFloat


class _Baseline(Part, strict=True):
    zero_nm: float
    inertia_nm_s2: NonNegativeFloat
    ripple: tuple[_Ripple, ...]
    misalignment: _Wave
    load: float = 1.0  # files written before a measured load was part of the baseline have none


class _Number(Part, strict=True):
    value: float


class _Entry(Part, strict=True):
    name: str
    parameters: dict[str, _Number]
    covariance: tuple[tuple[float, ...], ...] | None = None


class _File(Part, strict=True):
    baseline: _Baseline
    causes: tuple[_Entry, ...]
    definitions: tuple[dict[str, Any], ...] = ()
    provenance: dict[str, Any] = Field(default_factory=dict)


def save_model(
    path: Path, model: BenchModel, *, profile: ProfileIdentity, provenance: Mapping[str, Any]
) -> None:
    """Write a model file atomically.

    Parameters
    ----------
    path : Path
        File to write or replace.
    model : BenchModel
        The model.
    profile : Profile
        The bench it is about.
    provenance : mapping
        Where the numbers came from; added to the model's own.

    Raises
    ------
    StorageError
        If the file cannot be written.
    DataError
        If a cause of the model does not fit the catalogue.
    ValueError
        If a number is not finite.
    """
    write_json(path, model_dict(model, profile=profile, provenance=provenance))


def model_dict(
    model: BenchModel, *, profile: ProfileIdentity | None, provenance: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the object that a model file holds.

    Parameters
    ----------
    model : BenchModel
        The model.
    profile : Profile or None
        The bench it is about.
    provenance : mapping
        Where the numbers came from; added to the model's own.

    Returns
    -------
    dict
        Header, ``baseline``, ``causes`` (``name``, ``parameters`` with value, std and unit, and
        ``covariance`` of linear and shape parameters or None), ``definitions`` (declarations of the
        user's own causes among them) and ``provenance``.

    Raises
    ------
    DataError
        If a cause of the model does not fit the catalogue.
    """
    amplitude, phase = model.misalignment
    return {
        **result_header("model", profile),
        "baseline": {
            "zero_nm": model.zero_nm,
            "inertia_nm_s2": model.inertia_nm_s2,
            "load": model.load,
            "ripple": [
                {"order": order, "amplitude_nm": a, "phase_rad": p} for order, a, p in model.ripple
            ],
            "misalignment": {"amplitude_nm": amplitude, "phase_rad": phase},
        },
        "causes": [
            {
                "name": term.name,
                "parameters": cause_parameters(term, extra=model.extra_causes),
                "covariance": term.covariance,
            }
            for term in model.causes
        ],
        "definitions": _definitions(model),
        "provenance": {**model.provenance, **provenance},
    }


def load_model(path: Path) -> BenchModel:
    """Read a model file.

    Parameters
    ----------
    path : Path
        A file that `save_model` or a person wrote. A (cosine, sine) pair may be given by its
        amplitude and phase alone.

    Returns
    -------
    BenchModel
        The same model: its torque has the same bits as before it was saved.

    Raises
    ------
    DataError
        If the file is missing, no JSON or of another schema, a key is missing or of the wrong
        type, a number is not finite or out of its domain, or a cause or parameter is unknown.
    """
    body, file = read_json(path, MODEL_SCHEMA), str(path)
    stored = _File.from_json(body, file, _FIX)
    declared = [
        declared_cause(definition, where=f"{file}: key definitions.{i}")
        for i, definition in enumerate(stored.definitions)
    ]
    baseline = stored.baseline
    model = BenchModel(
        baseline.zero_nm,
        baseline.inertia_nm_s2,
        tuple((r.order, r.amplitude_nm, r.phase_rad) for r in baseline.ripple),
        (baseline.misalignment.amplitude_nm, baseline.misalignment.phase_rad),
        provenance=stored.provenance,
        load=baseline.load,
    ).with_extra(declared)
    for i, entry in enumerate(stored.causes):
        model = model.with_cause(_term(entry, f"{file}: key causes.{i}", model.extra_causes))
    return model


def _definitions(model: BenchModel) -> list[dict[str, Any]]:
    """Return the declarations of the causes of `model` that were declared."""
    used = {term.name for term in model.causes}
    own = (cause for cause in model.extra_causes if cause.name in used)
    return [dict(cause.definition) for cause in own if cause.definition is not None]


def _term(entry: _Entry, where: str, extra: Sequence[Cause]) -> CauseTerm:
    """Return the cause with numbers that one entry of ``causes`` holds."""
    cause = cause_named(entry.name, where=f"{where}.name", extra=extra)
    values = {name: number.value for name, number in entry.parameters.items()}
    place = f"{where}.parameters"
    values = {**_defaults(cause), **_with_pairs(cause, values, place)}
    needed = {parameter.name for parameter in (*cause.shape, *cause.linear)}
    for name in sorted(needed ^ set(values)):
        pool = sorted(set(values) if name in needed else needed)
        near = next(iter(get_close_matches(name, pool, n=1, cutoff=0.0)), "none")
        state = "missing" if name in needed else "unknown"
        raise DataError(
            f"parameter {name!r} of {cause.name} is {state}; nearest here: {near!r}, needed: "
            f"{', '.join(sorted(needed))}",
            where=place,
            fix=f"give {cause.name} exactly its parameters",
        )
    rows, sizes = entry.covariance, (len(cause.linear), len(cause.linear) + len(cause.shape))
    if rows is not None and (len(rows) not in sizes or any(len(r) != len(rows) for r in rows)):
        raise DataError(
            f"found no square matrix of numbers of {' or '.join(map(str, sizes))} rows",
            where=f"{where}.covariance",
            fix="take the key out, or write the model again with `hdbench diagnose`",
        )
    term = CauseTerm(
        cause.name,
        {parameter.name: values[parameter.name] for parameter in cause.shape},
        tuple(values[parameter.name] for parameter in cause.linear),
        rows,
    )
    check_term(term, where=place, extra=extra)
    return term


def _defaults(cause: Cause) -> dict[str, float]:
    """Return the parameters that a file may leave out."""
    return {p.name: p.default for p in (*cause.shape, *cause.linear) if p.default is not None}


def _with_pairs(cause: Cause, values: dict[str, float], where: str) -> dict[str, float]:
    """Return `values` with cosine and sine in the place of amplitude and phase."""
    values = dict(values)
    for pair in quadratures(cause):
        amplitude = values.pop(pair.amplitude, None)
        phase = values.pop(pair.phase, None)
        if amplitude is None or phase is None:
            continue
        given = (amplitude * math.cos(phase), -amplitude * math.sin(phase))
        for name, value in zip((pair.cosine, pair.sine), given, strict=True):
            stated = values.setdefault(name, value)
            if not abs(stated - value) <= _AGREE * max(abs(amplitude), abs(stated)):
                raise DataError(
                    f"{name} is {stated!r}, but {pair.amplitude} and {pair.phase} give "
                    f"{value!r} {pair.unit}; needed: one of the two",
                    where=where,
                    fix=f"take out {pair.cosine} and {pair.sine}, or amplitude and phase",
                )
    return values
