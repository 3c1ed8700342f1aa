"""A whitened record in few samples: rows drawn at random that keep angles between effects."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.noise.whitened import orthonormal
from hdbench.diagnosis.planning.signatures import effect_columns, picked
from hdbench.model import Cause, Motion, baseline_columns
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray

__all__ = ["SKETCH_ROWS", "Noise", "Sketch", "make_sketch", "part_of"]

# rows of a sketch. The Gram matrix of few columns is then known to about 1 %, and so is sin^2: on
# the built-in profile's 172 s protocol the largest change of any sin^2 against all samples is 0.02
# (tests/diagnosis/test_planning.py); columns that are the same stay the same
SKETCH_ROWS = 12_000
# half of the rows evenly over the record, a quarter where the motor accelerates, a quarter where it
# is slow: there friction, hysteresis and inertia differ from everything else
_EVENLY, _ACCELERATING, _SLOW = 0.5, 0.25, 0.25
_SLOW_RAD_S = 20.0
_SEED = 20250101
# numbers that are kept for causes that remember: 160 MB
_KEPT_NUMBERS = 20_000_000
# a cause that remembers is computed on the rows, every so many samples between them, and wherever
# the load jumps by this share of its range or a stretch begins: its recursions are exact for what
# is linear between samples
_COURSE = 8
_JUMP = 0.01
# ... where that agrees with all samples to this share of its size: sin^2 changes by twice as much
# at most, a third of what the draw of the rows does
_AGREES = 3e-3
# a cause has no memory where its columns at picked samples are those of the whole record
_SAME = 1e-9


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise of the torque channel: an autoregression.

    Parameters
    ----------
    std_nm : float
        Standard deviation of its innovation, N m, above 0.
    coefficients : ndarray, shape (p,)
        Coefficients a_1 ... a_p; empty for white noise.
    """

    std_nm: float
    coefficients: FloatArray

    @classmethod
    def white(cls, std_nm: float) -> Noise:
        """Return white noise of a standard deviation, N m."""
        return cls(std_nm, np.zeros(0))


@dataclass(frozen=True, slots=True)
class Sketch:
    """Rows of a motion, with everything that whitens columns on them.

    Parameters
    ----------
    motion : Motion
        The whole motion.
    few : Motion
        The rows alone; its samples have no neighbours.
    rows : ndarray of int, shape (m,)
        Indices of the rows in `motion`, increasing; first and last valid sample are among them.
    weights : ndarray, shape (m,)
        Inverse root of the probability with which each row was drawn.
    noise : Noise
        Noise.
    course : Motion
        The rows and what of the samples between them causes that remember need.
    places : ndarray of int, shape (m,)
        The rows among the samples of `course`.
    base : ndarray, shape (m, q)
        Whitened baseline on the rows.
    basis : ndarray, shape (m, r)
        Orthonormal basis of it.
    parent : Sketch or None
        Sketch of which this one is a part.
    within : ndarray of int, shape (m,), or None
        Its rows among those of the parent.
    memory : dict
        Which causes remember, as far as it was asked.
    courses : dict
        Which of them need no more of the motion than `course`, as far as it was asked.
    kept : dict
        Columns of causes that remember, computed once for all parts.
    """

    motion: Motion
    few: Motion
    rows: NDArray[np.intp]
    weights: FloatArray
    noise: Noise
    course: Motion
    places: NDArray[np.intp]
    base: FloatArray
    basis: FloatArray
    parent: Sketch | None = None
    within: NDArray[np.intp] | None = None
    memory: dict[str, bool] = field(default_factory=dict)
    courses: dict[str, bool] = field(default_factory=dict)
    kept: dict[tuple[str, tuple[float, ...]], FloatArray] = field(default_factory=dict)

    def remembers(self, cause: Cause, shape: dict[str, float]) -> bool:
        """Return whether whitened columns of a cause need the samples between the rows."""
        return bool(len(self.noise.coefficients)) or self.has_memory(cause, shape)

    def peak(self, cause: Cause, shape: dict[str, float]) -> float:
        """Return the largest row of a cause's columns, N m per unit: its peak torque."""
        if self.has_memory(cause, shape):
            columns = effect_columns(cause, shape, self.motion)[self.rows]
        else:
            columns = effect_columns(cause, shape, self.few)
        finite = np.where(np.isfinite(columns), columns, 0.0)
        return float(np.sqrt(np.sum(finite**2, axis=1)).max(initial=0.0))

    def has_memory(self, cause: Cause, shape: dict[str, float]) -> bool:
        """Return whether columns at the rows alone differ from those of the whole motion."""
        if self.parent is not None:
            return self.parent.has_memory(cause, shape)
        if cause.name not in self.memory:
            whole = effect_columns(cause, shape, self.motion)[self.rows]
            alone = effect_columns(cause, shape, self.few)
            known = np.isfinite(whole)
            size = float(np.abs(whole[known]).max(initial=0.0))
            apart = float(np.abs(alone - whole)[known].max(initial=0.0))
            self.memory[cause.name] = not apart <= _SAME * size
        return self.memory[cause.name]

    def columns(self, cause: Cause, shape: dict[str, float], *, remembers: bool) -> FloatArray:
        """Return whitened columns on the rows, shape (m, k), per N m of each column."""
        if not remembers:
            return self._weighted(effect_columns(cause, shape, self.few))
        if self.parent is not None and self.within is not None:
            return self.parent.columns(cause, shape, remembers=True)[self.within]
        key = (cause.name, tuple(shape.values()))
        if key not in self.kept:
            if not len(self.noise.coefficients) and self._on_course(cause, shape):
                white = self._weighted(effect_columns(cause, shape, self.course)[self.places])
            else:
                white = self.whiten(effect_columns(cause, shape, self.motion))
            if len(self.kept) * white.size > _KEPT_NUMBERS:
                self.kept.clear()
            self.kept[key] = white
        return self.kept[key]

    def _on_course(self, cause: Cause, shape: dict[str, float]) -> bool:
        """Return whether a cause needs no more of the motion than its course."""
        if cause.name not in self.courses:
            whole = self._weighted(effect_columns(cause, shape, self.motion)[self.rows])
            apart = self._weighted(effect_columns(cause, shape, self.course)[self.places]) - whole
            self.courses[cause.name] = bool(
                np.sum(apart**2) <= _AGREES**2 * float(np.sum(whole**2))
            )
        return self.courses[cause.name]

    def whiten(self, whole: FloatArray) -> FloatArray:
        """Return columns of the whole motion, shape (n, k), whitened on the rows, shape (m, k)."""
        kept = whole[self.rows]
        for lag, coefficient in enumerate(self.noise.coefficients, start=1):
            kept = kept - coefficient * whole[np.maximum(self.rows - lag, 0)]
        return self._weighted(kept)

    def project(self, columns: FloatArray) -> FloatArray:
        """Return whitened columns less what the baseline explains."""
        return np.asarray(columns - self.basis @ (self.basis.T @ columns))

    def _weighted(self, columns: FloatArray) -> FloatArray:
        # a sample in which a cause cannot be formed shows nothing of it
        finite = np.where(np.isfinite(columns), columns, 0.0)
        return np.asarray(finite * (self.weights / self.noise.std_nm)[:, None])


def make_sketch(
    motion: Motion,
    profile: ProfileData,
    noise: Noise,
    *,
    n_rows: int = SKETCH_ROWS,
    zero_only: bool = False,
) -> Sketch:
    """Draw the rows of a sketch and form the baseline on them.

    Parameters
    ----------
    motion : Motion
        Motion of a record or of a plan.
    profile : ProfileData
        Bench.
    noise : Noise
        Noise.
    n_rows : int
        Rows to be drawn, about; all of them where the motion has no more.
    zero_only : bool
        Whether the zero is all of the baseline: to compare effects that the baseline holds.

    Returns
    -------
    Sketch

    Notes
    -----
    Each row is drawn by itself with a probability p and weighted by ``p ** -0.5``, so that products
    of whitened columns are those of the whole record on average. The draw has a fixed seed.
    """
    starts = _starts(motion)
    usable = motion.valid & _has_past(starts, len(noise.coefficients))
    chance = _chance(motion, usable, n_rows)
    drawn = np.random.default_rng(_SEED).random(len(motion)) < chance
    index = np.flatnonzero(usable)
    drawn[index[[0, -1]]] = True
    chance[index[[0, -1]]] = 1.0
    rows = np.flatnonzero(drawn)
    weights = chance[rows] ** -0.5
    base = np.ones((len(motion), 1)) if zero_only else _baseline(motion, profile)
    empty = np.zeros((len(rows), 0))
    course = _course(motion, rows, starts)
    places = np.searchsorted(course, rows)
    thin = picked(motion, course)
    raw = Sketch(motion, picked(motion, rows), rows, weights, noise, thin, places, empty, empty)
    white = raw.whiten(base)
    return replace(raw, base=white, basis=orthonormal(white))


def part_of(sketch: Sketch, kept: NDArray[np.bool_]) -> Sketch:
    """Return a sketch of a part of its motion.

    Parameters
    ----------
    sketch : Sketch
        Sketch of all.
    kept : ndarray of bool, shape (m,)
        Rows of the part.

    Returns
    -------
    Sketch
        With the same whole motion, so that what remembers is computed on all of it.
    """
    rows = sketch.rows[kept]
    base = sketch.base[kept]
    return replace(
        sketch,
        few=picked(sketch.motion, rows),
        rows=rows,
        places=sketch.places[kept],
        weights=sketch.weights[kept],
        base=base,
        basis=orthonormal(base),
        parent=sketch,
        within=np.flatnonzero(kept),
        kept={},
    )


def _course(motion: Motion, rows: NDArray[np.intp], starts: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the samples on which a cause that remembers is computed."""
    needed = np.zeros(len(motion), dtype=bool)
    needed[::_COURSE] = True
    needed[rows] = True
    load = motion.applied_nm
    jumps = np.abs(np.diff(load)) > _JUMP * float(np.ptp(load[np.isfinite(load)]))
    breaks = np.flatnonzero(jumps | starts[1:])
    needed[breaks] = True
    needed[breaks + 1] = True
    return np.flatnonzero(needed)


def _baseline(motion: Motion, profile: ProfileData) -> FloatArray:
    """Return all that a diagnosis explains before it looks for a cause, shape (n, q)."""
    _, names, base = baseline_columns(motion, profile)
    if "misalignment:cosine" in names:
        return base
    # below an output turn the diagnosis projects output order 1 out as well
    turn = motion.output_angle_rad
    return np.column_stack([base, np.cos(turn), np.sin(turn)])


def _starts(motion: Motion) -> NDArray[np.bool_]:
    """Return where a sample does not follow its predecessor: after 1.5 periods and more."""
    steps = np.diff(motion.time_s)
    return np.concatenate([[True], steps > 1.5 * float(np.median(steps))])


def _has_past(starts: NDArray[np.bool_], needed: int) -> NDArray[np.bool_]:
    """Return which samples have as many neighbours before them in their stretch."""
    index = np.arange(len(starts))
    first = np.maximum.accumulate(np.where(starts, index, 0))
    return np.asarray(index - first >= needed)


def _chance(motion: Motion, usable: NDArray[np.bool_], n_rows: int) -> FloatArray:
    """Return the probability with which each row is drawn."""
    count = int(usable.sum())
    if count <= n_rows:
        return usable.astype(np.float64)
    acceleration = np.where(usable, np.abs(motion.acceleration_rad_s2), 0.0)
    slow = usable & (np.abs(motion.velocity_rad_s) < _SLOW_RAD_S)
    shares = ((_ACCELERATING, acceleration), (_SLOW, slow.astype(np.float64)))
    chance = _EVENLY * usable / count
    for share, where in shares:
        total = float(where.sum())
        chance = chance + share * (where / total if total > 0.0 else usable / count)
    return np.minimum(1.0, n_rows * chance)
