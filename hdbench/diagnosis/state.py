"""Where a search stands: record, fit, noise and what was accepted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from hdbench.diagnosis.acquisition.codes import Comb
from hdbench.diagnosis.detect.bank import Grams
from hdbench.diagnosis.detect.scanplan import plan_scans
from hdbench.diagnosis.detect.survey import Survey, make_survey
from hdbench.diagnosis.fit.jointfit import JointFit, fit_jointly
from hdbench.diagnosis.fit.settle import Hidden, InSlow, Noise, settle
from hdbench.diagnosis.fit.terms import Term, term_columns
from hdbench.diagnosis.measured.record import Beyond, Record, with_simulated
from hdbench.diagnosis.measured.skewed import signal_in_channel
from hdbench.diagnosis.naming.ranking import Naming
from hdbench.diagnosis.noise.coarse import coarse_basis
from hdbench.diagnosis.noise.rounding import Rounding, coarse_rounding, steps_of
from hdbench.diagnosis.noise.slownoise import SlowNoise
from hdbench.diagnosis.noise.whitened import Space, make_space
from hdbench.model import Cause
from hdbench.records.trace import FloatArray

__all__ = ["Accepted", "State", "Walk", "accepted_as"]

# names of a torque once per output turn; far beyond the model's misalignment it is a weight first
_ONCE_PER_TURN = ("load-gravity", "misalignment")
# smallest normal double
_SMALLEST = 1e-300


@dataclass(frozen=True, slots=True)
class Accepted:
    """An accepted term and what it could also be.

    Parameters
    ----------
    name : str
        Name of the cause.
    false_alarm : float
        Probability of such a finding on this record without any effect.
    evidence_nats : float
        Score beside all other accepted terms.
    group : tuple of Term
        Terms that span the same space on this record, the accepted one first.
    rivals : tuple of Term
        Other terms within 3 nats.
    form : bool
        True for a part of an earlier cause of the same name: it is none of its own.
    probability : float or None
        Of the group, among all names; None where no others were held against it.
    """

    name: str
    false_alarm: float
    evidence_nats: float
    group: tuple[Term, ...]
    rivals: tuple[Term, ...]
    form: bool = False
    probability: float | None = None


@dataclass(frozen=True, slots=True)
class Walk:
    """A random walk of the zero that was accepted.

    Parameters
    ----------
    noise : SlowNoise
        Its power.
    false_alarm : float
        Probability of such a finding without it.
    rivals : tuple of str
        Names within 3 nats.
    """

    noise: SlowNoise
    false_alarm: float
    rivals: tuple[str, ...]


@dataclass(slots=True)
class State:
    """Where a search stands.

    Parameters
    ----------
    record : Record
        Record; its motion may be aligned anew.
    causes : tuple of Cause
        Catalogue.
    rng : Generator
        For the draws of the null.
    hidden : Hidden
        What the noise model must not see.
    fit : JointFit
        Joint fit of all that is explained.
    noise : Noise
        Noise.
    survey : Survey
        Plan of the looks.
    grams : Grams
        Gram matrices of the last look.
    exponent : float
        Exponent of the slow noise, 0 where there is none.
    walk : Walk or None
        Random walk of the zero that was accepted.
    accepted : list of Accepted
        Causes, in the order of the fit's terms after those that were known.
    rounding : Rounding or None
        Coarse steps of the converter; their mean error is part of what the record holds fixed.
    comb : Comb or None
        Steps of the converter, coarse or fine.
    in_slow : InSlow or None
        What a slow noise was last found to be worth beside the terms.
    paid_nats : float
        What the accepted causes and the walk paid for their parameters and places.
    unwalked : State or None
        Where the search stood before the walk was accepted.
    may_walk : bool
        Whether slow noise may be accepted.
    """

    record: Record
    causes: tuple[Cause, ...]
    rng: np.random.Generator
    hidden: Hidden
    fit: JointFit
    noise: Noise
    survey: Survey
    grams: Grams
    exponent: float = 0.0
    walk: Walk | None = None
    accepted: list[Accepted] = field(default_factory=list)
    rounding: Rounding | None = None
    comb: Comb | None = None
    in_slow: InSlow | None = None
    paid_nats: float = 0.0
    unwalked: State | None = None
    may_walk: bool = True

    @classmethod
    def start(
        cls,
        record: Record,
        causes: tuple[Cause, ...],
        known: tuple[Term, ...],
        rng: np.random.Generator,
    ) -> State:
        """Return the state after the baseline and the known causes were fitted."""
        hidden = Hidden(coarse_basis(record), plan_scans(record))
        weight = _weight_terms(record, causes, known)
        fit, noise = settle(record, (*known, *weight[:1]), None, hidden)
        comb = steps_of(record)
        coarse = coarse_rounding(record, fit.fitted_nm, comb)
        if coarse:
            record, coarse = coarse.taken_out(record, fit.fitted_nm)
            fit, noise = settle(record, (*known, *weight[:1]), None, hidden)
        accepted = [_evident(record, known, weight, fit, noise)] if weight else []
        record = with_simulated(record, signal_in_channel(record, fit.fitted_nm))
        space = make_space(noise.whitener, fit.parts, record.response_nm)
        survey, grams = make_survey(record, causes, space, hidden.scans, rng)
        parts = (record, causes, rng, hidden, fit, noise, survey, grams)
        return cls(*parts, accepted=accepted, rounding=coarse, comb=comb)

    @property
    def n_known(self) -> int:
        """Number of causes that the model already held."""
        return sum(term.known for term in self.fit.terms)

    def space(self) -> Space:
        """Return the residual of the current fit."""
        return make_space(self.noise.whitener, self.fit.parts, self.record.response_nm)

    def settle(self, terms: tuple[Term, ...]) -> None:
        """Fit terms and noise anew."""
        self._settle(terms)
        # a large effect may have hidden how coarse the steps are
        self.rounding = self.rounding or coarse_rounding(self.record, self.fit.fitted_nm, self.comb)
        if self.rounding:
            self.record, self.rounding = self.rounding.taken_out(self.record, self.fit.fitted_nm)
            self._settle(self.fit.terms)
        if any(term.cause.whole_signal for term in terms):  # once more with the signal beside it
            self.record = with_simulated(self.record, _signal(self.record, self.fit))
            self._settle(self.fit.terms)

    def _settle(self, terms: tuple[Term, ...]) -> None:
        self.fit, self.noise = settle(self.record, terms, self.noise, self.hidden, self.exponent)

    def realign(self, align: Callable[[Beyond], Record]) -> None:
        """Align the motion with what is explained now, and plan all looks anew."""
        record = align(_beyond(self.record, self.fit))
        if self.rounding:
            fresh = replace(self.rounding, held_nm=None)
            record, self.rounding = fresh.taken_out(record, self.fit.fitted_nm)
        self.record = with_simulated(record, self.fit.fitted_nm)
        self.hidden = Hidden(coarse_basis(self.record), plan_scans(self.record))
        self.settle(self.fit.terms)
        self.survey, self.grams = make_survey(
            self.record, self.causes, self.space(), self.hidden.scans, self.rng
        )


def _weight_terms(
    record: Record, causes: tuple[Cause, ...], known: tuple[Term, ...]
) -> tuple[Term, ...]:
    """Return what a torque once per output turn may be that is too large to search beside."""
    names = [term.cause.name for term in known]
    if not record.weighty or any(name in names for name in _ONCE_PER_TURN):
        return ()
    found = {cause.name: cause for cause in causes}
    return tuple(Term(found[name], {}) for name in _ONCE_PER_TURN if name in found)


def _evident(
    record: Record, known: tuple[Term, ...], weight: tuple[Term, ...], fit: JointFit, noise: Noise
) -> Accepted:
    """Return the torque once per output turn as accepted, with its score."""
    without = fit_jointly(record, known, noise.whitener, refine=False)
    statistic = without.chi2 - fit.chi2
    paid = len(weight[0].cause.linear) * float(np.log(float(noise.whitener.used.sum())))
    chance = max(float(np.exp(-0.5 * statistic)), _SMALLEST)
    return Accepted(weight[0].cause.name, chance, 0.5 * (statistic - paid), weight, ())


def accepted_as(naming: Naming, false_alarm: float) -> Accepted:
    """Return a naming as accepted.

    Parameters
    ----------
    naming : Naming
        Best name, group and rivals.
    false_alarm : float
        Probability of such a finding without any effect.

    Returns
    -------
    Accepted
    """
    return Accepted(
        naming.best.term.cause.name,
        false_alarm,
        naming.best.score_nats,
        naming.group,
        naming.rivals,
        probability=naming.probability,
    )


def _signal(record: Record, fit: JointFit) -> FloatArray:
    """Return what is fitted without the causes that act on all of it, N m."""
    torque = fit.fitted_nm.copy()
    for term, linear in zip(fit.terms, fit.linear, strict=True):
        if term.cause.whole_signal:
            torque -= term_columns(term, record) @ linear
    return torque


def _beyond(record: Record, fit: JointFit) -> Beyond:
    """Return the terms of a fit: lines of the motor as orders, all others as torque."""
    torque = np.zeros(len(record.valid))
    orders = []
    for term, linear in zip(fit.terms, fit.linear, strict=True):
        line = term.cause.locked_to == "motor" and [*term.shape] == ["order"] and len(linear) == 2
        if line:
            orders.append(term.shape["order"])
        else:
            torque += term_columns(term, record) @ linear
    return Beyond(torque, tuple(orders))
