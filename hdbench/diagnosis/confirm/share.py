"""What a cause explains of the variance, and how far the model as given is off."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.fit.jointfit import JointFit, fit_jointly, linear_fit
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.search import Found
from hdbench.model import BenchModel
from hdbench.records.trace import FloatArray

__all__ = ["as_given_rms", "mean_square", "share_of"]

# the others change their shapes until a round gains less than this share of what is lost
_EXACT = 1e-3


def mean_square(record: Record, fit: JointFit) -> float:
    """Return the mean square of a fit's residual.

    Parameters
    ----------
    record : Record
        Record.
    fit : JointFit
        Fit.

    Returns
    -------
    float
        (N m)^2.
    """
    return _left(record, fit.fitted_nm)


def _left(record: Record, fitted_nm: FloatArray) -> float:
    """Return the mean square of what a fitted torque leaves, (N m)^2."""
    left = (record.response_nm - fitted_nm)[record.valid]
    return float(np.mean(left**2))


def share_of(record: Record, found: Found, place: int, variance: float) -> float:
    """Return the share of variance that a term explains.

    Parameters
    ----------
    record : Record
        Record.
    found : Found
        Result of the search.
    place : int
        Index of the term in the fit.
    variance : float
        Mean square of the baseline's residual, (N m)^2.

    Returns
    -------
    float
        In [0, 1].

    Notes
    -----
    The larger of what it adds to the terms before it and of what its loss would cost: of two like
    effects, such as dry and viscous friction, each can stand in for the other, and the loss of one
    alone costs little however large both are. The others may change their shapes meanwhile: what
    one of them can take over was no effect of its own.
    """
    terms = found.fit.terms
    name = terms[place].cause.name
    own = {k for k, term in enumerate(terms) if term.form and term.cause.name == name}
    own.add(place)
    others = tuple(term for k, term in enumerate(terms) if k not in own)
    before = tuple(term for k, term in enumerate(terms) if k < place)

    def left_by(kept: tuple[Term, ...]) -> float:
        return _left(record, linear_fit(record, kept, found.noise.whitener))

    added = left_by(before) - left_by(terms[: place + 1])
    enough = _EXACT * found.fit.loss(place)
    beside = fit_jointly(record, others, found.noise.whitener, enough=enough)
    lost = mean_square(record, beside) - mean_square(record, found.fit)
    return float(np.clip(max(added, lost) / variance, 0.0, 1.0))


def as_given_rms(record: Record, given: BenchModel) -> float:
    """Return the RMS of measured less model with the numbers it was handed in with.

    Parameters
    ----------
    record : Record
        Record.
    given : BenchModel
        Model.

    Returns
    -------
    float
        N m.
    """
    left = (record.torque_nm - given.torque_nm(record.motion))[record.valid]
    return float(np.sqrt(np.mean(left**2)))
