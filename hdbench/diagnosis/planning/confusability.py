"""Effects that a motion shows, how large they must be, and which of them look alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.evidence import RANK, SAME_SPACE, Told, chi2_level, silent
from hdbench.diagnosis.planning.frame import ROWS, Frame, Noise, make_frame
from hdbench.diagnosis.planning.signatures import (
    Effect,
    Shape,
    fitted_shape,
    line_key,
    line_length,
    line_shapes,
    shape_axes,
    shape_grid,
)
from hdbench.model import Cause, Motion
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray

# the literature's line between what is told apart and what is not, by share of the effect
CONFUSABLE = 0.25
# one name contains another where this little of it is left: the rounding of projections
_CONTAINED = 1e-6
# why an effect is not seen that the baseline holds already
HELD = "the baseline imitates it"


@dataclass(frozen=True, slots=True)
class Visibility:
    """Whether a motion shows an effect: why not, where it does not."""

    name: str
    reason: str
    baseline_share: float = 1.0  # that the baseline imitates
    std_nm: float | None = None  # Cramer-Rao bound of its peak torque
    detectable_nm: float | None = None  # peak torque that is found with 90 %


@dataclass(frozen=True, slots=True)
class Confusability:
    """How alike effects are on a motion."""

    names: tuple[str, ...]
    # share of effect i that effect j with any shape, and the baseline, cannot imitate; NaN where
    # either cannot be seen and on the diagonal
    sin2: FloatArray
    visibility: tuple[Visibility, ...]
    duration_s: float

    def share(self, first: str, second: str) -> float | None:
        """Return the share of the first that the second cannot imitate; None if not compared."""
        value = float(self.sin2[self.names.index(first), self.names.index(second)])
        return value if np.isfinite(value) else None

    @property
    def _contained(self) -> NDArray[np.bool_]:
        return (self.sin2 <= _CONTAINED) & (self.sin2.T > SAME_SPACE)

    def contained(self) -> tuple[tuple[str, str], ...]:
        """Return pairs (i, j) where i is a special case of j: j imitates it, not the reverse."""
        return tuple((self.names[i], self.names[j]) for i, j in np.argwhere(self._contained))

    def confusable(self) -> tuple[tuple[str, str, float], ...]:
        """Return ordered pairs that are not told apart, but for contained ones, nearest first."""
        near = np.argwhere((self.sin2 < CONFUSABLE) & ~self._contained)
        pairs = [(self.names[i], self.names[j], float(self.sin2[i, j])) for i, j in near]
        return tuple(sorted(pairs, key=lambda pair: pair[2]))

    def inseparable(self) -> tuple[tuple[str, ...], ...]:
        """Return groups of names that imitate each other within `SAME_SPACE`, both ways."""
        alike = (self.sin2 < SAME_SPACE) & (self.sin2.T < SAME_SPACE)
        np.fill_diagonal(alike, True)
        # names that any chain of such pairs joins
        reached = np.linalg.matrix_power(alike, len(alike))
        groups = {tuple(np.flatnonzero(row).tolist()) for row in reached}
        ordered = sorted((group for group in groups if len(group) > 1), key=lambda group: group[-1])
        return tuple(tuple(self.names[i] for i in group) for group in ordered)


@dataclass(frozen=True, slots=True)
class Target:
    """An effect to be imitated: its rows among those of all targets, and its peak torque."""

    effect: Effect
    rows: slice
    peak_nm: float


@dataclass(slots=True)
class Family:
    """A cause with all shapes that were tried, and their products in each block."""

    cause: Cause
    shapes: list[Shape]
    own: FloatArray  # of the rows of each shape, (n_blocks, n, k, k)
    cross: FloatArray  # with the rows of baseline and targets, (n_blocks, n, k, q + n_rows)


@dataclass(frozen=True, slots=True)
class Beside:
    """Products of all targets beside a baseline on some of the blocks."""

    grams: Grams
    kept: NDArray[np.intp]
    whole: FloatArray  # products of the rows of baseline and targets
    factor: FloatArray  # makes the free rows of the baseline orthonormal
    onto: FloatArray  # products of these with the rows of the targets
    left: FloatArray  # the targets' own products less what the baseline explains

    def energy(self, target: Target) -> float:
        """Return the squared size of what the baseline leaves of an effect."""
        return float(np.trace(self.left[target.rows, target.rows]))

    def look(self, target: Target) -> Visibility:
        """Return whether the blocks show an effect, and how large it has to be."""
        cause = target.effect.cause
        energy = float(np.sum(np.diag(self.whole)[len(self.factor) :][target.rows]))
        share = self.energy(target) / energy if energy > 0.0 else 0.0
        if not share > SAME_SPACE:
            why = HELD if energy > 0.0 else "it gives no torque here"
            return Visibility(cause.name, why, 1.0 - max(share, 0.0))
        inverse = np.linalg.pinv(self.left[target.rows, target.rows], hermitian=True)
        coefficient = float(np.sqrt(np.mean(np.diag(inverse))))
        std_nm = coefficient * target.peak_nm
        needed = _needed(cause, self.grams.frame, self.grams.n_effects)
        why = ""
        # the smallest coefficient that would show lies outside of its domain
        widest = max((max(abs(p.lower), abs(p.upper)) for p in cause.linear), default=np.inf)
        if not needed * coefficient <= widest:
            why = (
                f"only more than {needed * std_nm:.2g} N m of it would show, "
                "which its domain does not hold"
            )
        return Visibility(cause.name, why, 1.0 - share, std_nm, needed * std_nm)

    def shares(self, family: Family, first: int = 0) -> FloatArray:
        """Return what each shape from the first on cannot imitate, shape (n, n_targets)."""
        q = len(self.factor)
        own, cross = family.own[self.kept, first:].sum(0), family.cross[self.kept, first:].sum(0)
        base = cross[:, :, :q] @ self.factor
        cross = cross[:, :, q:] - base @ self.onto
        # each row to a size of 1 before the baseline was taken out
        size = np.sqrt(np.diagonal(own, axis1=1, axis2=2))
        scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
        own = (own - base @ base.swapaxes(1, 2)) * scale[:, :, None] * scale[:, None, :]
        values, vectors = np.linalg.eigh(own)
        along = vectors.swapaxes(1, 2) @ (cross * scale[:, :, None])
        over = np.where(values > RANK, 1.0 / np.maximum(values, RANK), 0.0)
        starts = [target.rows.start for target in self.grams.targets]
        imitated = np.add.reduceat(np.sum(along**2 * over[:, :, None], axis=1), starts, axis=1)
        energy = np.add.reduceat(np.diag(self.left), starts)
        return np.clip(1.0 - imitated / np.maximum(energy, 1e-300), 0.0, 1.0)


@dataclass(slots=True)
class Grams:
    """Products of baseline, effects and all that may imitate them, block by block."""

    frame: Frame
    n_effects: int
    targets: tuple[Target, ...]  # one for each block of a step in time
    rows: FloatArray  # white ones of baseline and targets
    own: FloatArray  # their products in each block
    families: dict[str, Family]

    @classmethod
    def of(cls, frame: Frame, effects: Sequence[Effect], told: Told) -> Grams:
        """Return the products of effects on a frame, with shapes that may imitate them."""
        targets: list[Target] = []
        white, at = [frame.base], 0
        for number, effect in enumerate(effects):
            told(f"signature of {effect.name}", 0.2 * number / len(effects))
            for shape in () if unfit(effect.cause, frame) else _shapes(effect, frame):
                white.append(frame.white(effect.cause, shape))
                rows = slice(at, at + len(white[-1]))
                at = rows.stop
                columns = frame.drawn(effect.cause, shape) / frame.weights
                peak_nm = float(np.linalg.norm(columns, axis=0).max())
                targets.append(Target(replace(effect, shape=shape), rows, peak_nm))
        stacked = np.vstack(white)
        products = frame.products(stacked, stacked)
        grams = cls(frame, len(effects), tuple(targets), stacked, products, {})
        causes = {target.effect.name: target.effect.cause for target in targets}
        lines = {name: cause for name, cause in causes.items() if line_key(cause)}
        places = line_shapes(frame, lines, [target.effect for target in targets])
        for number, (name, cause) in enumerate(causes.items()):
            told(f"what {name} can imitate", 0.2 + 0.6 * number / len(causes))
            n_blocks, k = len(products), len(cause.linear)
            own, cross = np.zeros((n_blocks, 0, k, k)), np.zeros((n_blocks, 0, k, len(stacked)))
            family = grams.families[name] = Family(cause, [], own, cross)
            shapes = [target.effect.shape for target in targets if target.effect.name == name]
            if name in lines:
                shapes += places[name]
            else:
                shapes += shape_grid(shape_axes(cause, frame, frame.home(cause, shapes[0])))
            grams.extend(family, shapes)
        return grams

    def beside(self, kept: Sequence[int], *, zero_only: bool = False) -> Beside:
        """Return the products on some blocks beside the baseline, or beside the zero alone."""
        blocks, q = np.asarray(kept, dtype=np.intp), len(self.frame.base)
        free = 1 if zero_only else q
        whole = self.own[blocks].sum(0)
        values, vectors = np.linalg.eigh(whole[:free, :free])
        seen = values > RANK * max(float(values[-1]), 1e-300)
        factor = np.zeros((q, int(seen.sum())))
        factor[:free] = vectors[:, seen] / np.sqrt(values[seen])
        onto = factor.T @ whole[:q, q:]
        return Beside(self, blocks, whole, factor, onto, whole[q:, q:] - onto.T @ onto)

    def extend(self, family: Family, shapes: Sequence[Shape]) -> None:
        """Add the products of shapes that a family does not have yet."""
        held = {tuple(shape.values()) for shape in family.shapes}
        new = {tuple(shape.values()): shape for shape in shapes}
        fresh = [shape for key, shape in new.items() if key not in held]
        # two million numbers at once, 16 MB: more would not be faster
        step = max(1, 2_000_000 // max(1, len(family.cause.linear) * self.rows.shape[1]))
        for first in range(0, len(fresh), step):
            part = fresh[first : first + step]
            rows = np.stack([self.frame.white(family.cause, shape) for shape in part])
            n, k, m = rows.shape
            cross = self.frame.products(rows.reshape(n * k, m), self.rows)
            cross = cross.reshape(len(cross), n, k, -1)
            own = np.stack([self.frame.products(one, one) for one in rows], axis=1)
            family.own = np.concatenate([family.own, own], axis=1)
            family.cross = np.concatenate([family.cross, cross], axis=1)
            family.shapes += part


def unfit(cause: Cause, frame: Frame) -> str:
    """Return why a motion cannot show a cause at all; empty where it can."""
    if not cause.additive:
        return "it is no torque but a fault of samples, noise or angle: looks of its own find it"
    reason = cause.applicable(frame.motion)
    missing = [name for name in cause.channels if getattr(frame.motion, name) is None]
    if missing and not reason:
        reason = f"the record has no {', '.join(missing)}"
    if not reason and not all(frame.bounds(cause).values()):
        reason = "the record leaves nothing of its domain"
    return reason or ""


def _shapes(effect: Effect, frame: Frame) -> list[Shape]:
    """Return the shape of an effect on a motion; a step in time happens in each block once."""
    times = [frame.motion.time_s]
    if "step_time_s" in effect.shape:
        times = [frame.motion.time_s[a:b] for a, b in pairwise(frame.edges)]
    return [fitted_shape(effect.shape, frame.bounds(effect.cause), time) for time in times]


def _needed(cause: Cause, frame: Frame, names: int) -> float:
    """Return how many standard deviations an effect needs to be found among so many names."""
    from scipy.special import ndtri

    # ten independent trials along each shape that is no place on an axis
    trials = names * 10.0 ** len(cause.shape)
    key = line_key(cause)
    if key is not None:
        width = sum(high - low for low, high in frame.bounds(cause)[key])
        trials = names * max(1.0, 2.0 * line_length(frame, key) * width)
    # 1 % for any finding on a record without effects, 90 % to find one, as in the diagnosis
    level = chi2_level(0.01 / trials, max(1, len(cause.linear)))
    return float(np.sqrt(level) + ndtri(0.9))


def compare(
    motion: Motion,
    effects: Sequence[Effect],
    profile: ProfileData,
    *,
    noise: Noise | None = None,
    n_rows: int = ROWS,
    progress: Told = silent,
) -> Confusability:
    r"""Return how alike effects are on a motion, in white noise of the profile where none is given.

    With S_i the white columns of effect i less what the baseline explains, P_j(q) the projection
    onto those of effect j with shape q, :math:`\sin^2 = \min_q 1 - \|P_j(q) S_i\|^2 / \|S_i\|^2` is
    the share of the expected evidence for i that is left against j. An effect of d deviations then
    brings :math:`(d^2/2) \sin^2` nats for its name over the other one.
    """
    grams = Grams.of(make_frame(motion, profile, noise, n_rows=n_rows), effects, progress)
    names = tuple(effect.name for effect in effects)
    # one block: each effect is one target
    beside, plain = grams.beside([0]), grams.beside([0], zero_only=True)
    looked = {target.effect.name: beside.look(target) for target in grams.targets}
    shown, held = list[int](), list[int]()
    for column, target in enumerate(grams.targets):
        reason = looked[target.effect.name].reason
        if not reason:
            shown.append(column)
        elif reason == HELD and not plain.look(target).reason:
            held.append(column)
    progress("shapes between those of the grid", 0.8)
    sin2 = np.full((len(names), len(names)), np.nan)
    # what the baseline holds is compared beside the zero alone
    for view, columns in ((beside, shown), (plain, held)):
        places = [names.index(grams.targets[column].effect.name) for column in columns]
        for place in places:
            sin2[places, place] = _least(view, names[place], columns)
    np.fill_diagonal(sin2, np.nan)
    visibility = tuple(
        looked.get(effect.name) or Visibility(effect.name, unfit(effect.cause, grams.frame))
        for effect in effects
    )
    span = float(motion.time_s[-1] - motion.time_s[0])
    return Confusability(names, sin2, visibility, span)


def _least(beside: Beside, name: str, columns: Sequence[int]) -> FloatArray:
    """Return the least share that a cause leaves of some targets, with its shape free."""
    grams = beside.grams
    family = grams.families[name]
    home = grams.frame.home(family.cause, family.shapes[0])
    axes = shape_axes(family.cause, grams.frame, home)
    others = np.array([grams.targets[column].effect.name != name for column in columns])
    left = beside.shares(family)[:, columns]
    # times that a step of the grid is halved, by the samples that a cause needs: few, more, all; of
    # the resolution cell of a line 1/8000 leaves less than a millionth of three lines
    most = 12 if line_key(family.cause) else (5, 4, 2)[home]
    for halvings in range(1, 1 + most):
        best, at, tried = left.min(axis=0), left.argmin(axis=0), len(family.shapes)
        # what the grid leaves above 0.6 is told apart whatever the shape in between; 0.15 is more
        # than refinement has gained anywhere on the built-in protocols
        unsure = others & (best > _CONTAINED) & (best <= 0.6)
        around = [
            {**family.shapes[nearest], key: value}
            for nearest in at[unsure]
            for key, axis in axes.items()
            for value in axis.beside(family.shapes[nearest][key], halvings)
        ]
        grams.extend(family, around)
        if len(family.shapes) > tried:
            left = np.vstack([left, beside.shares(family, tried)[:, columns]])
    return np.asarray(left.min(axis=0))
