"""Search: score, pick, refit all, prune, swap; names, groups and rivals from one table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hdbench.diagnosis.answer.result import Unexplained
from hdbench.diagnosis.evidence import (
    SAME_SPACE,
    probabilities,
    rivals,
    share_p_value,
    sine_squared,
)
from hdbench.diagnosis.loads.fit import LoadFit, Space, fit_loads
from hdbench.diagnosis.loads.forms import Form, Term
from hdbench.records.trace import FloatArray

__all__ = ["Accepted", "Look", "Search", "uneven_scatter", "without"]

# draws of the null: more where few degrees of freedom make them cheap and tails count
_LEAST_DRAWS, _MOST_DRAWS, _WORK = 2000, 10_000, 160_000
# the number of independent trials is counted where this many draws lie beyond
_BEYOND = 40
_SMALLEST = 1e-300
# candidates refined in a round, strongest first
_CANDIDATES = 8
# a swap must win by more than rounding
_SWAP_NATS = 0.1
_SWEEPS = 3
# a further name beside others must be worth this, a Bayes factor of 20 000: form errors are known
# by their order alone
_FURTHER_NATS = 10.0
# neighbours on a grid whose spaces differ by less than this (sine squared) are one
_SAME_CELL = 1e-3


@dataclass(frozen=True, slots=True)
class Family:
    """A form over its grid: members, and what the fit leaves of each."""

    form: Form
    cells: tuple[tuple[Term, FloatArray], ...]


@dataclass(frozen=True, slots=True)
class Look:
    """What a family shows of a residual, and how often noise shows as much."""

    family: Family
    best: int  # its best member
    p_value: float  # in this family
    false_alarm: float  # in all families
    trials: float  # independent ones, of the family times all families


@dataclass(frozen=True, slots=True)
class Accepted:
    """A cause or place of the final fit."""

    places: tuple[int, ...]  # its terms: several where one element does not do
    false_alarm: float
    nats: float  # against the fit without it
    group: tuple[str, ...]  # names of the same space, its own first
    rivals: tuple[str, ...]  # others within 3 nats
    probability: float | None  # of the group among all names
    alone: LoadFit | None = None  # one element in the place of several, last of its terms


def without(terms: Sequence[Term], places: Sequence[int]) -> tuple[Term, ...]:
    """Return the terms but for some."""
    return tuple(term for i, term in enumerate(terms) if i not in places)


@dataclass(frozen=True, slots=True)
class Search:
    """Search of a dictionary; the first `known` terms of a fit stay as they are."""

    base: FloatArray
    forms: tuple[Form, ...]
    alpha: float
    known: int
    rng: np.random.Generator
    grids: dict[int, list[tuple[Term, FloatArray]]] = field(default_factory=dict)

    def run(self, fit: LoadFit) -> tuple[LoadFit, dict[str, float], tuple[Look, ...]]:
        """Return the fit with all that is found, the chance of each name, and the last looks."""
        chances: dict[str, float] = {}
        while True:
            looks = self.looks(fit)
            alarms = [look for look in looks if look.false_alarm < self.alpha]
            ranked = self._ranked(fit, looks) if alarms else []
            needed = _FURTHER_NATS if len(fit.terms) > self.known else 0.0
            if not ranked or ranked[0].nats <= fit.nats + needed:
                return fit, chances, looks
            fit = ranked[0]
            chance = min(look.false_alarm for look in alarms)
            chances.setdefault(fit.terms[-1].name, chance)
            fit = self._swapped(self._pruned(fit))

    def families(self, fit: LoadFit, space: Space) -> list[Family]:
        """Return what the residual could show; of a name that is held only its form."""
        held = {term.name: term.form.label for term in fit.terms}
        made = []
        for number, form in enumerate(self.forms):
            if held.get(form.name, form.label) != form.label:
                continue
            cells: list[tuple[Term, FloatArray]] = []
            for term, columns in self._grid(number, fit):
                directions = space.directions(columns)
                if not 0 < directions.shape[1] < space.dof:
                    continue
                if not cells or form.whole or sine_squared(cells[-1][1], directions) >= _SAME_CELL:
                    cells.append((term, directions))
            if cells:
                made.append(Family(form, tuple(cells)))
        return made

    def _grid(self, number: int, fit: LoadFit) -> list[tuple[Term, FloatArray]]:
        """Return the members of a form with their columns: most do not depend on the fit."""
        form = self.forms[number]
        if form.cause.whole_signal or number not in self.grids:
            made = [(term, term.columns(fit.table)) for term in form.grid(fit.table)]
            self.grids[number] = made
        return self.grids[number]

    def looks(self, fit: LoadFit) -> tuple[Look, ...]:
        """Return what each family shows, and how often noise shows as much.

        The share of the residual along k directions of d has the law Beta(k/2, (d - k)/2) for noise
        of any size: draws of unit noise are the exact null. The smallest p-value over a family's
        members, and then over families, is a minimum of M trials, ``1 - (1 - p)^M``.
        """
        space = fit.space()
        families = self.families(fit, space) if space.dof > 1 else []
        if not families:
            return ()
        draws = int(np.clip(_WORK // space.dof, _LEAST_DRAWS, _MOST_DRAWS))
        noise = self.rng.standard_normal((space.dof, draws))
        noise /= np.sqrt(np.einsum("nd,nd->d", noise, noise))
        drawn, counts, seen = [], [], []
        for family in families:
            ranks = np.array([directions.shape[1] for _, directions in family.cells])
            edges = np.concatenate(([0], np.cumsum(ranks)[:-1]))
            stacked = np.hstack([directions for _, directions in family.cells])
            shares = np.add.reduceat((stacked.T @ noise) ** 2, edges, axis=0)
            lowest = _lowest_p(shares, ranks, space.dof)
            counts.append(_trials(lowest))
            drawn.append(_any_of(lowest, counts[-1]))
            mine = [space.share(directions) for _, directions in family.cells]
            p = [share_p_value(s, int(k), space.dof) for s, k in zip(mine, ranks, strict=True)]
            best = min(range(len(p)), key=lambda i: (p[i], -mine[i]))
            seen.append((best, float(_any_of(np.array(p[best]), counts[-1]))))
        total = _trials(np.min(drawn, axis=0))
        return tuple(
            Look(family, best, p, float(_any_of(np.array(p), total)), count * total)
            for family, (best, p), count in zip(families, seen, counts, strict=True)
        )

    def trial(self, family: Family, less: LoadFit, space: Space) -> LoadFit | None:
        """Fit the best member of a family beside the terms of a fit; None outside its domain."""
        if family.form.whole:
            used, slope = space.used, less.slope_v_per_nm

            def left(cell: tuple[Term, FloatArray]) -> float:
                taken = slope * (space.basis.T @ cell[0].columns(less.table)[used, 0])
                return float(np.sum((space.residual_v - taken) ** 2))

            start = min(family.cells, key=left)[0]
        else:
            start = max(family.cells, key=lambda cell: space.share(cell[1]))[0]
        fit = fit_loads(less.table, self.base, (*less.terms, start))
        values, form = fit.linear[-1].tolist(), family.form
        own = zip(form.parameters, values, strict=False)
        inside = all(p.contains(x) for p, x in own) and all(
            x <= 0.0 for x in values[len(form.parameters) :]
        )
        return fit if inside else None

    def _ranked(self, fit: LoadFit, looks: Sequence[Look]) -> list[LoadFit]:
        """Return the strongest looks fitted with all that was accepted, best evidence first."""
        space = fit.space()
        worth = sorted(looks, key=lambda look: look.p_value)[:_CANDIDATES]
        done = [t for look in worth if (t := self.trial(look.family, fit, space)) is not None]
        # among equals the name with fewer free shapes
        return sorted(done, key=lambda t: (-round(t.nats, 3), len(t.terms[-1].form.shape)))

    def _pruned(self, fit: LoadFit) -> LoadFit:
        """Return the fit without terms that a later one has made needless."""
        place = self.known
        while place < len(fit.terms) - 1:
            less = fit_loads(fit.table, self.base, without(fit.terms, (place,)))
            if less.nats > fit.nats:
                fit = less
            else:
                place += 1
        return fit

    def _swapped(self, fit: LoadFit) -> LoadFit:
        """Return the fit with terms replaced by what explains more beside all others."""
        if len(fit.terms) - self.known < 2:
            return fit
        for _ in range(_SWEEPS):
            before = fit
            for place in range(self.known, len(fit.terms)):
                less, others = self.instead(fit, (place,))
                best = max(others.values(), key=lambda other: other.nats, default=less)
                if best.nats > fit.nats + _SWAP_NATS:
                    fit = best
            if fit is before:
                break
        return fit

    def instead(self, fit: LoadFit, places: Sequence[int]) -> tuple[LoadFit, dict[str, LoadFit]]:
        """Return the fit without some terms, and with each name's best form in their place."""
        less = fit_loads(fit.table, self.base, without(fit.terms, places), refine=False)
        space = less.space()
        best: dict[str, LoadFit] = {}
        for family in self.families(less, space):
            done = self.trial(family, less, space)
            if done is not None:
                name = family.form.name
                best[name] = max((done, best.get(name, done)), key=lambda one: one.nats)
        return less, best

    def accepted(self, fit: LoadFit, chances: dict[str, float]) -> tuple[Accepted, ...]:
        """Return what was found with the names that it could also have."""
        causes: dict[object, list[int]] = {}
        for place, term in enumerate(fit.terms[self.known :], self.known):
            causes.setdefault(place if term.form.discrete else term.name, []).append(place)
        common = max(chances.values(), default=1.0)
        return tuple(
            self._named(fit, tuple(places), chances.get(fit.terms[places[0]].name, common))
            for places in causes.values()
        )

    def _named(self, fit: LoadFit, places: tuple[int, ...], chance: float) -> Accepted:
        term = fit.terms[places[0]]
        less, others = self.instead(fit, places)
        gain = fit.nats - less.nats
        if "place" in term.shape:
            return Accepted(places, chance, gain, (term.name,), (), None)
        space = less.space()
        mine = space.directions(term.columns(fit.table))
        table = {k: o.nats for k, o in others.items() if "place" not in o.terms[-1].shape}
        if len(places) > 1 and term.name in table:
            # one element misses by more than form error: all are held against it without any
            table = {name: others[name].plain_nats for name in table}
        else:
            table[term.name] = max(fit.nats, table.get(term.name, fit.nats))
        same = [
            name
            for name in table
            if name != term.name
            and sine_squared(mine, space.directions(others[name].terms[-1].columns(fit.table)))
            < SAME_SPACE
        ]
        share = probabilities(table)
        near = tuple(name for name in rivals(table, term.name) if name not in same)
        group = (term.name, *same)
        alone = others.get(term.name) if len(places) > 1 else None
        likely = sum(share[name] for name in group)
        return Accepted(places, chance, gain, group, near, likely, alone)


def _lowest_p(shares: FloatArray, ranks: FloatArray, dof: int) -> FloatArray:
    """Return the smallest p-value over members, shape (n_draws,), of shares (n_cells, n_draws)."""
    from scipy.special import betainc

    best = np.ones(shares.shape[1])
    for rank in np.unique(ranks):
        # at equal rank the largest share has the smallest p-value
        top = np.clip(1.0 - shares[ranks == rank].max(axis=0), 0.0, 1.0)
        best = np.minimum(best, betainc((dof - rank) / 2.0, rank / 2.0, top))
    return np.asarray(best)


def _trials(p_values: FloatArray) -> float:
    """Return how many independent trials a smallest p-value of these draws amounts to."""
    beyond = _BEYOND / len(p_values)
    level = float(np.quantile(p_values, beyond))
    return max(1.0, -float(np.log1p(-beyond)) / max(level, _SMALLEST))


def _any_of(p_value: FloatArray, trials: float) -> FloatArray:
    """Return ``1 - (1 - p)^trials`` without loss for small p."""
    return np.asarray(-np.expm1(trials * np.log1p(-np.minimum(p_value, 1.0 - 1e-16))))


def uneven_scatter(
    fit: LoadFit, baseline: LoadFit, alpha: float, rng: np.random.Generator
) -> Unexplained | None:
    """Return the scatter's change with the torque where noise of one size does not make it."""
    from scipy.special import ndtr

    used, space = fit.table.used, fit.space()
    size = np.abs(fit.table.torque_nm[used])
    if space.dof < 2 or not float(np.ptp(size)) > 0.0:
        return None
    weight = (size - size.mean()) / float(np.abs(size - size.mean()).max())

    def odds(left: FloatArray) -> FloatArray:
        square = (space.basis @ left) ** 2
        trend = weight @ square / square.sum(axis=0)
        # the law of the trend leans to one side: its logarithmic odds are nearer to normal
        return np.asarray(np.log1p(trend) - np.log1p(-trend))

    drawn = odds(rng.standard_normal((space.dof, _LEAST_DRAWS)))
    place = float((odds(space.residual_v[:, None])[0] - drawn.mean()) / drawn.std())
    # two sides, and twice that: beyond 1e-3 the odds lie up to 1.7 times as often as a normal value
    chance = min(1.0, float(4.0 * ndtr(-abs(place))))
    if not chance < alpha:
        return None
    square = (space.basis @ space.residual_v) ** 2 / fit.slope_v_per_nm**2
    heavy = (size >= np.median(size)) == (place > 0.0)
    extent = (float(size[heavy].min()), float(size[heavy].max()))
    spread = float(np.sqrt(square[heavy].mean()))
    whole = baseline.rss / baseline.slope_v_per_nm**2
    share = min(1.0, float(square[heavy].sum()) / max(whole, 1e-300))
    return Unexplained("variance", 0.5 * sum(extent), extent, "N m", spread, share, chance)
