"""Transition of every block over a chunk of samples: the NumPy form of the kernel's equations.

Each operation stands in the kernel's order, so that both forms give the same bits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hdbench.filter.layout import BLOCK, MODEL_HEADER
from hdbench.filter.series import decay, sines, tail
from hdbench.records import FloatArray

__all__ = ["Blocks", "steps_of", "transitions"]

_ORDER, _OMEGA, _Q_SAMPLE, _Q_RAD, _Q_S, _RATE, _VARIANCE, _PRIOR = 2, 3, 4, 5, 6, 7, 8, 9
_RANDOM_WALK, _INTEGRATED, _ORNSTEIN, _MATERN, _RESONANCE = 1, 2, 3, 4, 5
_REDUCIBLE = 1e5  # rad: up to here quarter turns are taken off exactly
_PHASE_LIMIT = 32.0  # rad: beyond, a phase loses its whole turns
_PER_TURN = float.fromhex("0x1.45f306dc9c883p-3")
_TURN_1, _TURN_2 = float.fromhex("0x1.921fb5440p2"), float.fromhex("0x1.0b4611a60p-32")


@dataclass(frozen=True, slots=True)
class Blocks:
    """A packed model, unpacked: header numbers and one row of numbers per block.

    Parameters
    ----------
    n_oscillators : int
        Blocks of this kind come first.
    rows : list of list of float
        Kind, part, order, omega, three process noises, rate, variance, two prior variances.
    parts : ndarray, shape (3, n_blocks)
        1 where the block is ripple, misalignment, slow torque.
    """

    n_oscillators: int
    rows: list[list[float]]
    parts: FloatArray

    @classmethod
    def unpack(cls, packed: FloatArray) -> Blocks:
        """Read what `hdbench.filter.statespace.pack` wrote."""
        table = packed[MODEL_HEADER:].reshape(-1, BLOCK)
        parts = np.stack([table[:, 1] == part for part in range(3)]).astype(np.float64)
        return cls(int(packed[0]), table.tolist(), parts)

    def prior(self) -> list[float]:
        """Return the prior variance of every state."""
        return [value for row in self.rows for value in row[_PRIOR : _PRIOR + 2]]


def steps_of(
    blocks: Blocks, psi: list[float], turn: FloatArray, dt: FloatArray
) -> list[list[list[float]]]:
    """Return what every block needs at every sample."""
    columns = []
    axes: list[tuple[FloatArray, FloatArray]] = []
    for i, row in enumerate(blocks.rows):
        if i < blocks.n_oscillators:
            half = _half(blocks, i)
            if half is None:
                angle = row[_OMEGA] * dt if row[_OMEGA] > 0.0 else row[_ORDER] * turn
                cosine, sine = sines(_advance(psi, i, angle.tolist()))
            else:
                cosine, sine = _doubled(*axes[half])
            axes.append((cosine, sine))
            noise = (row[_Q_SAMPLE] + row[_Q_RAD] * np.abs(turn)) + row[_Q_S] * dt
            columns.append(np.stack((cosine, sine, noise), axis=1).tolist())
        else:
            columns.append(np.stack(_slow(row, dt), axis=1).tolist())
    return [list(sample) for sample in zip(*columns, strict=True)]


def transitions(blocks: Blocks, turn: FloatArray, dt: FloatArray) -> FloatArray:
    """Return transition and process noise of every block, in the axes of its torque."""
    out = np.zeros((turn.size, len(blocks.rows), 7))
    for i, row in enumerate(blocks.rows):
        if i < blocks.n_oscillators:
            cosine, sine = sines(row[_ORDER] * turn + row[_OMEGA] * dt)
            noise = (row[_Q_SAMPLE] + row[_Q_RAD] * np.abs(turn)) + row[_Q_S] * dt
            zero = np.zeros_like(noise)
            out[:, i] = np.stack((cosine, sine, -sine, cosine, noise, zero, noise), axis=1)
        else:
            out[:, i] = np.stack(_slow(row, dt), axis=1)
    return out


def _half(blocks: Blocks, i: int) -> int | None:
    """Return the oscillator before `i` that turns through half its angle."""
    order = blocks.rows[i][_ORDER]
    found = [m for m in range(i) if order > 0.0 and order == 2.0 * blocks.rows[m][_ORDER]]
    return found[-1] if found else None


def _doubled(cosine: FloatArray, sine: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return cosine and sine of twice the angle."""
    twice = sine + sine
    return 1.0 - twice * sine, twice * cosine


def _advance(psi: list[float], i: int, turns: list[float]) -> FloatArray:
    """Add up turns, less whole ones beyond a limit; return the phase at each sample."""
    phase, out = psi[i], np.empty(len(turns))
    for k, turn in enumerate(turns):
        phase += _within(turn)
        if abs(phase) > _PHASE_LIMIT:
            phase = _less_turns(phase)
        out[k] = phase
    psi[i] = phase
    return out


def _less_turns(angle: float) -> float:
    whole = float(np.rint(angle * _PER_TURN))
    return (angle - whole * _TURN_1) - whole * _TURN_2


def _within(turn: float) -> float:
    """Return the turn of one sample within the limit; 0 where it is not finite."""
    if abs(turn) <= _PHASE_LIMIT:
        return turn
    if abs(turn) <= _REDUCIBLE:
        return _less_turns(turn)
    return math.atan2(math.sin(turn), math.cos(turn)) if math.isfinite(turn) else 0.0


def _slow(row: list[float], dt: FloatArray) -> tuple[FloatArray, ...]:
    """Return f11, f12, f21, f22, q11, q12, q22 of a slow-torque block."""
    zero, one = np.zeros_like(dt), np.ones_like(dt)
    kind, rate, variance = int(row[0]), row[_RATE], row[_VARIANCE]
    if kind == _RANDOM_WALK:
        return one, zero, zero, zero, row[_Q_SAMPLE] + row[_Q_S] * dt, zero, zero
    if kind == _INTEGRATED:
        q = row[_Q_S] * dt
        return one, dt, zero, one, q * dt * dt * (1.0 / 3.0), q * dt * 0.5, q
    a = rate * dt
    missing = decay(a)
    e = 1.0 - missing
    if kind == _ORNSTEIN:
        return e, zero, zero, zero, variance * (missing * (1.0 + e)), zero, zero
    if kind == _RESONANCE:
        return _resonance(row, dt, e)
    b = 2.0 * a
    eb = 1.0 - decay(b)
    third = b * b * b * (1.0 / 6.0) * tail(b)
    with np.errstate(over="ignore", invalid="ignore"):  # values of the branch that is not taken
        f1 = np.where(b <= 0.5, eb * third, 1.0 - eb * (1.0 + b + 0.5 * b * b))
        return (
            e * (1.0 + a),
            e * dt,
            -(rate * a * e),
            e * (1.0 - a),
            variance * f1,
            variance * rate * (2.0 * a * a * eb),
            variance * rate * rate * (2.0 * b * eb + f1),
        )


def _resonance(row: list[float], dt: FloatArray, e: FloatArray) -> tuple[FloatArray, ...]:
    """Return the same of a damped oscillator; `e` is its envelope, order its damped frequency."""
    w, rate, variance, w2 = row[_ORDER], row[_RATE], row[_VARIANCE], row[_OMEGA] * row[_OMEGA]
    missing = decay(2.0 * (rate * dt))
    c, s = sines(np.array([_within(turn) for turn in (w * dt).tolist()]))
    s = s / w
    zs = rate * s
    pull = 2.0 * zs * (1.0 - missing)
    q1 = missing - pull * (c + zs)
    return (
        e * (c + zs),
        e * s,
        -(w2 * (e * s)),
        e * (c - zs),
        variance * np.where(q1 > 0.0, q1, 0.0),
        variance * w2 * (pull * s),
        variance * w2 * (missing + pull * (c - zs)),
    )
