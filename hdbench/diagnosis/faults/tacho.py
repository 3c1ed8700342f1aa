"""Ripple of the tacho: speed over whole motor orders that the angle does not show."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.faults.fault import Fault, fault_over
from hdbench.diagnosis.faults.scatter import ACCEPT_NATS, CERTAIN_NATS, fast_part, least_squares
from hdbench.diagnosis.faults.shaft import Shaft
from hdbench.model.motion import ACCELERATION_WINDOW_S
from hdbench.records.trace import FloatArray
from hdbench.results.diagnosis import ParameterValue

# commutators have some tens of segments and ripple at twice their number; a gear before the tacho
# or an eccentric rotor makes low orders
_ORDERS = 128
# turns over which the angle is folded: places between whole orders show what chance makes, those
# between so many whole orders on each side
_FOLD, _NEAR = 4, 3
# lines of one tacho at most
_LINES = 4


def find_tacho_ripple(shaft: Shaft) -> tuple[Fault, ...]:
    """Return the lines of the tacho that chance does not make and the angle does not show."""
    folded = _Folded(shaft)
    faults: list[Fault] = []
    # in ten turns of the motor neighbouring orders are told apart
    while folded.turns > 10.0 and len(faults) < _LINES:
        fault = folded.strongest()
        if fault is None:
            break
        faults.append(fault)
        cosine, sine = folded.waves(fault.shape["order"])[0].T
        folded.by_tacho -= fault.shape["cosine"] * cosine + fault.shape["sine"] * sine
    return tuple(faults)


class _Folded:
    """Speeds by tacho and angle without what is slow, folded over four turns of the motor."""

    def __init__(self, shaft: Shaft) -> None:
        self.shaft = shaft
        central = self.central(shaft.angle_rad)
        central[1:-1][~(shaft.good[1:] & shaft.good[:-1])] = np.nan
        self.valid = np.isfinite(central) & np.isfinite(shaft.velocity_rad_s)
        self.angle = shaft.angle_rad[self.valid]
        self.speed = shaft.velocity_rad_s[self.valid]
        self.turns = float(np.abs(np.diff(self.angle)).sum()) / (2.0 * np.pi)
        # eight cells for each turn of the highest order
        self.n_cells = 8 * _ORDERS * _FOLD
        turn = np.mod(self.angle / (2.0 * np.pi * _FOLD), 1.0)
        self.cell = np.minimum((turn * self.n_cells).astype(np.int64), self.n_cells - 1)
        self.size = 2 * max(2, round(0.5 * ACCELERATION_WINDOW_S / shaft.period_s)) + 1
        self.by_tacho = fast_part(self.speed, self.size)
        self.by_angle = fast_part(central[self.valid], self.size)

    def lines(self, values: FloatArray) -> NDArray[np.complex128]:
        """Return the amplitude relative to the speed at every quarter order."""
        cells = np.bincount(self.cell, values * self.speed, self.n_cells)
        sizes = np.fft.rfft(cells)[: (_ORDERS + _NEAR) * _FOLD]
        return np.asarray(2.0 * sizes / max(float(self.speed @ self.speed), 1e-300))

    def central(self, angle: FloatArray) -> FloatArray:
        """Return the speed by central differences of an angle."""
        out, steps = np.full(len(angle), np.nan), self.shaft.steps_s
        out[1:-1] = (angle[2:] - angle[:-2]) / (steps[1:] + steps[:-1])
        return out

    def waves(self, order: float) -> tuple[FloatArray, FloatArray]:
        """Return cosine and sine of one order of the speed, as tacho and angle show them."""
        angle = order * np.nan_to_num(self.shaft.angle_rad)
        by_tacho = [wave(order * self.angle) * self.speed for wave in (np.cos, np.sin)]
        turned = (np.sin(angle) / order, -np.cos(angle) / order)
        by_angle = [self.central(wave)[self.valid] for wave in turned]
        first, second = (
            np.column_stack([fast_part(wave, self.size) for wave in waves])
            for waves in (by_tacho, by_angle)
        )
        return first, second

    def strongest(self) -> Fault | None:
        """Return the strongest line of the tacho alone."""
        whole = _FOLD * np.arange(1, _ORDERS + 1)
        around = np.arange(-_FOLD * _NEAR, _FOLD * _NEAR + 1)
        places = np.abs(whole[:, None] + around[around % _FOLD != 0])
        powers, shown = (np.abs(self.lines(one)) ** 2 for one in (self.by_tacho, self.by_angle))
        # power of chance is exponential: its mean is the median over ln 2
        chance, unsure = (
            np.maximum(np.median(some[places], axis=1) / np.log(2.0), 1e-300)
            for some in (powers, shown)
        )
        powers = powers[whole]
        nats = np.minimum(powers / chance - np.log(_ORDERS), CERTAIN_NATS)
        for at in np.argsort(-np.where(nats > ACCEPT_NATS, powers, 0.0))[:_LINES].tolist():
            if not nats[at] > ACCEPT_NATS:
                break
            tacho, angle = self.waves(at + 1.0)
            size = least_squares(tacho, self.by_tacho)
            seen = least_squares(angle, self.by_angle)
            # an angle too noisy, or too rarely read, to show the line cannot deny it
            part = float(np.sum(angle**2) / max(np.sum(tacho**2), 1e-300))
            denied = part * powers[at] / unsure[at] - np.log(_ORDERS) > ACCEPT_NATS
            # what the angle shows too is the shaft itself, turning unevenly; a tenth of what
            # commutators have is worth no name
            small = np.linalg.norm(seen) < 0.33 * np.linalg.norm(size)
            if np.linalg.norm(size) > 1e-3 and denied and small:
                return self.fault(at + 1.0, size, float(chance[at] / powers[at]), float(nats[at]))
        return None

    def fault(self, order: float, size: FloatArray, doubt: float, nats: float) -> Fault:
        """Return a line as a fault; `doubt` is the power of chance over its own."""
        amplitude, std = float(np.hypot(*size)), float(np.sqrt(0.5 * doubt))
        shape = {"order": order, "cosine": float(size[0]), "sine": float(size[1])}
        parameters = {
            "order": ParameterValue(order, None, "1"),
            "relative_amplitude": ParameterValue(amplitude, std * amplitude, "1"),
            "phase_rad": ParameterValue(float(np.arctan2(-size[1], size[0])), std, "rad"),
        }
        time = self.shaft.time_s
        return fault_over("tacho-ripple", parameters, time, nats, shape=shape, domain="motor-order")
