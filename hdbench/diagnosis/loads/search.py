"""Search: score, pick, refit all, prune, swap; names, groups and rivals from one table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hdbench.diagnosis.evidence import (
    SAME_SPACE,
    any_of,
    probabilities,
    rivals,
    share_p_value,
    sine_squared,
)
from hdbench.diagnosis.loads.fit import LoadFit, Space
from hdbench.diagnosis.loads.forms import Form, Term
from hdbench.records.trace import FloatArray
from hdbench.results.diagnosis import Unexplained

# a member of a form, and what a fit leaves of its columns
Cell = tuple[Term, FloatArray]


@dataclass(frozen=True, slots=True)
class Look:
    """What a form shows of a residual, and how often noise shows as much."""

    form: Form
    cells: Sequence[Cell]
    rank: int  # of its best member
    p_value: float  # in this form
    false_alarm: float  # in all forms
    trials: float  # independent ones, of the form times all forms


@dataclass(frozen=True, slots=True)
class Accepted:
    """A cause or place of the final fit."""

    places: tuple[int, ...]  # its terms: several where one element does not do
    false_alarm: float
    nats: float  # against the fit without it
    group: tuple[str, ...]  # names of the same space, its own first
    rivals: tuple[str, ...] = ()  # others within 3 nats
    probability: float | None = None  # of the group among all names
    alone: LoadFit | None = None  # one element in the place of several, last of its terms


@dataclass(frozen=True, slots=True)
class Search:
    """Search of a dictionary; the first `held` terms of a fit stay as they are."""

    forms: tuple[Form, ...]
    alpha: float
    held: int
    rng: np.random.Generator
    grids: dict[int, list[tuple[Term, FloatArray]]] = field(default_factory=dict)

    def run(self, fit: LoadFit) -> tuple[LoadFit, dict[str, float], tuple[Look, ...]]:
        """Return the fit with all that is found, the chance of each name, and the last looks."""
        chances: dict[str, float] = {}
        while True:
            looks = self.looks(fit)
            alarm = min((look.false_alarm for look in looks), default=1.0)
            ranked = self._ranked(fit, looks) if alarm < self.alpha else []
            # a further name beside others must be worth this, a Bayes factor of 20 000: form errors
            # are known by their order alone
            needed = 10.0 if len(fit.terms) > self.held else 0.0
            if not ranked or ranked[0].nats <= fit.nats + needed:
                return fit, chances, looks
            fit = ranked[0]
            chances.setdefault(fit.terms[-1].name, alarm)
            fit = self._settled(fit)

    def members(self, fit: LoadFit, space: Space) -> list[tuple[Form, list[Cell]]]:
        """Return what the residual could show; of a name that is held only its form."""
        held = {term.name: term.form.label for term in fit.terms}
        made = []
        for number, form in enumerate(self.forms):
            if held.get(form.name, form.label) != form.label:
                continue
            cells: list[Cell] = []
            for term, columns in self._grid(number, fit):
                directions = space.directions(columns)
                if not 0 < directions.shape[1] < space.dof:
                    continue
                # neighbours on a grid whose spaces differ by less than this (sine squared) are one
                if not cells or form.whole or sine_squared(cells[-1][1], directions) >= 1e-3:
                    cells.append((term, directions))
            if cells:
                made.append((form, cells))
        return made

    def _grid(self, number: int, fit: LoadFit) -> list[tuple[Term, FloatArray]]:
        """Return the members of a form with their columns: most do not depend on the fit."""
        form = self.forms[number]
        if form.cause.whole_signal or number not in self.grids:
            made = [(term, term.columns(fit.table)) for term in form.grid(fit.table)]
            self.grids[number] = made
        return self.grids[number]

    def looks(self, fit: LoadFit) -> tuple[Look, ...]:
        """Return what each form shows, and how often noise shows as much in any of them."""
        space = fit.space()
        members = self.members(fit, space) if space.dof > 1 else []
        if not members:
            return ()
        # more draws where few degrees of freedom make them cheap and tails count
        draws = int(np.clip(160_000 // space.dof, 2000, 10_000))
        # the share along some directions has one law for noise of any size: unit noise is the null
        noise = self.rng.standard_normal((space.dof, draws))
        noise /= np.sqrt(np.einsum("nd,nd->d", noise, noise))
        drawn, seen = [], []
        for _, cells in members:
            ranks = np.array([directions.shape[1] for _, directions in cells])
            edges = np.concatenate(([0], np.cumsum(ranks)[:-1]))
            stacked = np.hstack([directions for _, directions in cells])
            shares = np.add.reduceat((stacked.T @ noise) ** 2, edges, axis=0)
            mine = np.array([[space.share(directions)] for _, directions in cells])
            lowest, _ = _lowest_p(shares, ranks, space.dof)
            own, rank = _lowest_p(mine, ranks, space.dof)
            count = _trials(lowest)
            drawn.append(any_of(lowest, count))
            seen.append((rank, float(any_of(own, count)[0]), count))
        total = _trials(np.min(drawn, axis=0))
        return tuple(
            Look(form, cells, rank, p, float(any_of(p, total)), count * total)
            for (form, cells), (rank, p, count) in zip(members, seen, strict=True)
        )

    def trial(
        self, form: Form, cells: Sequence[Cell], less: LoadFit, space: Space
    ) -> LoadFit | None:
        """Fit the best member of a form beside the terms of a fit; None outside its domain."""

        def left(cell: Cell) -> float:
            if not form.whole:
                return -space.share(cell[1])
            taken = less.slope_v_per_nm * cell[0].columns(less.table)[space.used, 0]
            return float(np.sum((space.residual_v - space.basis.T @ taken) ** 2))

        fit = less.refit((*less.terms, min(cells, key=left)[0]), refine=True)
        values = fit.linear[-1].tolist()
        own, beside = values[: len(form.parameters)], values[len(form.parameters) :]
        inside = all(p.contains(x) for p, x in zip(form.parameters, own, strict=True))
        return fit if inside and max(beside, default=0.0) <= 0.0 else None

    def _ranked(self, fit: LoadFit, looks: Sequence[Look]) -> list[LoadFit]:
        """Return the strongest looks fitted with all that was accepted, best evidence first."""
        space = fit.space()
        # candidates refined in a round, strongest first
        worth = sorted(looks, key=lambda look: look.p_value)[:8]
        tried = (self.trial(look.form, look.cells, fit, space) for look in worth)
        # among equals the name with fewer free shapes
        return sorted(
            (one for one in tried if one is not None),
            key=lambda one: (-round(one.nats, 3), len(one.terms[-1].form.shape)),
        )

    def _settled(self, fit: LoadFit) -> LoadFit:
        """Return the fit with terms dropped or replaced where the rest explains more."""
        place = self.held
        while place < len(fit.terms) > self.held + 1:
            less, others = self._instead(fit, (place,))
            best = max((less, *others.values()), key=lambda one: one.nats)
            # a swap must win by more than rounding
            better = best.nats > fit.nats + 0.1
            fit, place = (best, self.held) if better else (fit, place + 1)
        return fit

    def _instead(self, fit: LoadFit, places: Sequence[int]) -> tuple[LoadFit, dict[str, LoadFit]]:
        """Return the fit without some terms, and with each name's best form in their place."""
        less = fit.refit(fit.others(places))
        space = less.space()
        best: dict[str, LoadFit] = {}
        for form, cells in self.members(less, space):
            done = self.trial(form, cells, less, space)
            if done is not None and (form.name not in best or done.nats > best[form.name].nats):
                best[form.name] = done
        return less, best

    def accepted(self, fit: LoadFit, chances: dict[str, float]) -> tuple[Accepted, ...]:
        """Return what was found with the names that it could also have."""
        causes: dict[object, list[int]] = {}
        for place, term in enumerate(fit.terms[self.held :], self.held):
            one = term.form.smooth == term.form.shape
            causes.setdefault(term.name if one else place, []).append(place)
        common = max(chances.values(), default=1.0)
        return tuple(
            self._named(fit, tuple(places), chances.get(fit.terms[places[0]].name, common))
            for places in causes.values()
        )

    def _named(self, fit: LoadFit, places: tuple[int, ...], chance: float) -> Accepted:
        term = fit.terms[places[0]]
        name = term.name
        less, others = self._instead(fit, places)
        gain = fit.nats - less.nats
        if term.unnamed:
            return Accepted(places, chance, gain, (name,))
        others = {k: other for k, other in others.items() if not other.terms[-1].unnamed}
        table = {k: other.nats for k, other in others.items()}
        alone = others.get(name) if len(places) > 1 else None
        if alone is not None:
            # one element misses by more than form error: all are held against it without any
            table = {k: other.plain_nats for k, other in others.items()}
        else:
            table[name] = max(fit.nats, table.get(name, fit.nats))
        space = less.space()
        mine = space.directions(term.columns(fit.table))
        same = [
            k
            for k, other in others.items()
            if k != name
            and sine_squared(mine, space.directions(other.terms[-1].columns(fit.table)))
            < SAME_SPACE
        ]
        near = tuple(k for k in rivals(table, name) if k not in same)
        share = probabilities(table)
        likely = sum(share[k] for k in (name, *same))
        return Accepted(places, chance, gain, (name, *same), near, likely, alone)


def _lowest_p(shares: FloatArray, ranks: FloatArray, dof: int) -> tuple[FloatArray, int]:
    """Return the smallest p-value over members of a form, and the rank of one."""
    # at equal rank the largest share has the smallest p-value
    kinds = np.unique(ranks).tolist()
    best = [share_p_value(shares[ranks == rank].max(axis=0), rank, dof) for rank in kinds]
    return np.min(best, axis=0), kinds[int(np.argmin(np.array(best)[:, 0]))]


def _trials(p_values: FloatArray) -> float:
    """Return how many independent trials a smallest p-value of these draws amounts to."""
    # the number of independent trials is counted where this many draws lie beyond
    beyond = 40 / len(p_values)
    level = float(np.quantile(p_values, beyond))
    return max(1.0, -float(np.log1p(-beyond)) / max(level, float(np.finfo(float).tiny)))


def uneven_scatter(
    fit: LoadFit, baseline: LoadFit, alpha: float, rng: np.random.Generator
) -> Unexplained | None:
    """Return the scatter's change with the torque where noise of one size does not make it."""
    from scipy.special import ndtr

    space = fit.space()
    size = np.abs(fit.table.torque_nm[space.used])
    if space.dof < 2 or not float(np.ptp(size)) > 0.0:
        return None
    weight = (size - size.mean()) / float(np.abs(size - size.mean()).max())

    def odds(left: FloatArray) -> FloatArray:
        square = (space.basis @ left) ** 2
        trend = weight @ square / square.sum(axis=0)
        # the law of the trend leans to one side: its logarithmic odds are nearer to normal
        return np.asarray(np.log1p(trend) - np.log1p(-trend))

    drawn = odds(rng.standard_normal((space.dof, 2000)))
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
    return Unexplained(
        domain="variance",
        location=0.5 * sum(extent),
        extent=extent,
        unit="N m",
        size_nm=spread,
        share_of_variance=share,
        false_alarm_probability=chance,
    )
