"""Accept, refit, drop, swap, look again: the loop that names causes of readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.loads.elements import accept_elements, elements_of
from hdbench.diagnosis.loads.families import Family, best_cell, family_cells
from hdbench.diagnosis.loads.fit import LoadFit, fit_loads, score_nats
from hdbench.diagnosis.loads.forms import outlier_cause
from hdbench.diagnosis.loads.misfit import is_misfit
from hdbench.diagnosis.loads.names import (
    Accepted,
    parameters_of,
    same_space,
    space_of,
    without,
)
from hdbench.diagnosis.loads.null import FamilyLook, look_at_families
from hdbench.diagnosis.loads.space import Space
from hdbench.diagnosis.loads.table import LoadTable
from hdbench.diagnosis.loads.trial import trial_fit
from hdbench.model import Cause
from hdbench.records.trace import FloatArray

__all__ = ["Found", "LoadSearch", "search_loads"]

_MAX_CAUSES = 8
# candidates refined at most, strongest first
_MAX_CANDIDATES = 8
# a swap must win by more than rounding
_SWAP_NATS = 0.1
_SWAP_ROUNDS = 3
# a limit far above the torque bends as a cube: what its shape gains is less than a shape costs
_SAME_NATS = 1.0


@dataclass(frozen=True, slots=True)
class Found:
    """Result of the search.

    Parameters
    ----------
    fit : LoadFit
        Final joint fit; terms that were known come first.
    space : Space
        Final residual.
    accepted : tuple of Accepted
        One for each cause that is not known, in order.
    looks : tuple of FamilyLook
        Looks at the final residual.
    """

    fit: LoadFit
    space: Space
    accepted: tuple[Accepted, ...]
    looks: tuple[FamilyLook, ...]


@dataclass(frozen=True, slots=True)
class _Candidate:
    term: Term
    fit: LoadFit
    score_nats: float


@dataclass(frozen=True, slots=True)
class LoadSearch:
    """What a search goes by.

    Parameters
    ----------
    base : ndarray, shape (n, p)
        Columns of the baseline.
    causes : tuple of Cause
        Causes that may be named.
    alpha : float
        False-alarm rate of the whole search.
    rng : Generator
        For the draws of the null.
    """

    base: FloatArray
    causes: tuple[Cause, ...]
    alpha: float
    rng: np.random.Generator

    def families(self, fit: LoadFit, space: Space) -> list[Family]:
        """Return every family that the residual of a fit could show.

        Of a cause that the fit holds already only the form in which it does.
        """
        held = {term.cause.name: term.cause.locked_to for term in fit.terms}
        causes = (c for c in self.causes if held.get(c.name, c.locked_to) == c.locked_to)
        made = (family_cells(c, fit.table, space) for c in (*causes, outlier_cause()))
        return [family for family in made if family is not None]

    def candidates(self, fit: LoadFit, looks: Sequence[FamilyLook]) -> list[_Candidate]:
        """Return the strongest looks refined with all that was accepted, best score first."""
        worth = sorted(looks, key=lambda look: look.p_value)[:_MAX_CANDIDATES]
        done = []
        space = space_of(fit)
        for look in worth:
            trial = trial_fit(look.family, fit, self.base, space)
            if trial is None or not _inside_domain(trial):
                continue
            added = parameters_of(trial.terms[-1], fit, trial)
            done.append(_Candidate(trial.terms[-1], trial, score_nats(fit, trial, added)))
        # among equal scores the name with fewer free shapes comes first, then the catalogue's order
        order = [cause.name for cause in self.causes]
        return sorted(done, key=lambda c: (-round(c.score_nats, 3), _rank(c.term, order)))


def search_loads(table: LoadTable, search: LoadSearch, known: Sequence[Term]) -> Found:
    """Name causes until nothing passes the false-alarm rate, or eight were named.

    Parameters
    ----------
    table : LoadTable
        Readings.
    search : LoadSearch
        Baseline, causes and false-alarm rate.
    known : sequence of Term
        Causes that the model already holds: fitted, not reported.

    Returns
    -------
    Found
    """
    n_known = len(known)
    fit = fit_loads(table, search.base, tuple(known))
    chances: dict[str, float] = {}
    while True:
        space = space_of(fit)
        looks = _looks(fit, space, search)
        alarms = [look for look in looks if look.false_alarm < search.alpha]
        if not alarms or len(fit.terms) - n_known >= _MAX_CAUSES:
            break
        ranked = search.candidates(fit, looks)
        if not ranked or ranked[0].score_nats <= 0.0:
            break
        best = _simplest(ranked, space)
        if is_misfit(best.term, best.fit, best.score_nats, fit, search.base):
            break
        chances.setdefault(best.term.cause.name, min(look.false_alarm for look in alarms))
        fit = _dropped(best.fit, search, n_known)
        fit = _swapped(fit, search, n_known)
    common = max(chances.values(), default=1.0)
    accepted = tuple(
        accept_elements(
            fit,
            places,
            search.base,
            search.families,
            chances.get(fit.terms[places[0]].cause.name, common),
        )
        for places in elements_of(fit, n_known)
    )
    return _with_made(Found(fit, space, accepted, looks), search)


def _with_made(found: Found, search: LoadSearch) -> Found:
    """Return what was found with causes that are made of other terms than the fit holds."""
    gone = {place for one in found.accepted if one.made_of for place in one.places}
    if not gone:
        return found
    kept = [place for place in range(len(found.fit.terms)) if place not in gone]
    terms, accepted = [found.fit.terms[place] for place in kept], []
    for one in found.accepted:
        if one.made_of:
            places = tuple(range(len(terms), len(terms) + len(one.made_of)))
            terms += one.made_of
            accepted.append(replace(one, places=places, alone=None))
        else:
            accepted.append(replace(one, places=tuple(kept.index(place) for place in one.places)))
    fit = fit_loads(found.fit.table, search.base, tuple(terms))
    space = space_of(fit)
    return Found(fit, space, tuple(accepted), _looks(fit, space, search))


def _simplest(ranked: Sequence[_Candidate], space: Space) -> _Candidate:
    """Return the best candidate, or one without a shape that is the same on these readings."""
    best = ranked[0]
    near = (c for c in ranked if best.score_nats - c.score_nats < _SAME_NATS)
    plain = [c for c in near if not c.term.cause.shape] if best.term.cause.shape else []
    table = best.fit.table
    return next((c for c in plain if same_space(space, table, best.term, c.term)), best)


def _rank(term: Term, order: Sequence[str]) -> tuple[int, int]:
    """Return what decides between equal scores."""
    name = term.cause.name
    return len(term.cause.shape), order.index(name) if name in order else len(order)


def _inside_domain(fit: LoadFit) -> bool:
    """Return whether the last term's linear parameters lie in the domain of the catalogue."""
    parameters = fit.terms[-1].cause.linear
    return all(p.contains(x) for p, x in zip(parameters, fit.linear[-1].tolist(), strict=True))


def _looks(fit: LoadFit, space: Space, search: LoadSearch) -> tuple[FamilyLook, ...]:
    # a share needs a rest to be a share of
    if space.dof < 2:
        return ()
    return look_at_families(space, search.families(fit, space), search.rng)


def _dropped(fit: LoadFit, search: LoadSearch, n_known: int) -> LoadFit:
    """Return the fit without the terms that a later one has made needless."""
    place = n_known
    while place < len(fit.terms) - 1:
        less = fit_loads(fit.table, search.base, without(fit.terms, place))
        if score_nats(less, fit, parameters_of(fit.terms[place], less, fit)) < 0.0:
            fit = less
        else:
            place += 1
    return fit


def _swapped(fit: LoadFit, search: LoadSearch, n_known: int) -> LoadFit:
    """Return the fit with terms replaced by names that explain more beside all others."""
    if len(fit.terms) - n_known < 2:
        return fit
    for _ in range(_SWAP_ROUNDS):
        before = fit
        for place in range(n_known, len(fit.terms)):
            less = fit_loads(fit.table, search.base, without(fit.terms, place))
            mine = score_nats(less, fit, parameters_of(fit.terms[place], less, fit))
            best = _best_instead(less, search)
            if best is not None and best.score_nats > mine + _SWAP_NATS:
                fit = best.fit
        if fit is before:
            break
    return fit


def _best_instead(less: LoadFit, search: LoadSearch) -> _Candidate | None:
    """Return the best single addition to a fit by score."""
    space = space_of(less)
    if space.dof < 2:
        return None
    found = (
        (family, best_cell(family, less.table, space, less.slope_v_per_nm))
        for family in search.families(less, space)
    )
    tops = [(space.share(cell.directions), family) for family, cell in found if cell is not None]
    tops.sort(key=lambda top: -top[0])
    done: list[_Candidate] = []
    for _, family in tops[:_MAX_CANDIDATES]:
        trial = trial_fit(family, less, search.base, space)
        if trial is None or not _inside_domain(trial):
            continue
        score = score_nats(less, trial, parameters_of(trial.terms[-1], less, trial))
        done.append(_Candidate(trial.terms[-1], trial, score))
    # the first of equal scores, as they are ordered by what they explain
    done.sort(key=lambda one: -one.score_nats)
    return _simplest(done, space) if done else None
