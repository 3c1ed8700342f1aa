"""Ripple of the tacho: speed that the tacho shows and the encoder does not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.acquisition.channels import Shaft
from hdbench.model.localfit import fit_derivative
from hdbench.model.motion import ACCELERATION_WINDOW_S
from hdbench.records.trace import FloatArray

__all__ = ["TachoRipple", "find_tacho_ripple", "tacho_factor"]

# commutators have some tens of segments and ripple at twice their number; a gear before the tacho
# or an eccentric rotor makes low orders
_ORDERS = 128
# turns of the motor below which neighbouring orders cannot be told apart
_TURNS = 10.0
# places between whole orders that show how large a line is by chance
_BETWEEN = 24
# power over the median beside it: 2^-45 by chance for exponential power, times 128 orders; the
# median of some forty places is known well enough for a third of that exponent to be lost
_RATIO = 60.0
# an order's own wave at rest has 2; it wanders by far less over ten turns
_STILL = 0.2
# whole orders on each side of one for a first look
_NEAR = 12
# the encoder shows this part of the line at most, else the shaft itself turns unevenly
_SHAFT = 0.33
# relative ripple below which it is not worth a name: a tenth of what commutators have
_LEAST = 1e-3
# lines of one tacho at most
_LINES = 4


@dataclass(frozen=True, slots=True)
class TachoRipple:
    """One line of the tacho's ripple: velocity times ``1 + a cos(k theta + p)``.

    Parameters
    ----------
    order : float
        k, per motor turn.
    amplitude, std : float
        a, of the speed, and its standard uncertainty.
    phase_rad, phase_std_rad : float
        p, rad, and its standard uncertainty.
    power_ratio : float
        Power over the median of the places beside it.
    """

    order: float
    amplitude: float
    std: float
    phase_rad: float
    phase_std_rad: float
    power_ratio: float


def tacho_factor(angle_rad: FloatArray, lines: tuple[TachoRipple, ...]) -> FloatArray:
    """Return the tacho's reading over the true speed.

    Parameters
    ----------
    angle_rad : ndarray, shape (n,)
        Motor angle, rad.
    lines : tuple of TachoRipple
        Lines.

    Returns
    -------
    ndarray, shape (n,)
        ``1 + sum a cos(k theta + p)``.
    """
    factor = np.ones(len(angle_rad))
    for line in lines:
        factor += line.amplitude * np.cos(line.order * angle_rad + line.phase_rad)
    return factor


def _line(left: FloatArray, speed: FloatArray, angle: FloatArray, order: float) -> complex:
    """Return a - i b of ``speed (a cos + b sin)(order angle)`` in `left`."""
    wave = np.exp(-1j * order * angle)
    return complex(2.0 * np.vdot(np.conj(wave), speed * left) / float(speed @ speed))


def find_tacho_ripple(shaft: Shaft) -> tuple[TachoRipple, ...]:
    """Return the lines that the tacho shows over whole motor orders and the encoder does not.

    Parameters
    ----------
    shaft : Shaft
        Angle and velocity.

    Returns
    -------
    tuple of TachoRipple
        Largest first, four at most; none on less than ten motor turns.

    Notes
    -----
    The smooth speed, by a local polynomial over 20 ms of the angle, is taken from the tacho and
    from the differences of the angle alike; a line is the tacho's where its power is sixty times
    the median of the places between the orders around it, and where the encoder shows less than
    a third of it.
    """
    valid = np.isfinite(shaft.angle_rad) & np.isfinite(shaft.velocity_rad_s)
    smooth = fit_derivative(
        shaft.time_s, shaft.angle_rad, derivative=1, degree=4, window_s=ACCELERATION_WINDOW_S
    ).derivative
    central = np.full(len(valid), np.nan)
    central[1:-1] = (shaft.angle_rad[2:] - shaft.angle_rad[:-2]) / (
        shaft.time_s[2:] - shaft.time_s[:-2]
    )
    central[1:-1][~(shaft.good[1:] & shaft.good[:-1])] = np.nan
    valid &= np.isfinite(smooth) & np.isfinite(central)
    angle, speed = shaft.angle_rad[valid], smooth[valid]
    turns = float(np.abs(np.diff(angle)).sum()) / (2.0 * np.pi) if len(angle) else 0.0
    if not turns > _TURNS:
        return ()
    by_tacho, by_encoder = shaft.velocity_rad_s[valid] - speed, central[valid] - speed
    # the tacho's gain is no ripple
    by_tacho = by_tacho - float(by_tacho @ speed) / float(speed @ speed) * speed
    lines: list[TachoRipple] = []
    for _ in range(_LINES):
        line = _strongest(by_tacho, by_encoder, speed, angle)
        if line is None:
            break
        lines.append(line)
        by_tacho = by_tacho - speed * (tacho_factor(angle, (line,)) - 1.0)
    return tuple(lines)


def _strongest(
    by_tacho: FloatArray, by_encoder: FloatArray, speed: FloatArray, angle: FloatArray
) -> TachoRipple | None:
    """Return the strongest line that is the tacho's alone; None where there is none."""
    powers = _powers(by_tacho, speed, angle)
    best = None
    for order in np.argsort(-powers)[:_LINES].tolist():
        k = float(order + 1)
        # whole orders around it are background too, up to a few other lines: a first look
        near = powers[max(0, order - _NEAR) : order + _NEAR]
        if not float(powers[order]) > 0.3 * _RATIO * float(np.median(near)):
            continue
        beside = _beside(by_tacho, speed, angle, k)
        ratio = float(powers[order]) / beside if beside > 0.0 else np.inf
        mine = _line(by_tacho, speed, angle, k)
        # at one speed an order that aliases to rest is a wrong gain
        if abs(_line(speed, speed, angle, k)) > _STILL:
            continue
        shown = _line(by_encoder, speed, angle, k)
        if ratio > _RATIO and abs(shown) < _SHAFT * abs(mine) and abs(mine) > _LEAST:
            # power of a pair is exponential: its mean is the median over ln 2, half of it each
            std = float(np.sqrt(beside / np.log(2.0) / 2.0))
            # c = a - i b, so that a cos + b sin = |c| cos(k angle + arg c)
            amplitude = abs(mine)
            best = TachoRipple(
                k, amplitude, std, float(np.angle(mine)), std / amplitude, min(ratio, 1e12)
            )
            break
    return best


def _powers(left: FloatArray, speed: FloatArray, angle: FloatArray) -> FloatArray:
    """Return the squared amplitude at orders 1 to 128."""
    turn = np.exp(-1j * angle)
    wave = np.ones(len(angle), dtype=complex)
    weighted = 2.0 * speed * left / float(speed @ speed)
    powers = np.empty(_ORDERS)
    for k in range(_ORDERS):
        wave *= turn
        powers[k] = abs(complex(wave @ weighted)) ** 2
    return powers


def _beside(left: FloatArray, speed: FloatArray, angle: FloatArray, order: float) -> float:
    """Return the median squared amplitude at places between whole orders around `order`."""
    parts = np.linspace(0.25, 0.75, _BETWEEN)
    places = np.concatenate([order - parts, order + parts])
    places = places[places > 0.0]
    return float(np.median([abs(_line(left, speed, angle, float(p))) ** 2 for p in places]))
