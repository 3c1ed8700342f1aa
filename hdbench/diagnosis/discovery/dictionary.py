"""Dictionary: rows of all families, made once for a record and held against any residual."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.discovery.fit import Beside, Fit, scaled_rows
from hdbench.diagnosis.discovery.record import Record
from hdbench.diagnosis.discovery.tables import subsets_of
from hdbench.diagnosis.discovery.term import (
    WIDE,
    Term,
    harmonics,
    is_line,
    is_whole_share,
    term_columns,
)
from hdbench.diagnosis.evidence import PASSED, any_of, chi2_tail, chi2_tails
from hdbench.model import Cause, Motion, Parameter, shape_bounds
from hdbench.records.trace import FloatArray

# memory that the rows may take, bytes; families beyond it get fewer shapes
_MEMORY = 1.2e8
# one of so many coefficients, picked at random, stands for all where members are correlated
_SAMPLED = 6
_LEAST_SAMPLED = 4000
# directions of a member that hold less than this share of its information say nothing
_OWN = 1e-4
# rows are drawn in single precision: below this share of its power a row is rounding
_ROUNDING = 1e-5
# members of a name that are tried in pairs, and the rows that such a member may have
_PER_NAME, _NARROW = 3, 2
# draws of the null, and the level at which independent trials are counted
_DRAWS = 2000
_NONE = np.zeros((1, 0))
_LEVEL = 0.05
# points over special parameters, and over any other by how many the cause has; a resonance is
# some 8 % wide, and one that lies between two of the grid, a tenth apart, is seen by both
_SPECIAL = {
    "position_rad": 32,
    "width_turns": 2,
    "resonance_hz": 32,
    "damping": 1,
    "delay_s": 6,
    "sharpness": 4,
    "knee_ratio": 3,
}
_POINTS = {1: 12, 2: 6, 3: 4}
# orders of the drive's lobes, at which a cause with further shapes is tried
_ORDERS = (1.0, 2.0, 4.0, 6.0)
# samples on which members are compared: enough for every slow shape
_THIN = 4000
# a shape is left out where one that is kept has this share of its energy in common; less, until a
# family is no larger than this
_ALIKE = (0.9, 0.8, 0.65, 0.5)
_MOST_SHAPES = 16


@dataclass(frozen=True, slots=True)
class Member:
    """One term of the dictionary.

    Parameters
    ----------
    term : Term
        Cause with a shape.
    rows : slice
        Its rows.
    mix : ndarray or None, shape (n_rows, k)
        A part of the term, which is tried alone too: sums of its rows.
    """

    term: Term
    rows: slice
    mix: FloatArray | None = None

    def part(self, values: FloatArray) -> FloatArray:
        """Return the member's part of values of all rows along the last axis."""
        own = values[..., self.rows]
        return own if self.mix is None else own @ self.mix

    def square(self, products: FloatArray) -> FloatArray:
        """Return the member's part of products of all rows of its term, (..., k, k)."""
        return products if self.mix is None else self.mix.T @ products @ self.mix


@dataclass(frozen=True, slots=True)
class Look:
    """A member held against a residual.

    Parameters
    ----------
    term : Term
        Cause with a shape.
    statistic : float
        Fall of the weighted sum of squares.
    dof : int
        Directions that it has.
    trials : float
        Independent places that were looked at beside it.
    false_alarm : float
        Probability of one as large anywhere on this record without an effect.
    """

    term: Term
    statistic: float
    dof: int
    trials: float = 1.0
    false_alarm: float = 1.0


def _white(beside: Beside) -> NDArray[np.float32]:
    """Return the rows of a fit in white noise, in the precision of the dictionary."""
    white = np.empty(beside.rows.shape, dtype=np.float32)
    return np.multiply(beside.rows, beside.whitening, out=white, casting="same_kind")


@dataclass(slots=True)
class Dictionary:
    """Rows of all members.

    Parameters
    ----------
    members : tuple of Member
        Members, family by family.
    rows : ndarray of float32, shape (n_rows, size)
        Rows, each of unit root mean square before its transform.
    own : list of ndarray, shape (n_bands, k, k)
        Products of each member's rows.
    family_trials, all_trials : mapping, float
        Independent members of each family, and of all families together.
    """

    members: tuple[Member, ...]
    rows: NDArray[np.float32]
    own: list[FloatArray]
    family_trials: dict[str, float] = field(default_factory=dict)
    all_trials: float = 1.0

    def projected(self, beside: Beside) -> tuple[list[FloatArray], FloatArray]:
        """Return information of each member beside a fit, and the right side of all rows."""
        weight = 1.0 / beside.spectrum.power
        fast = beside.whitening.astype(np.float32)
        right = (self.rows @ (fast * beside.residual.astype(np.float32))).astype(np.float64)
        cross = beside.factor @ (_white(beside) @ self.rows.T).astype(np.float64)
        right = right - cross.T @ beside.free
        information = []
        for member, own in zip(self.members, self.own, strict=True):
            whole = np.tensordot(weight, own, 1)
            part = member.part(cross)
            information.append(whole - part.T @ part)
        return information, right

    def looks(self, beside: Beside) -> list[Look]:
        """Return every member held against a residual, the best first."""
        information, right = self.projected(beside)
        weight = 1.0 / beside.spectrum.power
        found = []
        for member, matrix, own in zip(self.members, information, self.own, strict=True):
            whole = np.einsum("b,bii->i", weight, own)
            statistic, dof = explained(matrix, member.part(right), whole)
            if not dof:
                continue
            trials = self.family_trials.get(member.term.name, 1.0)
            chance = chi2_tail(statistic, dof)
            within = any_of(chance, trials)
            anywhere = float(any_of(within, self.all_trials))
            found.append(Look(member.term, statistic, dof, trials, anywhere))
        return sorted(found, key=lambda look: round(4.0 * look.dof - look.statistic, 1))

    def pairs(self, beside: Beside, looks: list[Look]) -> list[tuple[Look, Look]]:
        """Return pairs of members of different names that explain most together.

        Two effects that nearly cancel or hide each other, as dry and viscous friction do at a wide
        transition, show as a pair where neither shows alone.
        """
        best: dict[str, list[Member]] = {}
        order = {(x.term.name, tuple(x.term.shape.items())): k for k, x in enumerate(looks)}
        whole = [
            m
            for m in self.members
            if m.mix is None
            and m.rows.stop - m.rows.start <= _NARROW
            and not is_whole_share(m.term.cause)
            and m.term.cause.possible is None
        ]
        for m in sorted(whole, key=lambda m: order.get(_identity(m.term), len(looks))):
            if len(best.setdefault(m.term.name, [])) < _PER_NAME:
                best[m.term.name].append(m)
        chosen = [m for family in best.values() for m in family]
        if len(chosen) < 2:
            return []
        picks = np.concatenate([np.arange(m.rows.start, m.rows.stop) for m in chosen])
        rows = self.rows[picks]
        cross = beside.factor @ (_white(beside) @ rows.T).astype(np.float64)
        gram = ((rows * beside.whitening.astype(np.float32)) @ rows.T).astype(np.float64)
        before = np.diag(gram)
        gram = gram - cross.T @ cross
        right = rows.astype(np.float64) @ (beside.whitening * beside.residual)
        right = right - cross.T @ beside.free
        ends = np.cumsum([m.rows.stop - m.rows.start for m in chosen])
        places = [
            np.arange(e - (m.rows.stop - m.rows.start), e)
            for m, e in zip(chosen, ends.tolist(), strict=True)
        ]
        alone = [explained(gram[np.ix_(p, p)], right[p], before[p])[0] for p in places]
        found: dict[tuple[str, str], tuple[float, Look, Look]] = {}
        for i, one in enumerate(chosen):
            for j in range(i):
                other = chosen[j]
                if one.term.name == other.term.name:
                    continue
                both = np.concatenate([places[i], places[j]])
                value, dof = explained(gram[np.ix_(both, both)], right[both], before[both])
                score = value - 4.0 * dof
                key = (one.term.name, other.term.name)
                if (
                    score > max(alone[i], alone[j]) + 4.0 * dof
                    and score > found.get(key, (0.0, None, None))[0]
                ):
                    found[key] = (
                        score,
                        Look(one.term, value, dof, self.family_trials.get(one.term.name, 1.0)),
                        Look(other.term, value, dof, self.family_trials.get(other.term.name, 1.0)),
                    )
        ranked = sorted(found.values(), key=lambda entry: -entry[0])
        return [(one, other) for _, one, other in ranked]

    def calibrate(self, fit: Fit, rng: np.random.Generator) -> None:
        """Draw the null of this record: how many members, and families, are independent."""
        if not self.members:
            return
        information, _ = self.projected(fit.beside())
        draws, ok = self._draws(fit, rng)
        chances: dict[str, FloatArray] = {}
        for member, matrix in zip(self.members, information, strict=True):
            part = member.part(draws)
            covariance = member.square(ok[member.rows, member.rows])
            value, vector = np.linalg.eigh(covariance)
            kept = value > _OWN * max(float(value[-1]), 1e-30)
            if not kept.any() or not np.any(np.diag(matrix) > 0.0):
                continue
            scores = (part @ vector[:, kept]) ** 2 / value[kept]
            chance = chi2_tails(scores.sum(axis=1), int(kept.sum()))
            name = member.term.name
            chances[name] = np.minimum(chances.get(name, np.ones(_DRAWS)), chance)
        families = []
        for name, smallest in chances.items():
            trials = _trials(smallest)
            self.family_trials[name] = trials
            families.append(any_of(smallest, trials))
        if families:
            self.all_trials = _trials(np.min(families, axis=0))

    def _draws(self, fit: Fit, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Return draws of all right sides without an effect, and their covariance."""
        size = self.rows.shape[1]
        count = min(size, max(_LEAST_SAMPLED, size // _SAMPLED))
        pick = np.sort(rng.permutation(size)[:count])
        weight = np.sqrt(fit.bands.spread(1.0 / fit.spectrum.power)[pick]).astype(np.float32)
        white = self.rows[:, pick] * weight
        base = (fit.rows[fit.active][:, pick] * weight).astype(np.float64)
        q = np.linalg.qr(base.T)[0].astype(np.float32)
        power = np.sum(white**2, axis=1)
        white = white - (white @ q) @ q.T
        # what rounding leaves of a row that others explain is nothing
        white[np.sum(white**2, axis=1) < _ROUNDING * power] = 0.0
        covariance = (white @ white.T).astype(np.float64)
        value, vector = np.linalg.eigh(covariance)
        root = vector * np.sqrt(np.maximum(value, 0.0))
        return rng.standard_normal((_DRAWS, len(root))) @ root.T, covariance


def explained(matrix: FloatArray, right: FloatArray, before: FloatArray) -> tuple[float, int]:
    """Return the fall of the weighted sum of squares, and the directions it took."""
    own, dof = own_directions(matrix, before)
    return float(np.sum((own.T @ right) ** 2)), dof


def own_directions(matrix: FloatArray, before: FloatArray) -> tuple[FloatArray, int]:
    """Return directions of unit information beside a fit that others cannot take, (k, dof).

    `before` is the information on each row alone.
    """
    scale = 1.0 / np.sqrt(np.maximum(before, 1e-300))
    if len(before) == 1:
        own = float(matrix[0, 0]) * float(scale[0]) ** 2
        return (np.full((1, 1), scale[0] / np.sqrt(own)), 1) if own > _OWN else (_NONE, 0)
    value, vector = np.linalg.eigh(matrix * np.outer(scale, scale))
    kept = value > _OWN
    return scale[:, None] * vector[:, kept] / np.sqrt(value[kept]), int(kept.sum())


def _identity(term: Term) -> tuple[str, tuple[tuple[str, float], ...]]:
    return term.name, tuple(term.shape.items())


def _trials(smallest: FloatArray) -> float:
    """Return how many independent trials have a smallest probability with this law."""
    level = float(np.quantile(smallest, _LEVEL))
    return max(1.0, float(np.log1p(-_LEVEL) / np.log1p(-min(level, 1.0 - 1e-12))))


def make_dictionary(record: Record, causes: Iterable[Cause], fit: Fit) -> Dictionary:
    """Return the dictionary of causes on a record."""
    families = [
        chosen_shapes(cause, record)
        for cause in causes
        if cause.additive and not is_line(cause) and cause.name != "zero-step"
    ]
    families = [family for family in families if family]
    most = int(_MEMORY / (4.0 * fit.bands.size))
    while sum(len(f[0].cause.linear) * len(f) for f in families) > most:
        longest = max(range(len(families)), key=lambda k: len(families[k]))
        if len(families[longest]) <= 1:
            break
        families[longest] = families[longest][::2]
    members: list[Member] = []
    total = sum(len(f[0].cause.linear) * len(f) for f in families)
    rows = np.empty((total, fit.bands.size), dtype=np.float32)
    at = 0
    for term in (t for family in families for t in family):
        columns = term_columns(term, record)
        if not np.any(columns):
            continue
        count = columns.shape[1]
        rows[at : at + count], scale = scaled_rows(fit.bands, columns)
        passed = float(np.sum(rows[at : at + count] ** 2)) / (count * len(record))
        if passed < PASSED:
            continue
        parts = harmonics(term.cause)
        mixes = [np.eye(count)[:, part] for part in parts] if len(parts) > 1 else []
        mixes += [scale[:, None] * subset for subset in subsets_of(term.cause)]
        members += [Member(term, slice(at, at + count), mix) for mix in (None, *mixes)]
        at += count
    rows = rows[:at]
    whole = {m.rows.start: _own(rows[m.rows], fit.bands.edges) for m in members if m.mix is None}
    return Dictionary(tuple(members), rows, [m.square(whole[m.rows.start]) for m in members])


def _own(rows: NDArray[np.float32], edges: NDArray[np.int64]) -> FloatArray:
    """Return the products of a member's rows in each band."""
    count = len(rows)
    out = np.empty((len(edges) - 1, count, count))
    if count <= 3:
        for i in range(count):
            for j in range(i + 1):
                out[:, i, j] = out[:, j, i] = np.add.reduceat(rows[i] * rows[j], edges[:-1])
        return out
    for k, (a, b) in enumerate(itertools.pairwise(edges)):
        out[k] = rows[:, a:b] @ rows[:, a:b].T
    return out


def shape_grid(cause: Cause, motion: Motion) -> list[Mapping[str, float]]:
    """Return a grid over the shapes of a cause; one empty mapping for a cause without any."""
    bounds = shape_bounds(cause, motion)
    count = _POINTS.get(len(cause.shape), 3)
    axes = [_axis(p, bounds[p.name], _SPECIAL.get(p.name, count)) for p in cause.shape]
    names = [p.name for p in cause.shape]
    return [dict(zip(names, map(float, point), strict=True)) for point in itertools.product(*axes)]


def _axis(parameter: Parameter, bands: tuple[tuple[float, float], ...], count: int) -> FloatArray:
    points = []
    for low, high in bands:
        if count == 1:
            points.append(np.array([float(np.sqrt(low * high)) if low > 0.0 else low]))
        elif parameter.name == "order":
            points.append(np.array([order for order in _ORDERS if low <= order <= high]))
        elif low > 0.0 and high > WIDE * low:
            points.append(np.geomspace(low, high, count))
        else:
            points.append(np.linspace(low, high, count))
    return np.concatenate(points) if points else np.zeros(0)


def chosen_shapes(cause: Cause, record: Record) -> list[Term]:
    """Return members of a family so that every point of a fine grid is like one of them.

    Members are compared on some thousand samples, the baseline projected out. What follows the
    motor, and a shift of the whole signal, is too fast for that and keeps its grid.
    """
    grid = shape_grid(cause, record.motion)
    if len(grid) <= 1 or cause.locked_to == "motor" or "delay_s" in grid[0]:
        return [Term(cause, shape) for shape in grid]
    step = max(1, len(record) // _THIN)
    motion, seen = _thinned(record.motion, step), record.valid[::step]
    base = np.linalg.qr(record.columns[::step])[0]
    shapes: list[tuple[Term, FloatArray]] = []
    for shape in grid:
        columns = np.where(seen[:, None], cause.columns(motion, shape), 0.0)
        if not np.isfinite(columns).all():
            return []
        before = float(np.sum(columns**2))
        columns = columns - base @ (base.T @ columns)
        # what the baseline explains but for rounding shows nothing
        if float(np.sum(columns**2)) > 1e-6 * before:
            shapes.append((Term(cause, shape), np.linalg.qr(columns)[0]))
    kept: list[Term] = []
    for alike in _ALIKE:
        kept = _unlike(shapes, alike)
        if len(kept) <= _MOST_SHAPES:
            break
    return kept


def _thinned(motion: Motion, step: int) -> Motion:
    """Return every `step`-th sample of a motion; a stretch starts where one left out started it."""
    changes: dict[str, Any] = {
        field.name: value[::step]
        for field in fields(motion)
        if isinstance(value := getattr(motion, field.name), np.ndarray)
    } | {"shown_by_angle": None}
    if motion.starts is not None:
        edges = np.arange(0, len(motion), step)
        changes["starts"] = np.logical_or.reduceat(motion.starts, edges)
    return replace(motion, **changes)


def _unlike(shapes: list[tuple[Term, FloatArray]], alike: float) -> list[Term]:
    """Return the terms of which none has more in common with one before it."""
    kept: list[tuple[Term, FloatArray]] = []
    for term, basis in shapes:
        like = (float(np.sum((b.T @ basis) ** 2)) / basis.shape[1] for _, b in kept)
        if max(like, default=0.0) < alike:
            kept.append((term, basis))
    return [term for term, _ in kept]
