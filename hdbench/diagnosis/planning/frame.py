"""Frame of a motion: few rows that keep all products of effects, white in the noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.discovery.bands import Bands, make_bands
from hdbench.diagnosis.evidence import GAP
from hdbench.model import BenchModel, Cause, Motion, baseline_columns, shape_bounds, with_signal
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray

Bounds = tuple[tuple[float, float], ...]

# rows that stand for a motion in white noise: on the built-in profile's 172 s protocol the largest
# change of any sin^2 against all samples is 0.02 (tests/diagnosis/test_planning.py)
ROWS = 8_000


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise of the torque channel: variance of an orthonormal cosine coefficient, (N m)^2."""

    frequency_hz: FloatArray  # increasing; white noise has a single one
    power_nm2: FloatArray

    @classmethod
    def white(cls, std_nm: float) -> Noise:
        """Return white noise of a standard deviation, N m."""
        return cls(np.zeros(1), np.array([std_nm**2]))

    @property
    def std_nm(self) -> float:
        """Root of the mean power, N m."""
        return float(np.sqrt(np.mean(self.power_nm2)))

    @property
    def is_white(self) -> bool:
        """Whether all frequencies have about the same power."""
        # in the narrow bands of a short record white noise is off by up to half
        return float(np.abs(self.power_nm2 / self.std_nm**2 - 1.0).max()) <= 0.5


@dataclass(frozen=True, slots=True)
class Frame:
    """A motion in blocks, with all that brings columns of a cause to white rows."""

    motion: Motion
    few: Motion  # the drawn samples alone
    course: Motion  # these with what of the others causes that remember need
    rows: NDArray[np.intp]  # where the drawn samples are in `motion`
    places: NDArray[np.intp]  # where they are in `course`
    weights: FloatArray  # inverse root of the probability with which each was drawn
    noise: Noise
    edges: NDArray[np.intp]  # first sample of each block, and the end
    bands: tuple[Bands, ...]  # cosine transform of each block in noise that is not white
    base: FloatArray  # white rows of the baseline, the zero first
    homes: dict[str, int] = field(default_factory=dict)  # on which motion a cause is computed
    domains: dict[str, dict[str, Bounds]] = field(default_factory=dict)  # bounds of its shapes

    @property
    def ends(self) -> NDArray[np.intp]:
        """The first drawn sample of each block, and the end."""
        return np.searchsorted(self.rows, self.edges)

    def bounds(self, cause: Cause) -> dict[str, Bounds]:
        """Return where each shape parameter of a cause can lie on this motion."""
        if cause.name not in self.domains:
            self.domains[cause.name] = shape_bounds(cause, self.motion)
        return self.domains[cause.name]

    def drawn(
        self, cause: Cause, shape: Mapping[str, float], home: int | None = None
    ) -> FloatArray:
        """Return columns on the drawn samples, weighted, as rows of shape (k, m), N m per unit."""
        at = self.home(cause, shape) if home is None else home
        motion = (self.few, self.course, self.motion)[at]
        rows = _finite(cause.columns(motion, shape))
        return (rows if at == 0 else rows[:, (self.places, self.rows)[at - 1]]) * self.weights

    def white(self, cause: Cause, shape: Mapping[str, float]) -> FloatArray:
        """Return the white rows of a cause, shape (k, m_white), per unit of each coefficient."""
        if self.noise.is_white:
            return self.drawn(cause, shape) / self.noise.std_nm
        return self.transformed(_finite(cause.columns(self.motion, shape)))

    def transformed(self, rows: FloatArray) -> FloatArray:
        """Return the cosine transform of each block over the root of the noise's power."""
        parts = []
        for band, (a, b) in zip(self.bands, pairwise(self.edges), strict=True):
            power = np.interp(band.frequency_hz, self.noise.frequency_hz, self.noise.power_nm2)
            parts.append(band.transform(rows[:, a:b].T) / np.sqrt(band.spread(power)))
        return np.hstack(parts)

    def products(self, one: FloatArray, other: FloatArray) -> FloatArray:
        """Return the Gram matrix of white rows (..., k, m) and (l, m) in each block."""
        ends = self.ends
        if not self.noise.is_white:
            ends = np.cumsum([0, *(band.size for band in self.bands)])
        across = np.swapaxes(other, -1, -2)
        return np.stack([one[..., a:b] @ across[..., a:b, :] for a, b in pairwise(ends)])

    def home(self, cause: Cause, shape: Mapping[str, float]) -> int:
        """Return 0, 1 or 2: the fewest samples on which the columns of a cause are right."""
        if cause.name not in self.homes:
            # a delay is interpolated between neighbours
            home = 2 if "delay_s" in shape else 0
            while home < 2:
                here, more = (self.drawn(cause, shape, at) for at in (home, home + 1))
                # sin^2 changes by twice as much
                if np.linalg.norm(here - more) <= 3e-3 * np.linalg.norm(more):
                    break
                home += 1
            self.homes[cause.name] = home
        return self.homes[cause.name]


def _finite(columns: FloatArray) -> FloatArray:
    """Return columns as rows; a sample in which a cause cannot be formed shows nothing of it."""
    rows = np.array(columns.T, dtype=np.float64, order="C")
    rows[~np.isfinite(rows)] = 0.0
    return rows


def make_frame(
    motion: Motion,
    profile: ProfileData,
    noise: Noise | None = None,
    *,
    n_rows: int = ROWS,
    edges: Sequence[int] = (),
) -> Frame:
    """Return the frame of a motion, in blocks that begin at `edges` where there are any."""
    if motion.simulated_nm is None:
        # for causes that act on the whole signal
        motion = with_signal(motion, BenchModel.from_profile(profile).torque_nm)
    noise = noise or Noise.white(max(profile.sensor.noise_nm, np.finfo(float).tiny))
    chance = _chance(motion, n_rows)
    reached = np.cumsum(chance)
    # one row of every stretch of equal probability, weighted by the inverse root of its own:
    # products of rows are those of the whole record on average
    strata = np.arange(max(1, round(reached[-1])))
    places = strata + np.random.default_rng(20250101).random(len(strata))
    index = np.searchsorted(reached, places * (reached[-1] / len(strata)), side="right")
    rows, times = np.unique(np.minimum(index, len(motion) - 1), return_counts=True)
    course = _course(motion, rows)
    few = _picked(motion, rows)
    sides = np.asarray(edges if len(edges) else (0, len(motion)), dtype=np.intp)
    raw = Frame(
        motion, few, _picked(motion, course), rows, np.searchsorted(course, rows),
        np.sqrt(times / chance[rows]), noise, sides, (), np.zeros((0, 0)),
    )  # fmt: skip
    if noise.is_white:
        return replace(raw, base=_baseline(few, profile) * (raw.weights / noise.std_nm))
    period = float(np.median(np.diff(motion.time_s)))
    bands = tuple(make_bands(motion.valid[a:b], period) for a, b in pairwise(sides))
    raw = replace(raw, bands=bands)
    return replace(raw, base=raw.transformed(_baseline(motion, profile)))


def _baseline(motion: Motion, profile: ProfileData) -> FloatArray:
    """Return all that a diagnosis explains before it looks for a cause, as rows."""
    _, names, base = baseline_columns(motion, profile)
    if "misalignment:cosine" not in names:
        # below an output turn the diagnosis projects output order 1 out as well
        turn = motion.output_angle_rad
        base = np.column_stack([base, np.cos(turn), np.sin(turn)])
    return _finite(base)


def _chance(motion: Motion, n_rows: int) -> FloatArray:
    """Return the probability with which each sample is drawn."""
    valid = motion.valid.astype(np.float64)
    count = float(valid.sum())
    if count <= n_rows:
        return valid
    accelerating = np.where(motion.valid, np.abs(motion.acceleration_rad_s2), 0.0)
    slow = motion.valid & (np.abs(motion.velocity_rad_s) < 20.0)
    # half evenly over the record, a quarter where the motor accelerates, a quarter where it is
    # slow: there friction, hysteresis and inertia differ from everything else
    chance = 0.5 * valid / count
    for where in (accelerating, slow.astype(np.float64)):
        total = float(where.sum())
        chance = chance + 0.25 * (where / total if total > 0.0 else valid / count)
    return np.minimum(1.0, n_rows * chance)


def _course(motion: Motion, rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the samples on which a cause that remembers is computed."""
    needed = np.zeros(len(motion), dtype=bool)
    # every eighth sample, and wherever the load jumps or a stretch begins
    needed[::8] = True
    needed[rows] = True
    load, step = motion.applied_nm, np.diff(motion.time_s)
    jumps = np.abs(np.diff(load)) > 0.01 * float(np.ptp(load[np.isfinite(load)]))
    breaks = np.flatnonzero(jumps | (step > GAP * float(np.median(step))))
    needed[breaks] = True
    needed[breaks + 1] = True
    return np.flatnonzero(needed)


def _picked(motion: Motion, rows: NDArray[np.intp]) -> Motion:
    """Return some samples of a motion, as samples without neighbours."""
    arrays: dict[str, Any] = {
        name: value[rows]
        for name in motion.__dataclass_fields__
        if isinstance(value := getattr(motion, name), np.ndarray)
    }
    return replace(motion, **arrays)
