"""Accept, refit, look again: the loop that names causes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hdbench.diagnosis.challengers import Left
from hdbench.diagnosis.families import sharpen_step
from hdbench.diagnosis.jointfit import JointFit, fit_jointly
from hdbench.diagnosis.looks import Look, Looks, challenge, look_at
from hdbench.diagnosis.naming import Candidate, refine_candidate, same_space, unnamed
from hdbench.diagnosis.record import Beyond, Record
from hdbench.diagnosis.scan import LineScan, plan_scans
from hdbench.diagnosis.settle import Hidden, Noise, coarse_basis, settle
from hdbench.diagnosis.terms import Term, term_columns
from hdbench.diagnosis.whitened import Space, make_space
from hdbench.model import Cause

__all__ = ["RIVAL_NATS", "Accepted", "Found", "search"]

_MAX_CAUSES = 8
# names within this many nats of the best are rivals: a Bayes factor of 20
RIVAL_NATS = 3.0
# looks whose statistic is below this share of the best are refined only where no name pays for the
# others: the grid loses a tenth at most
_WORTH = 0.5
# candidates refined at most, strongest first
_MAX_CANDIDATES = 8


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
        Score at acceptance.
    group : tuple of Term
        Terms that span the same space on this record, the accepted one first.
    rivals : tuple of Term
        Other terms within 3 nats.
    """

    name: str
    false_alarm: float
    evidence_nats: float
    group: tuple[Term, ...]
    rivals: tuple[Term, ...]


@dataclass(frozen=True, slots=True)
class Found:
    """Result of the search.

    Parameters
    ----------
    fit : JointFit
        Final joint fit; terms that were known come first.
    noise : Noise
        Final noise.
    space : Space
        Final residual.
    accepted : tuple of Accepted
        One for each term that is not known, in order.
    left : tuple of Left
        What is left without a name.
    first, last : Looks
        Looks at the first and at the last residual.
    scans : tuple of LineScan
        Planned scans.
    record : Record
        Record that all of this is about: its motion may have been aligned anew.
    """

    fit: JointFit
    noise: Noise
    space: Space
    accepted: tuple[Accepted, ...]
    left: tuple[Left, ...]
    first: Looks
    last: Looks
    scans: tuple[LineScan, ...]
    record: Record


def _candidates(
    record: Record, space: Space, fit: JointFit, noise: Noise, looks: tuple[Look, ...]
) -> list[Candidate]:
    """Refine the strongest looks, best score first."""
    worth = sorted(looks, key=lambda look: -look.statistic)[:_MAX_CANDIDATES]
    terms = [sharpen_step(space, record, term) for look in worth for term in look.terms]
    done = [refine_candidate(record, fit, term, noise.whitener) for term in terms]
    # among equal scores the name with fewer free shapes comes first
    return sorted(done, key=lambda c: (-round(c.score_nats, 6), len(c.term.cause.shape)))


def _accept(record: Record, space: Space, ranked: list[Candidate], false_alarm: float) -> Accepted:
    best = ranked[0]
    group, rivals = [best.term], []
    for other in ranked[1:]:
        close = best.score_nats - other.score_nats <= RIVAL_NATS
        if unnamed(other.term) or other.term.cause.name == best.term.cause.name:
            continue
        if same_space(space, record, best.term, other.term):
            group.append(other.term)
        elif close:
            rivals.append(other.term)
    return Accepted(best.term.cause.name, false_alarm, best.score_nats, tuple(group), tuple(rivals))


def _next(
    record: Record, space: Space, fit: JointFit, noise: Noise, alarms: tuple[Look, ...]
) -> tuple[Accepted, JointFit] | None:
    """Return the best name for what raised an alarm, with its fit; None where no name pays."""
    top = max(look.statistic for look in alarms)
    strong = tuple(look for look in alarms if look.statistic >= _WORTH * top)
    weak = tuple(look for look in alarms if look.statistic < _WORTH * top)
    for part in (strong, weak):
        ranked = _candidates(record, space, fit, noise, part)
        if ranked and ranked[0].score_nats > 0.0:
            chance = min(look.false_alarm for look in alarms)
            return _accept(record, space, ranked, chance), ranked[0].fit
    return None


def search(
    record: Record,
    causes: tuple[Cause, ...],
    known: tuple[Term, ...],
    *,
    alpha: float,
    rng: np.random.Generator,
    progress: Callable[[str, float], None],
    align: Callable[[Beyond], Record] | None = None,
) -> Found:
    """Name causes until nothing passes the false-alarm rate, or eight were named.

    Parameters
    ----------
    record : Record
        Record.
    causes : tuple of Cause
        Catalogue.
    known : tuple of Term
        Causes that the model already holds: fitted, not reported.
    alpha : float
        False-alarm rate of the whole record.
    rng : Generator
        For the draws of the null.
    progress : callable
        Called with what is being done and the share done.
    align : callable or None
        Returns the record anew, given what was found; None where its motion does not depend on
        that.

    Returns
    -------
    Found
    """
    scans = plan_scans(record)
    hidden = Hidden(coarse_basis(record), scans)
    fit, noise = settle(record, known, None, hidden)
    accepted: list[Accepted] = []
    first: Looks | None = None
    while True:
        space = make_space(noise.whitener, fit.explained, record.response_nm)
        progress("scanning the residual", min(0.9, 0.1 + 0.2 * len(accepted)))
        looks = look_at(space, record, scans, causes, fit.terms, rng)
        first = first or looks
        alarms = tuple(look for look in looks.looks if look.false_alarm < alpha and look.terms)
        if not alarms or len(accepted) >= _MAX_CAUSES:
            break
        step = _next(record, space, fit, noise, alarms)
        if step is None:
            break
        accepted.append(step[0])
        fit = step[1]
        if align is not None:
            record = align(_beyond(record, fit))
            scans = plan_scans(record)
            hidden = Hidden(coarse_basis(record), scans)
        fit, noise = settle(record, fit.terms, noise, hidden)
        fit, noise, accepted = _drop(record, fit, noise, accepted, hidden)
    left = challenge(space, record, noise.model.innovation_std, alpha)
    return Found(fit, noise, space, tuple(accepted), tuple(left), first, looks, scans, record)


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


def _drop(
    record: Record, fit: JointFit, noise: Noise, accepted: list[Accepted], hidden: Hidden
) -> tuple[JointFit, Noise, list[Accepted]]:
    """Take out what a later cause has made needless."""
    n_known = sum(term.known for term in fit.terms)
    cost = 0.5 * float(np.log(float(noise.whitener.used.sum())))
    for index in range(len(accepted) - 1):
        place = n_known + index
        others = fit.terms[:place] + fit.terms[place + 1 :]
        without = fit_jointly(record, others, noise.whitener, refine=False)
        term = fit.terms[place]
        paid = len(term.cause.linear) + len(term.cause.shape)
        if 0.5 * (without.chi2 - fit.chi2) < cost * paid:
            kept = accepted[:index] + accepted[index + 1 :]
            fit, noise = settle(record, others, noise, hidden)
            return fit, noise, kept
    return (
        fit,
        noise,
        [
            replace(a, group=(t, *a.group[1:]))
            for a, t in zip(accepted, fit.terms[n_known:], strict=True)
        ],
    )
