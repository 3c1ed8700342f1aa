"""The model that was handed in, with the fitted baseline and the causes that were found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hdbench.diagnosis.fit.jointfit import JointFit
from hdbench.diagnosis.fit.terms import term_columns
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.naming.nameless import unnamed
from hdbench.diagnosis.noise.whitened import Whitener
from hdbench.model import BenchModel, CauseTerm
from hdbench.records.trace import FloatArray

__all__ = ["cause_term", "extended_model"]


def cause_term(fit: JointFit, place: int) -> CauseTerm:
    """Return a fitted term as the model writes it.

    Parameters
    ----------
    fit : JointFit
        Joint fit.
    place : int
        Index of the term in it.

    Returns
    -------
    CauseTerm
        With its covariance.
    """
    term = fit.terms[place]
    covariance = tuple(tuple(float(x) for x in row) for row in fit.covariances[place])
    # a later cause may push an earlier one past its domain by what the record cannot tell
    linear = tuple(
        float(np.clip(x, p.lower, p.upper))
        for x, p in zip(fit.linear[place], term.cause.linear, strict=True)
    )
    return CauseTerm(term.cause.name, dict(term.shape), linear, covariance)


def _baseline(
    record: Record, given: BenchModel, fit: JointFit, whitener: Whitener
) -> tuple[tuple[str, ...], FloatArray]:
    """Return the names and coefficients of the model's baseline on this record."""
    if not record.nuisance.shape[1]:
        return record.names, fit.base[: len(record.names)]
    response = record.response_nm
    for term, linear in zip(fit.terms, fit.linear, strict=True):
        response = response - term_columns(term, record) @ linear
    white = whitener.apply(record.base)
    gram = white.T @ white
    amplitude, phase = given.misalignment
    free = np.arange(gram.shape[0])
    extra = len(record.names) + np.arange(record.nuisance.shape[1])
    if amplitude > 0.0:
        gram[extra, extra] += 1.0 / amplitude**2
    else:
        free = np.setdiff1d(free, extra)
    part = white[:, free]
    base = np.zeros(gram.shape[0])
    base[free] = np.linalg.solve(gram[np.ix_(free, free)], part.T @ whitener.apply(response))
    base[extra] += (amplitude * np.cos(phase), -amplitude * np.sin(phase))
    names = (*record.names, "misalignment:cosine", "misalignment:sine")
    return names, base[: len(names)]


def extended_model(
    record: Record, given: BenchModel, fit: JointFit, whitener: Whitener
) -> BenchModel:
    """Return the extended model: fitted baseline, and every cause that has a name.

    Parameters
    ----------
    record : Record
        Record.
    given : BenchModel
        Model that was held against it.
    fit : JointFit
        Joint fit of the record.
    whitener : Whitener
        Noise.

    Returns
    -------
    BenchModel
        Lines without a name are no part of it.

    Notes
    -----
    Where the output covers less than a turn, misalignment and zero can hardly be told apart. The
    misalignment is then the given one plus a correction whose quadratures have the prior
    N(0, A^2), A the given amplitude: a record that says nothing about it leaves the given one, and
    one that does moves it. A given model without misalignment gets none.
    """
    names, base = _baseline(record, given, fit, whitener)
    fitted = given.with_baseline(names, base[: len(names)].tolist())
    model = replace(fitted, causes=(), load=record.load)
    for place, term in enumerate(fit.terms):
        if not unnamed(term):
            model = model.with_cause(cause_term(fit, place))
    return model
