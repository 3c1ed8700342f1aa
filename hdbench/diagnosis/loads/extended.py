"""The given model with the causes that readings showed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hdbench.diagnosis.loads.fit import LoadFit
from hdbench.diagnosis.loads.forms import form_of, whole_linear, whole_shape
from hdbench.diagnosis.loads.names import is_outlier
from hdbench.model import BenchModel, CauseTerm, cause_named

__all__ = ["extended_by_loads", "forms_of", "load_cause_term"]


def load_cause_term(fit: LoadFit, place: int, given: BenchModel) -> CauseTerm:
    """Return a fitted term as the model writes it.

    Parameters
    ----------
    fit : LoadFit
        Joint fit.
    place : int
        Index of the term in it.
    given : BenchModel
        Model whose own causes it may be one of.

    Returns
    -------
    CauseTerm
        With its covariance.
    """
    term = fit.terms[place]
    whole = cause_named(term.cause.name, where="model", extra=given.extra_causes)
    linear, matrix = whole_linear(whole, term.cause, fit.linear[place], fit.covariances[place])
    # a later cause may push an earlier one past its domain by what the readings cannot tell
    values = tuple(
        float(np.clip(x, p.lower, p.upper)) for x, p in zip(linear, whole.linear, strict=True)
    )
    covariance = tuple(tuple(float(x) for x in row) for row in matrix)
    shape = whole_shape(whole, term.cause, term.shape)
    return CauseTerm(term.cause.name, shape, values, covariance)


def forms_of(fit: LoadFit) -> dict[str, str]:
    """Return in which form each cause was found, where that is not the catalogue's own.

    Parameters
    ----------
    fit : LoadFit
        Joint fit.

    Returns
    -------
    dict
        Name of the cause to name of the form.
    """
    return {t.cause.name: form_of(t.cause) for t in fit.terms if form_of(t.cause)}


def extended_by_loads(fit: LoadFit, given: BenchModel) -> BenchModel:
    """Return the given model with the causes of a fit.

    Parameters
    ----------
    fit : LoadFit
        Joint fit.
    given : BenchModel
        Model that was held against the readings; its own causes come first in the fit.

    Returns
    -------
    BenchModel
        ``provenance["calibration"]`` holds gain, the zero of each experiment, and the form of each
        cause that is not in the catalogue's own.
    """
    names = fit.table.names
    zeros = fit.base[1 : 1 + len(names)] / fit.slope_v_per_nm
    calibration = {
        "gain_nm_per_v": 1.0 / fit.slope_v_per_nm,
        "zeros_nm": dict(zip(names, zeros.tolist(), strict=True)),
        "forms": forms_of(fit),
    }
    shown = {term.cause.name for term in fit.terms if term.known}
    kept = tuple(term for term in given.causes if term.name not in shown)
    model = replace(given, causes=kept, provenance={**given.provenance, "calibration": calibration})
    for place, term in enumerate(fit.terms):
        if not is_outlier(term):
            model = model.with_cause(load_cause_term(fit, place, given))
    return model
