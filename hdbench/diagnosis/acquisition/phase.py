"""Jumps of the ripple's phase against an integrated angle: samples that the stamps hide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.acquisition.channels import robust_std
from hdbench.model import Motion, baseline_columns
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray

__all__ = ["PhaseJump", "find_phase_jumps"]

# motor turns of one block: whole periods of every ripple order, so that orders do not leak
_TURNS = 4.0
# blocks on each side of a jump, and of the record at least
_SIDE = 3
_LEAST_BLOCKS = 12
# as for jumps between encoder and tacho; the phase of a block is normal
_SIGMA = 8.0
# a lost sample turns the angle by velocity times period; less than half of it is none
_PART = 0.5
# a delay between torque and speed turns the phase wherever the speed changes: nearer than this
# part of the jump the change of speed over one period must not come
_SPEED = 0.3
_COARSE = 48


@dataclass(frozen=True, slots=True)
class PhaseJump:
    """Samples lost between two others.

    Parameters
    ----------
    first : int
        First sample after the loss.
    samples : int
        How many, at least 1: the smallest number that fits.
    turn_samples : float
        Samples in which the ripple repeats: so many more fit its phase as well.
    gain : float
        Sum of squares that it takes off the residual around it, over the residual's variance.
    """

    first: int
    samples: int
    turn_samples: float
    gain: float


@dataclass(frozen=True, slots=True)
class _Blocks:
    """Whole motor turns: first sample of each, phase of the ripple there, mean speed."""

    edges: NDArray[np.intp]
    angle_rad: FloatArray
    velocity_rad_s: FloatArray


def _stretches(motion: Motion, valid: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the indices at which another four motor turns are done."""
    steps = np.abs(np.diff(motion.angle_rad, prepend=motion.angle_rad[0]))
    travelled = np.cumsum(np.where(valid & np.isfinite(steps), steps, 0.0))
    number = np.floor(travelled / (2.0 * np.pi * _TURNS)).astype(np.int64)
    return np.flatnonzero(np.diff(number, prepend=-1) > 0)


def _blocks(motion: Motion, torque: FloatArray, valid: NDArray[np.bool_]) -> _Blocks | None:
    """Return the phase of order 2 over blocks, as motor angle."""
    edges = _stretches(motion, valid)
    if len(edges) < _LEAST_BLOCKS:
        return None
    level = float(np.mean(torque[valid]))
    part = np.where(valid, torque - level, 0.0) * np.exp(-2j * np.where(valid, motion.angle_rad, 0))
    sums = np.add.reduceat(part, edges)
    phase = np.unwrap(np.angle(sums)) / 2.0
    counts = np.maximum(np.add.reduceat(valid.astype(float), edges), 1.0)
    speed = np.add.reduceat(np.where(valid, motion.velocity_rad_s, 0.0), edges) / counts
    return _Blocks(edges, np.asarray(phase), speed)


def _steps(blocks: _Blocks) -> tuple[FloatArray, FloatArray]:
    """Return the step of the phase between blocks, and the change of speed there."""
    at = np.arange(_SIDE, len(blocks.edges) - _SIDE + 1)
    before = np.array([np.median(blocks.angle_rad[k - _SIDE : k]) for k in at])
    after = np.array([np.median(blocks.angle_rad[k : k + _SIDE]) for k in at])
    slow = np.array([np.ptp(blocks.velocity_rad_s[k - _SIDE : k + _SIDE]) for k in at])
    return after - before, slow


def _candidates(blocks: _Blocks, period_s: float) -> list[tuple[int, float]]:
    """Return the blocks before which the phase jumps, and by how much, rad."""
    steps, change = _steps(blocks)
    scatter = robust_std(steps)
    at = np.arange(_SIDE, _SIDE + len(steps))
    least = _PART * np.abs(blocks.velocity_rad_s[at]) * period_s
    far = np.abs(steps) > np.maximum(_SIGMA * scatter, least)
    far &= change * period_s < _SPEED * np.abs(steps)
    found: list[int] = []
    for k in np.argsort(-np.abs(steps)).tolist():
        if far[k] and all(abs(k - other) > 2 * _SIDE for other in found):
            found.append(k)
    return sorted((int(at[k]), float(steps[k])) for k in found)


def find_phase_jumps(
    motion: Motion, torque: FloatArray, valid: NDArray[np.bool_], profile: ProfileData
) -> list[PhaseJump]:
    """Return where samples were lost without a gap in the stamps, by the phase of the ripple.

    Parameters
    ----------
    motion : Motion
        Motion whose angle was integrated.
    torque : ndarray, shape (n,)
        Measured torque, N m.
    valid : ndarray of bool, shape (n,)
        Samples with both.
    profile : ProfileData
        Bench.

    Returns
    -------
    list of PhaseJump
        In order of time; none where the ripple is too small to tell, or fewer than twelve blocks
        of four motor turns are there.

    Notes
    -----
    While k samples are lost the shaft turns on by ``k w h``, which the integral does not see. The
    phase of order 2 over four motor turns at a time steps there; number and place are then those
    with the least squares of the baseline fitted to the blocks around.
    """
    blocks = _blocks(motion, torque, valid)
    if blocks is None:
        return []
    period = float(np.median(np.diff(motion.time_s)))
    fixed, names, _ = baseline_columns(motion, profile)
    orders = tuple(sorted({float(n.split(":")[1]) for n in names if n.startswith("ripple:")}))
    whole = _Window(
        np.flatnonzero(valid),
        (torque - fixed)[valid],
        motion.angle_rad[valid],
        motion.velocity_rad_s[valid],
        orders,
        period,
    )
    jumps = []
    for block, step in _candidates(blocks, period):
        last = block + 2 * _SIDE
        low = int(blocks.edges[max(0, block - 2 * _SIDE)])
        high = int(blocks.edges[last]) if last < len(blocks.edges) else len(torque)
        ends = (int(blocks.edges[block - 1]), int(blocks.edges[min(block + 1, last)]))
        jump = _placed(whole.between(low, high), ends, step)
        if jump is not None:
            jumps.append(jump)
    return jumps


@dataclass(frozen=True, slots=True)
class _Window:
    """Valid samples around a jump: index, torque less what is fixed, angle, velocity."""

    index: NDArray[np.intp]
    response_nm: FloatArray
    angle_rad: FloatArray
    velocity_rad_s: FloatArray
    orders: tuple[float, ...]
    period_s: float

    def between(self, low: int, high: int) -> _Window:
        """Return the samples from `low` up to before `high`."""
        part = slice(*np.searchsorted(self.index, (low, high)).tolist())
        return _Window(
            self.index[part],
            self.response_nm[part],
            self.angle_rad[part],
            self.velocity_rad_s[part],
            self.orders,
            self.period_s,
        )

    def turn_rad(self, first: int) -> float:
        """Return how far the shaft turns in one period just before a sample."""
        at = max(0, int(np.searchsorted(self.index, first)) - 1)
        return float(self.velocity_rad_s[at]) * self.period_s

    def misfit(self, first: int, samples: int) -> float:
        """Return the least squares of ripple and line with `samples` lost before `first`."""
        turned = self.angle_rad + np.where(self.index >= first, samples * self.turn_rad(first), 0.0)
        waves = [wave(order * turned) for order in self.orders for wave in (np.cos, np.sin)]
        design = np.column_stack([np.ones(len(turned)), self.index - self.index[0], *waves])
        solution = np.linalg.lstsq(design, self.response_nm, rcond=None)[0]
        left = self.response_nm - design @ solution
        return float(left @ left)


def _placed(window: _Window, ends: tuple[int, int], step_rad: float) -> PhaseJump | None:
    """Return number and place, between two ends, of the samples lost at a step of the phase."""
    freedom = len(window.index) - 2 - 2 * len(window.orders)
    places = np.unique(np.linspace(*ends, _COARSE).astype(int))
    turn = window.turn_rad(int(places[len(places) // 2]))
    if freedom < 1 or not abs(turn) > 0.0:
        return None
    # the phase of order 2 repeats after half a turn of the motor
    guess = (step_rad % (np.pi if turn > 0.0 else -np.pi)) / turn
    counts = [k for k in range(round(guess) - 2, round(guess) + 3) if k >= 1]
    if not counts:
        return None
    without = window.misfit(int(window.index[-1]) + 1, 0)
    _, first, samples = min((window.misfit(int(p), k), int(p), k) for p in places for k in counts)
    stride = int(places[1] - places[0]) if len(places) > 1 else 1
    low, high = int(window.index[0]) + 1, int(window.index[-1])
    near = range(max(low, first - stride), min(high, first + stride) + 1)
    best, first = min((window.misfit(place, samples), place) for place in near)
    gain = (without - best) / (best / freedom)
    return PhaseJump(first, samples, np.pi / abs(turn), gain) if gain > _SIGMA**2 else None
