"""Which effects a motion shows, how large they must be, and which of them look alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, permutations

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.planning.frame import ROWS, Frame, Noise, make_frame
from hdbench.diagnosis.planning.signatures import (
    Axis,
    Effect,
    fitted_shape,
    line_key,
    line_places,
    line_spectrum,
    shape_axes,
    shape_grid,
)
from hdbench.model import Cause, Motion
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray

__all__ = ["CONFUSABLE", "HELD", "Confusability", "Grams", "Target", "Visibility", "compare"]

# the literature's line between what is told apart and what is not, by share of the effect
CONFUSABLE = 0.25
# contract: names whose effect spans the same space
SAME_SPACE = 0.01
# one name contains another where this little of it is left: the rounding of projections
_CONTAINED = 1e-6
# directions with less than this share of a column's energy are rounding
_ROUNDING = 1e-10
# a pair that the grid leaves above this is told apart whatever the shape in between; 0.15 is more
# than refinement has gained anywhere on the built-in protocols
_SURELY_APART = 0.6
# times that a step of the grid is halved, by the samples that a cause needs: few, more, all; and
# that a resolution cell of a line is: 1/8000 of it leaves less than a millionth of three lines
_HALVINGS = (5, 4, 2)
_LINE_HALVINGS = 12
# places of lines that are tried for each effect on a motion; one on each of several blocks
_PEAKS = 3
# numbers that are multiplied at once: 16 MB, and more would not be faster
_AT_ONCE = 2_000_000
# probability of any finding on a record without effects, and power, as in the diagnosis
_ALPHA = 0.01
_POWER = 1.2815515655446004
# independent trials along each shape that is no place on an axis
_TRIALS = 10.0
# why an effect is not seen that the baseline holds already
HELD = "the baseline imitates it"


@dataclass(frozen=True, slots=True)
class Visibility:
    """Whether a motion shows an effect: why not, where it does not.

    `baseline_share` is the share that the baseline imitates, `std_nm` the Cramer-Rao bound of its
    peak torque, `detectable_nm` the peak torque that is found with 90 %.
    """

    name: str
    reason: str
    baseline_share: float
    std_nm: float | None
    detectable_nm: float | None

    @property
    def visible(self) -> bool:
        """Whether the motion shows it."""
        return not self.reason


@dataclass(frozen=True, slots=True)
class Confusability:
    """How alike effects are on a motion.

    Entry (i, j) of `sin2` is the share of effect i that effect j with any shape, and the baseline,
    cannot imitate; NaN where either cannot be seen and on the diagonal.
    """

    names: tuple[str, ...]
    sin2: FloatArray
    visibility: tuple[Visibility, ...]
    duration_s: float

    def share(self, first: str, second: str) -> float | None:
        """Return the share of the first that the second cannot imitate; None if not compared."""
        if first not in self.names or second not in self.names:
            return None
        value = float(self.sin2[self.names.index(first), self.names.index(second)])
        return value if np.isfinite(value) else None

    def contained(self) -> tuple[tuple[str, str], ...]:
        """Return pairs (i, j) where i is a special case of j: j imitates it, not the reverse."""
        pairs = self._pairs()
        return tuple((a, b) for a, b, s, back in pairs if s <= _CONTAINED and back > SAME_SPACE)

    def confusable(self, below: float = CONFUSABLE) -> tuple[tuple[str, str, float], ...]:
        """Return ordered pairs below a level, contained ones left out, nearest first."""
        inside = set(self.contained())
        found = [(a, b, s) for a, b, s, _ in self._pairs() if s < below and (a, b) not in inside]
        return tuple(sorted(found, key=lambda pair: pair[2]))

    def inseparable(self) -> tuple[tuple[str, ...], ...]:
        """Return groups of names that imitate each other within `SAME_SPACE`, both ways."""
        groups: list[set[str]] = []
        for a, b, one, back in self._pairs():
            if not (one < SAME_SPACE and back < SAME_SPACE):
                continue
            joined = [group for group in groups if a in group or b in group]
            groups = [group for group in groups if group not in joined]
            groups.append(set().union({a, b}, *joined))
        order = self.names.index
        return tuple(tuple(sorted(group, key=order)) for group in groups)

    def invisible(self) -> tuple[Visibility, ...]:
        """Return what cannot be seen."""
        return tuple(entry for entry in self.visibility if not entry.visible)

    def _pairs(self) -> list[tuple[str, str, float, float]]:
        """Return (i, j, sin^2, sin^2 of the reverse) for all pairs that were compared."""
        places = permutations(range(len(self.names)), 2)
        return [
            (self.names[i], self.names[j], float(self.sin2[i, j]), float(self.sin2[j, i]))
            for i, j in places
            if np.isfinite(self.sin2[i, j])
        ]


@dataclass(frozen=True, slots=True)
class Target:
    """An effect to be imitated: its rows among those of all targets, and its peak torque."""

    effect: Effect
    rows: slice
    peak_nm: float


@dataclass(frozen=True, slots=True)
class Beside:
    """Products of all targets beside a baseline on some of the blocks.

    `factor` makes the free rows of the baseline orthonormal, `onto` are their products with the
    rows of the targets, `left` those rows' own products less what the baseline explains.
    """

    kept: NDArray[np.intp]
    free: slice
    factor: FloatArray
    onto: FloatArray
    left: FloatArray


@dataclass(slots=True)
class Family:
    """A cause with all shapes that were tried, and their products in each block.

    `own`, of shape (n_blocks, n, k, k), are those of the rows of each shape, `cross`, of shape
    (n_blocks, n, k, q + n_rows), those with the rows of the baseline and of all targets.
    """

    cause: Cause
    shapes: list[dict[str, float]]
    own: FloatArray
    cross: FloatArray

    def left(self, grams: Grams, beside: Beside, first: int = 0) -> FloatArray:
        """Return what each shape from the first on cannot imitate, shape (n, n_targets)."""
        q = len(grams.frame.base)
        own, cross = self.own[beside.kept, first:].sum(0), self.cross[beside.kept, first:].sum(0)
        base = cross[:, :, :q][:, :, beside.free] @ beside.factor
        cross = cross[:, :, q:] - base @ beside.onto
        # each row to a size of 1 before the baseline was taken out
        size = np.sqrt(np.diagonal(own, axis1=1, axis2=2))
        scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
        own = (own - base @ base.swapaxes(1, 2)) * scale[:, :, None] * scale[:, None, :]
        values, vectors = np.linalg.eigh(own)
        along = vectors.swapaxes(1, 2) @ (cross * scale[:, :, None])
        over = np.where(values > _ROUNDING, 1.0 / np.maximum(values, _ROUNDING), 0.0)
        squares = np.sum(along**2 * over[:, :, None], axis=1)
        shares = [
            np.sum(squares[:, t.rows], axis=1) / max(np.trace(beside.left[t.rows, t.rows]), 1e-300)
            for t in grams.targets
        ]
        return np.clip(1.0 - np.stack(shares, axis=1), 0.0, 1.0)


@dataclass(slots=True)
class Grams:
    """Products of baseline, effects and all that may imitate them, block by block.

    `targets` are the effects that the motion could show, one for each block of a step in time.
    `rows` are the white rows of baseline and targets, `own` their products in each block.
    """

    frame: Frame
    effects: tuple[Effect, ...]
    targets: tuple[Target, ...]
    rows: FloatArray
    own: FloatArray
    families: dict[str, Family]

    @classmethod
    def of(
        cls, frame: Frame, effects: Sequence[Effect], told: Callable[[str, float], None]
    ) -> Grams:
        """Return the products of effects on a frame, with a grid of shapes for each of them."""
        targets: list[Target] = []
        white = [frame.base]
        at = 0
        for number, effect in enumerate(effects):
            told(f"signature of {effect.name}", 0.2 * number / len(effects))
            if _unfit(effect.cause, frame):
                continue
            for shape in _shapes(effect, frame):
                rows = frame.white(effect.cause, shape)
                peak = frame.peak(effect.cause, shape)
                targets.append(
                    Target(replace(effect, shape=shape), slice(at, at + len(rows)), peak)
                )
                white.append(rows)
                at += len(rows)
        rows = np.vstack(white)
        grams = cls(frame, tuple(effects), tuple(targets), rows, frame.products(rows, rows), {})
        grams._gather(told)
        return grams

    def beside(self, kept: Sequence[int], *, zero_only: bool = False) -> Beside:
        """Return the products on some blocks beside the baseline, or beside the zero alone."""
        blocks = np.asarray(kept, dtype=np.intp)
        q = len(self.frame.base)
        free = slice(0, 1 if zero_only else q)
        own = self.own[blocks].sum(0)
        values, vectors = np.linalg.eigh(own[free, free])
        seen = values > _ROUNDING * max(float(values[-1]), 1e-300)
        factor = vectors[:, seen] / np.sqrt(values[seen])
        onto = factor.T @ own[free, q:]
        return Beside(blocks, free, factor, onto, own[q:, q:] - onto.T @ onto)

    def look(self, target: Target, beside: Beside) -> Visibility:
        """Return whether some of the blocks show an effect, and how large it has to be."""
        cause, q = target.effect.cause, len(self.frame.base)
        at = slice(target.rows.start + q, target.rows.stop + q)
        left = beside.left[target.rows, target.rows]
        energy = float(np.trace(self.own[beside.kept].sum(0)[at, at]))
        share = float(np.trace(left)) / energy if energy > 0.0 else 0.0
        if not share > SAME_SPACE:
            why = HELD if energy > 0.0 else "it gives no torque here"
            return Visibility(cause.name, why, 1.0 - max(share, 0.0), None, None)
        inverse = np.linalg.pinv(left, hermitian=True)
        coefficient = float(np.sqrt(np.mean(np.diag(inverse))))
        std_nm = coefficient * target.peak_nm
        d = _needed(cause, self.frame, float(len(self.effects)))
        why = ""
        # the smallest coefficient that would show lies outside of its domain
        widest = max((max(abs(p.lower), abs(p.upper)) for p in cause.linear), default=np.inf)
        if not d * coefficient <= widest:
            why = (
                f"only more than {d * std_nm:.2g} N m of it would show, "
                "which its domain does not hold"
            )
        return Visibility(cause.name, why, 1.0 - share, std_nm, d * std_nm)

    def extend(self, name: str, shapes: Sequence[Mapping[str, float]]) -> int:
        """Add shapes to a family; return how many it had before."""
        family = self.families[name]
        before = len(family.shapes)
        held = {tuple(shape.values()) for shape in family.shapes}
        new = {tuple(shape.values()): dict(shape) for shape in shapes}
        fresh = [shape for key, shape in new.items() if key not in held]
        step = max(1, _AT_ONCE // max(1, len(family.cause.linear) * self.rows.shape[1]))
        for first in range(0, len(fresh), step):
            rows = np.stack(
                [self.frame.white(family.cause, s) for s in fresh[first : first + step]]
            )
            n, k, m = rows.shape
            cross = self.frame.products(rows.reshape(n * k, m), self.rows)
            cross = cross.reshape(len(cross), n, k, -1)
            own = np.stack([self.frame.products(one, one) for one in rows], axis=1)
            family.own = np.concatenate([family.own, own], axis=1)
            family.cross = np.concatenate([family.cross, cross], axis=1)
            family.shapes += fresh[first : first + step]
        return before

    def _gather(self, told: Callable[[str, float], None]) -> None:
        """Form the families: a grid of shapes, of lines the strongest places of every target."""
        causes = {t.effect.name: t.effect.cause for t in self.targets}
        lines = {name: cause for name, cause in causes.items() if line_key(cause)}
        places = self._places(lines)
        n_blocks = len(self.frame.edges) - 1
        for number, (name, cause) in enumerate(causes.items()):
            told(f"what {name} can imitate", 0.2 + 0.6 * number / len(causes))
            k = len(cause.linear)
            own, cross = np.zeros((n_blocks, 0, k, k)), np.zeros((n_blocks, 0, k, len(self.rows)))
            self.families[name] = Family(cause, [], own, cross)
            shapes = [dict(t.effect.shape) for t in self.targets if t.effect.name == name]
            home = self.frame.home(cause, shapes[0])
            shapes += places.get(name, [])
            if name not in lines:
                shapes += shape_grid(shape_axes(cause, self.frame, home))
            self.extend(name, shapes)

    def _places(self, lines: Mapping[str, Cause]) -> dict[str, list[dict[str, float]]]:
        """Return where lines may imitate targets: on all blocks together and on each."""
        frame = self.frame
        found: dict[str, list[dict[str, float]]] = {name: [] for name in lines}
        tops: dict[str, float] = {}
        for cause in lines.values():
            key = str(line_key(cause))
            tops[key] = max(tops.get(key, 0.0), *(high for _, high in frame.bounds(cause)[key]))
        base, mixed = _drawn_base(frame), np.random.default_rng(0)
        ends = np.searchsorted(frame.rows, frame.edges)
        stretches = {(a, b) for a, b in pairwise(ends.tolist())} | {(0, len(frame.rows))}
        for target in self.targets:
            effect = target.effect
            others = {name: cause for name, cause in lines.items() if name != effect.name}
            rows = frame.drawn(effect.cause, effect.shape)
            # all columns in one sum, each with a weight of its own so that none cancels another
            left = mixed.normal(size=len(rows)) @ rows
            left = left - base @ (base.T @ left)
            for key in {str(line_key(cause)) for cause in others.values()}:
                spectra = [line_spectrum(frame, key, tops[key], left, slice(*s)) for s in stretches]
                for name, cause in others.items():
                    bands = frame.bounds(cause).get(key)
                    if not bands:
                        continue
                    most = _PEAKS if len(spectra) == 1 else 1
                    places = [p for s in spectra for p in line_places(cause, bands, *s, most)]
                    here = effect.shape.get(key)
                    if here is not None and any(low <= here <= high for low, high in bands):
                        places.append(here)
                    found[name] += [{key: place} for place in places]
        return found


def _drawn_base(frame: Frame) -> FloatArray:
    """Return an orthonormal basis of the zero and what turns with the baseline's orders."""
    if frame.noise.is_white:
        return np.asarray(np.linalg.qr(frame.base.T)[0])
    return np.zeros((len(frame.rows), 0))


def _unfit(cause: Cause, frame: Frame) -> str:
    """Return why a motion cannot show a cause at all; empty where it can."""
    if not cause.additive:
        return "it is no torque but a fault of samples, noise or angle: looks of its own find it"
    missing = [c for c in cause.channels if getattr(frame.motion, c) is None]
    reason = cause.applicable(frame.motion) or ""
    if missing and not reason:
        reason = f"the record has no {', '.join(missing)}"
    if not reason and not all(frame.bounds(cause).values()):
        reason = "the record leaves nothing of its domain"
    return reason


def _shapes(effect: Effect, frame: Frame) -> list[dict[str, float]]:
    """Return the shape of an effect on a motion; a step in time happens in each block once."""
    times = [frame.motion.time_s]
    if "step_time_s" in effect.shape:
        times = [frame.motion.time_s[a:b] for a, b in pairwise(frame.edges)]
    shapes = [fitted_shape(effect.shape, frame.bounds(effect.cause), time) for time in times]
    return [shape for shape in shapes if shape is not None]


def _needed(cause: Cause, frame: Frame, names: float) -> float:
    """Return how many standard deviations are found with 90 %: root of the threshold plus 1.28."""
    from scipy.special import chdtri

    trials = names
    key = line_key(cause)
    if key is not None:
        turns = np.ptp(frame.few.angle_rad) / (2.0 * np.pi)
        length = turns if key == "order" else np.ptp(frame.few.time_s)
        width = sum(high - low for low, high in frame.bounds(cause)[key])
        trials *= max(1.0, 2.0 * float(length) * width)
    else:
        trials *= _TRIALS ** len(cause.shape)
    threshold = float(chdtri(max(1, len(cause.linear)), _ALPHA / trials))
    return float(np.sqrt(threshold)) + _POWER


def compare(
    motion: Motion,
    effects: Sequence[Effect],
    profile: ProfileData,
    *,
    noise: Noise | None = None,
    n_rows: int = ROWS,
    progress: Callable[[str, float], None] | None = None,
) -> Confusability:
    r"""Compare effects on a motion.

    Parameters
    ----------
    motion : Motion
        Motion of a record or of a plan.
    effects : sequence of Effect
        Effects, each name once; `nominal_shape` gives shapes where nothing is known.
    profile : ProfileData
        Bench.
    noise : Noise or None
        Noise of the torque; white with the profile's standard deviation where None.
    n_rows : int
        Rows that stand for the motion in white noise.
    progress : callable or None
        Told what is going on and the share done.

    Returns
    -------
    Confusability

    Notes
    -----
    With S_i the white columns of effect i less what the baseline explains, and P_j(q) the
    projection onto those of effect j with shape q,

    .. math:: \sin^2 \gamma_{ij} = \min_q 1 - \|P_j(q) S_i\|_F^2 / \|S_i\|_F^2 ,

    the share of the expected evidence for i that is left against j, phases of i being equally
    likely. An effect of d standard deviations then brings :math:`(d^2/2) \sin^2 \gamma` nats for
    its name over the other one.
    """
    told = progress or (lambda _what, _share: None)
    grams = Grams.of(make_frame(motion, profile, noise, n_rows=n_rows), effects, told)
    names = tuple(effect.name for effect in effects)
    beside = grams.beside((0,))
    looked = {t.effect.name: grams.look(t, beside) for t in grams.targets}
    sin2 = np.full((len(names), len(names)), np.nan)
    held = {name for name, entry in looked.items() if entry.reason == HELD}
    shown = {name for name, entry in looked.items() if entry.visible}
    told("shapes between those of the grid", 0.8)
    _fill(sin2, names, grams, beside, shown)
    if len(held) > 1:
        # what the baseline holds is compared beside the zero alone
        plain = grams.beside((0,), zero_only=True)
        seen = {t.effect.name for t in grams.targets if grams.look(t, plain).visible}
        _fill(sin2, names, grams, plain, held & seen)
    visibility = tuple(
        looked.get(e.name) or Visibility(e.name, _unfit(e.cause, grams.frame), 1.0, None, None)
        for e in effects
    )
    span = float(motion.time_s[-1] - motion.time_s[0])
    return Confusability(names, sin2, visibility, span)


def _fill(
    sin2: FloatArray, names: tuple[str, ...], grams: Grams, beside: Beside, shown: set[str]
) -> None:
    """Enter the least shares of effects that are shown, with shapes between those of the grid."""
    columns = [c for c, t in enumerate(grams.targets) if t.effect.name in shown]
    for name in shown:
        best = _least(grams, beside, name, columns)
        for c in columns:
            other = grams.targets[c].effect.name
            if other != name:
                sin2[names.index(other), names.index(name)] = best[c]


def _least(grams: Grams, beside: Beside, name: str, columns: Sequence[int]) -> FloatArray:
    """Return the least share that a cause leaves of each target, with its shape free."""
    family = grams.families[name]
    left = family.left(grams, beside)
    if not family.cause.shape:
        return np.asarray(left.min(axis=0))
    home = grams.frame.home(family.cause, family.shapes[0])
    axes = shape_axes(family.cause, grams.frame, home)
    times = _LINE_HALVINGS if line_key(family.cause) else _HALVINGS[home]
    for halvings in range(1, times + 1):
        best, at = left.min(axis=0), left.argmin(axis=0)
        tried: list[dict[str, float]] = []
        for c in columns:
            known = grams.targets[c].effect.name == name
            if not known and _CONTAINED < best[c] <= _SURELY_APART:
                tried += _around(family.shapes[at[c]], axes, halvings)
        if not tried:
            break
        first = grams.extend(name, tried)
        if len(family.shapes) > first:
            left = np.vstack([left, family.left(grams, beside, first)])
    return np.asarray(left.min(axis=0))


def _around(
    shape: Mapping[str, float], axes: Mapping[str, Axis], halvings: int
) -> list[dict[str, float]]:
    """Return shapes with one parameter moved to either side."""
    return [
        {**shape, name: value}
        for name, axis in axes.items()
        for value in axis.beside(shape[name], halvings)
    ]
