"""Phase of the torque's own ripple: what it says of a jump of the motor angle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.records.trace import FloatArray

__all__ = ["Ripple", "jump_nats"]

# blocks of whole motor turns on each side of a jump: enough for the scatter of their phase, few
# enough for a bench that changes slowly
_SIDE = 40
# blocks on each side below which there is no scatter to judge by
_LEAST = 3
# samples of a block below which its ripple cannot be read
_SAMPLES = 8


@dataclass(frozen=True, slots=True)
class Ripple:
    """What a phase is read from: torque, its valid samples, ripple orders, velocity."""

    torque_nm: FloatArray
    valid: NDArray[np.bool_]
    orders: tuple[float, ...]
    velocity_rad_s: FloatArray


def jump_nats(
    ripple: Ripple, angle_rad: FloatArray, first: int, turn_rad: float, ends: tuple[int, int]
) -> tuple[float, float]:
    """Return by how much the torque is likelier with the angle turned back than as it is, nats.

    And what such a jump, by `turn_rad` at the sample `first`, can make of it on this torque. It is
    positive where the ripple keeps its phase over the angle turned back (a slip), negative where it
    keeps its phase over the recorded angle (the shaft did turn). Nothing else jumps between `ends`.

    Each whole turn of the motor gives one complex amplitude for each order. Their scatter about a
    level and a slope over the velocity, which is what delays make, is the noise, whatever its
    colour: ``sum over orders of (n - 2) ln(RSS as it is / RSS turned back)``. A turn in which the
    torque does something else counts as little as its own fit is bad.
    """
    sides = _sides(ripple, angle_rad, first, ends)
    if sides is None:
        return 0.0, 0.0
    (before, speed_before, var_before), (after, speed_after, var_after) = sides
    amplitudes = np.vstack([before, after])
    variance = np.concatenate([var_before, var_after])
    weights = 1.0 / np.sqrt(variance + float(np.median(variance)) + 1e-300)
    speed = np.concatenate([speed_before, speed_after])
    design = np.column_stack([np.ones(len(speed)), speed - speed.mean()])
    design[:, 1] /= max(float(np.abs(design[:, 1]).max()), 1.0)
    nats = able = 0.0
    shared = float(np.sum(weights**2)) * len(before) * len(after) / len(speed) ** 2
    for k, order in enumerate(ripple.orders):
        turned = amplitudes[:, k].copy()
        turned[len(before) :] *= np.exp(1j * order * turn_rad)
        as_is, back = (_misfit(design, one, weights) for one in (amplitudes[:, k], turned))
        nats += (len(speed) - 2) * float(np.log(max(as_is, 1e-300) / max(back, 1e-300)))
        size = float(np.median(np.abs(amplitudes[:, k]))) * abs(np.exp(1j * order * turn_rad) - 1.0)
        lost = size**2 * shared / max(min(as_is, back), 1e-300)
        able += (len(speed) - 2) * float(np.log1p(lost))
    return nats, able


def _misfit(design: FloatArray, amplitudes: NDArray[np.complex128], weights: FloatArray) -> float:
    part, wanted = design * weights[:, None], amplitudes * weights
    solution = np.linalg.lstsq(part.astype(np.complex128), wanted, rcond=None)[0]
    return float(np.sum(np.abs(wanted - part @ solution) ** 2))


_Side = tuple[NDArray[np.complex128], FloatArray, FloatArray]


def _sides(
    ripple: Ripple, angle_rad: FloatArray, first: int, ends: tuple[int, int]
) -> tuple[_Side, _Side] | None:
    """Return amplitudes, mean speeds and variances of the turns before and after a jump."""
    moves = np.abs(np.diff(angle_rad, prepend=angle_rad[:1]))
    moves = np.where(np.isfinite(moves), moves, 0.0)
    moves[first] = 0.0
    travelled = np.cumsum(moves) / (2.0 * np.pi)
    place = float(travelled[first])
    inside = ripple.valid & np.isfinite(angle_rad)
    inside[: ends[0]] = False
    inside[ends[1] :] = False
    inside &= np.abs(travelled - place) < _SIDE
    rows = np.flatnonzero(inside)
    after = rows >= first
    sides = []
    for part in (rows[~after], rows[after]):
        block = np.floor(np.abs(travelled[part] - place)).astype(np.int64)
        side = _amplitudes(ripple, angle_rad, part, block)
        if side is None:
            return None
        sides.append(side)
    return sides[0], sides[1]


def _amplitudes(
    ripple: Ripple, angle_rad: FloatArray, rows: NDArray[np.intp], block: NDArray[np.int64]
) -> _Side | None:
    """Return the complex amplitude of each order in each block, beside a straight line."""
    found, speeds, variances = [], [], []
    for number in np.unique(block).tolist():
        mine = rows[block == number]
        if len(mine) < max(_SAMPLES, 4 * len(ripple.orders)):
            continue
        angle = angle_rad[mine]
        waves = [wave(order * angle) for order in ripple.orders for wave in (np.cos, np.sin)]
        line = np.linspace(-1.0, 1.0, len(mine))
        design = np.column_stack([np.ones(len(mine)), line, *waves])
        solution = np.linalg.lstsq(design, ripple.torque_nm[mine], rcond=None)[0]
        left = ripple.torque_nm[mine] - design @ solution
        # a cos + b sin = Re (a - i b) exp(i angle)
        found.append(solution[2::2] - 1j * solution[3::2])
        speeds.append(float(np.mean(ripple.velocity_rad_s[mine])))
        variances.append(2.0 * float(left @ left) / len(mine) ** 2)
    if len(found) < _LEAST:
        return None
    return np.array(found), np.array(speeds), np.array(variances)
