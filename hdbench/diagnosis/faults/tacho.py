"""Ripple of the tacho: speed over whole motor orders that the angle does not show."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from hdbench.diagnosis.faults.fault import ACCEPT_NATS, Fault, entry
from hdbench.diagnosis.faults.shaft import VELOCITIES, Shaft, scaled
from hdbench.model.kinematics import ACCELERATION_WINDOW_S
from hdbench.records.trace import FloatArray, Trace

__all__ = ["find_tacho_ripple", "without_ripple"]

# commutators have some tens of segments and ripple at twice their number; a gear before the tacho
# or an eccentric rotor makes low orders
_ORDERS = 128
# turns of the motor below which neighbouring orders cannot be told apart
_TURNS = 10.0
# turns over which the angle is folded: places between whole orders show what chance makes
_FOLD = 4
# cells of a turn: eight for the highest order
_CELLS = 8 * _ORDERS
# whole orders on each side whose places in between are the background
_NEAR = 3
# an order's own wave at rest has 2; it wanders by far less over ten turns
_STILL = 0.2
# the angle shows this part of the line at most, else the shaft itself turns unevenly
_SHAFT = 0.33
# relative ripple below which it is not worth a name: a tenth of what commutators have
_LEAST = 1e-3
# rounding of a speed that ripples makes lines of this part of a step
_ROUNDING = 0.5
# lines of one tacho at most
_LINES = 4


def without_ripple(
    trace: Trace, angle_rad: FloatArray, shape: Mapping[str, float], power: int = 1
) -> Trace:
    """Return the trace with its velocity over ``1 + c cos(k theta) + s sin(k theta)``.

    With power -1 the ripple is put back.
    """
    angle = shape["order"] * np.where(np.isfinite(angle_rad), angle_rad, 0.0)
    factor = 1.0 + shape["cosine"] * np.cos(angle) + shape["sine"] * np.sin(angle)
    return scaled(trace, VELOCITIES, factor ** float(-power))


def _fast(values: FloatArray, size: int) -> FloatArray:
    """Return values less their running mean, twice."""
    for _ in range(2):
        values = values - uniform_filter1d(values, size, mode="nearest")
    return values


class _Folded:
    """Speeds by tacho and angle without what is slow, folded over four turns of the motor."""

    def __init__(self, shaft: Shaft) -> None:
        self.shaft = shaft
        central = self.central(shaft.angle_rad)
        central[1:-1][~(shaft.good[1:] & shaft.good[:-1])] = np.nan
        valid = self.valid = np.isfinite(central) & np.isfinite(shaft.velocity_rad_s)
        size = 2 * max(2, round(0.5 * ACCELERATION_WINDOW_S / shaft.period_s)) + 1
        self.angle = shaft.angle_rad[valid]
        self.speed = shaft.velocity_rad_s[valid]
        self.size = min(size, max(1, len(self.angle)))
        self.by_tacho = _fast(self.speed, self.size)
        self.by_angle = _fast(central[valid], self.size)
        moves = np.abs(np.diff(self.angle))
        self.turns = float(moves.sum()) / (2.0 * np.pi) if len(moves) else 0.0
        turn = np.mod(self.angle / (2.0 * np.pi * _FOLD), 1.0)
        self.cell = np.minimum((turn * _CELLS * _FOLD).astype(np.int64), _CELLS * _FOLD - 1)
        self.power = float(self.speed @ self.speed)

    def lines(self, values: FloatArray) -> NDArray[np.complex128]:
        """Return the amplitude relative to the speed at every quarter order."""
        cells = np.bincount(self.cell, values * self.speed, _CELLS * _FOLD)
        return np.asarray(2.0 * np.fft.rfft(cells)[: _ORDERS * _FOLD + _FOLD * _NEAR] / self.power)

    def central(self, angle: FloatArray) -> FloatArray:
        """Return the speed by central differences of an angle."""
        out, steps = np.full(len(angle), np.nan), self.shaft.steps_s
        out[1:-1] = (angle[2:] - angle[:-2]) / (steps[1:] + steps[:-1])
        return out

    def fit(self, order: float, rest: FloatArray) -> tuple[complex, complex, float]:
        """Return a - i b of a cos + b sin of the speed at one order, by tacho and by angle.

        And how much of its power differences of the angle show; both beside the filter's share.
        """
        angle, sizes, power = np.nan_to_num(self.shaft.angle_rad), [], []
        by_tacho = [w(order * self.angle) * self.speed for w in (np.cos, np.sin)]
        turned = (np.sin(order * angle) / order, -np.cos(order * angle) / order)
        by_angle = [self.central(wave)[self.valid] for wave in turned]
        for waves, values in ((by_tacho, rest), (by_angle, self.by_angle)):
            design = np.column_stack([_fast(wave, self.size) for wave in waves])
            gram = design.T @ design
            a, b = np.linalg.lstsq(gram, design.T @ values, rcond=None)[0].tolist()
            sizes.append(complex(a, -b))
            power.append(float(np.trace(gram)))
        return sizes[0], sizes[1], power[1] / max(power[0], 1e-300)


def find_tacho_ripple(trace: Trace, shaft: Shaft) -> tuple[tuple[Fault, ...], Trace]:
    """Return the ripple of the tacho, one fault for each line, and the trace without it.

    Lines whose power is above the mean of the places between the orders around by what chance
    does not make on any order, and that the angle does not show.
    """
    folded = _Folded(shaft)
    if not folded.turns > _TURNS or not folded.power > 0.0:
        return (), trace
    faults, rest = [], folded.by_tacho
    for _ in range(_LINES):
        line = _strongest(folded, rest, shaft.tacho_step_rad_s)
        if line is None:
            break
        order, amplitude, std, nats = line
        faults.append(_fault(shaft, order, amplitude, std, nats))
        wave = folded.speed * np.real(amplitude * np.exp(1j * order * folded.angle))
        rest = rest - _fast(wave, folded.size)
    for fault in faults:
        trace = without_ripple(trace, shaft.angle_rad, fault.shape)
    return tuple(faults), trace


def _strongest(
    folded: _Folded, rest: FloatArray, step: float
) -> tuple[float, complex, float, float] | None:
    """Return order, amplitude, its uncertainty and evidence of the strongest line of the tacho."""
    seen = folded.lines(rest)
    powers = np.abs(seen) ** 2
    whole = np.arange(1, _ORDERS + 1)
    # at one speed an order that aliases to rest is a wrong gain
    rests = np.abs(folded.lines(folded.speed))[_FOLD * whole] > _STILL
    around = np.concatenate([np.arange(-_FOLD * _NEAR, 0), np.arange(1, _FOLD * _NEAR + 1)])
    around = around[around % _FOLD != 0]
    places = np.abs(_FOLD * whole[:, None] + around)
    # power of chance is exponential: its mean is the median over ln 2
    background, unsure = (
        np.median(some[places], axis=1) / np.log(2.0)
        for some in (powers, np.abs(folded.lines(folded.by_angle)) ** 2)
    )
    nats = powers[_FOLD * whole] / np.maximum(background, 1e-300) - np.log(_ORDERS)
    least = max(_LEAST, _ROUNDING * step / float(np.sqrt(np.mean(folded.speed**2))))
    for at in np.argsort(-np.where(rests, 0.0, powers[_FOLD * whole]))[:_LINES].tolist():
        if rests[at] or not nats[at] > ACCEPT_NATS:
            continue
        order = float(whole[at])
        amplitude, shown, part = folded.fit(order, rest)
        seen_size = float(np.sqrt(powers[_FOLD * whole[at]]))
        # an angle too noisy, or too rarely read, to show the line cannot deny it
        able = part * seen_size**2 / max(float(unsure[at]), 1e-300)
        denied = able - np.log(_ORDERS) > ACCEPT_NATS
        if abs(amplitude) > least and denied and abs(shown) < _SHAFT * abs(amplitude):
            std = float(np.sqrt(0.5 * background[at])) * abs(amplitude) / max(seen_size, 1e-300)
            return order, amplitude, std, float(min(nats[at], 1e12))
    return None


def _fault(shaft: Shaft, order: float, amplitude: complex, std: float, nats: float) -> Fault:
    size, time, count = abs(amplitude), shaft.time_s, len(shaft.time_s)
    shape = {"order": order, "cosine": amplitude.real, "sine": -amplitude.imag}
    parameters = {
        "order": entry(order, None, "1"),
        "relative_amplitude": entry(size, std, "1"),
        "phase_rad": entry(float(np.angle(amplitude)), std / size, "rad"),
    }
    return Fault(
        "tacho-ripple", parameters, count, float(time[0]), float(time[-1]), nats,
        float(np.exp(-min(nats, 700.0))), shaft.names, shape, domain="motor-order",
    )  # fmt: skip
