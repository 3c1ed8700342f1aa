"""Motion of the shaft: a servo behind the command, integrated at 10 kHz, sampled at 1 kHz."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from .pieces import FINE_S, assemble

__all__ = ["EVERY", "RATIO", "STIFFNESS", "Path", "travel"]

EVERY = 10
RATIO = 100.0
STIFFNESS = 1.6e4
_LIMIT = 2000.0


@dataclass(frozen=True)
class Path:
    """Motion and load; `fine_*` at 10 kHz, all else at the sampling instants."""

    fine_angle: np.ndarray
    fine_speed: np.ndarray
    fine_accel: np.ndarray
    fine_load: np.ndarray
    locked: np.ndarray
    time: np.ndarray
    angle: np.ndarray
    speed: np.ndarray
    accel: np.ndarray
    load: np.ndarray
    output: np.ndarray
    second_encoder: bool

    @property
    def seconds(self):
        """Duration, s."""
        return float(self.time[-1] - self.time[0])

    @property
    def loaded(self):
        """Whether a load is applied, be it one and the same throughout."""
        return bool(np.any(self.load))


def _lag(signal, rate):
    pole = np.exp(-rate * FINE_S)
    return lfilter([1.0 - pole], [1.0, -pole], signal, zi=[signal[0] * pole])[0]


def travel(pieces, rng, second_encoder=False):
    """Integrate the motion that `pieces` command.

    The output angle is the motor's over the ratio; with a second encoder at the output it is less
    the twist under load, which only such an encoder sees.
    """
    command = assemble(pieces, _LIMIT)
    rate = 2.0 * np.pi * rng.uniform(14.0, 22.0)
    speed = _lag(_lag(command.speed, rate), 1.6 * rate)
    load = _lag(_lag(command.load, 40.0), 60.0)
    # no shaft turns evenly: some 0.04 rad/s about 2 Hz while it moves; it comes and goes within
    # 30 ms, for no servo changes its acceleration from one sample to the next
    moving = _lag(_lag(np.minimum(np.abs(command.speed), 1.0), 70.0), 70.0)
    shake = _lag(_lag(rng.standard_normal(len(speed)), 15.0), 15.0)
    speed = speed + 0.04 / shake.std() * shake * moving
    # locked at the output, the motor turns by the twist
    twist = np.where(command.locked, RATIO / STIFFNESS * load, 0.0)
    speed = speed + np.gradient(twist, FINE_S)
    accel = np.gradient(speed, FINE_S)
    angle = np.empty_like(speed)
    angle[0] = 0.0
    np.cumsum(0.5 * FINE_S * (speed[1:] + speed[:-1]), out=angle[1:])
    pick = slice(0, None, EVERY)
    output = angle[pick] / RATIO - (load[pick] / STIFFNESS if second_encoder else 0.0)
    time = np.arange(len(angle[pick])) * (FINE_S * EVERY)
    return Path(
        angle, speed, accel, load, command.locked[pick], time,
        angle[pick], speed[pick], accel[pick], load[pick], output, second_encoder,
    )  # fmt: skip
