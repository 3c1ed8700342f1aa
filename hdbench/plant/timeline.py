"""One acquisition on the integration steps: motion, channels, filtered samples, interruptions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdbench.plant.converter import HALF_LENGTH_SAMPLES, Decimator, steps_per_sample
from hdbench.plant.fixture import Mount
from hdbench.plant.reference import ReferenceLine
from hdbench.plant.servo import HoldMotion, command_rad_s, servo_loop
from hdbench.plant.torque import AnalogueChannels
from hdbench.records.trace import FloatArray

__all__ = ["Timeline", "TrueSamples"]

# Holds computed at once. Blocks of one size at fixed places give the same bits however the samples
# are asked for: array functions may round differently at the end of an array.
BLOCK_HOLDS = 64


@dataclass(frozen=True, slots=True)
class TrueSamples:
    """Filtered channels and latched values, without noise.

    Parameters
    ----------
    volts : ndarray, shape (3, n)
        Torque, tacho and current channel, V.
    angle_rad : ndarray, shape (n,)
        Wave-generator angle at the time stamps, rad.
    reference_v : ndarray, shape (n,)
        Motor reference that is put out from the time stamp on, V.
    """

    volts: FloatArray
    angle_rad: FloatArray
    reference_v: FloatArray


class Timeline:
    """Samples of one acquisition, in pieces of any size.

    Parameters
    ----------
    channels : AnalogueChannels
        From motion to volts.
    sample_period_s : float
        Sampling period, s; the reference is held for one period (the generator's clock).
    reference_v : ndarray, shape (n,)
        Reference for every sample, V; its last value stays until `stop`. At least one value.
    mount : Mount
        Lock, arm and weight at the start.
    start : tuple of float, optional
        Angle, rad, and speed, rad/s, at the start; the bench has had this speed before.
    host_written : bool, optional
        Whether `write` changes the reference while samples are taken; nothing is then computed
        ahead.

    Notes
    -----
    Time 0 is the first sample; before it the bench stands at its home mark. The node hands out a
    sample when its filter has seen the `HALF_LENGTH_SAMPLES` periods after it; so an interruption
    after n samples takes effect that much after the last of them.
    """

    def __init__(
        self,
        channels: AnalogueChannels,
        sample_period_s: float,
        reference_v: FloatArray,
        mount: Mount,
        *,
        start: tuple[float, float] = (0.0, 0.0),
        host_written: bool = False,
    ) -> None:
        self._channels = channels
        self._period_s = sample_period_s
        self._n_steps = steps_per_sample(sample_period_s)
        self._decimator = Decimator.design(self._n_steps)
        self._loop = servo_loop(channels.profile.servo)
        self._reference = ReferenceLine(reference_v)
        self._ahead = 0 if host_written else BLOCK_HOLDS
        self._mount = mount
        self._served = 0
        self._edge = 0
        self._starts = np.array(start)[:, None]
        self._starts_first = 0
        self._volts = self._before(start)
        self._ready = np.zeros((3, 0))

    @property
    def served(self) -> int:
        """How many samples were handed out."""
        return self._served

    @property
    def now_hold(self) -> int:
        """Index of the hold that begins when the last sample was handed out."""
        return self._served + HALF_LENGTH_SAMPLES - 1 if self._served else 0

    @property
    def now_s(self) -> float:
        """Acquisition time at the leading edge, s."""
        return self.now_hold * self._period_s

    @property
    def sample_period_s(self) -> float:
        """Sampling period, s."""
        return self._period_s

    @property
    def mount(self) -> Mount:
        """Lock, arm and weight."""
        return self._mount

    @property
    def reference_now_v(self) -> float:
        """Motor reference at the leading edge, V."""
        return float(self.references(self.now_hold, 1)[0])

    @property
    def angle_now_rad(self) -> float:
        """Wave-generator angle at the leading edge, rad."""
        return self._state(self.now_hold)[0]

    @property
    def velocity_now_rad_s(self) -> float:
        """Motor speed at the leading edge, rad/s."""
        return self._state(self.now_hold)[1]

    @property
    def stopped(self) -> bool:
        """Whether the reference was zeroed for good."""
        return self._reference.ended

    def references(self, first: int, count: int) -> FloatArray:
        """Return the reference of `count` holds from `first` on."""
        return self._reference.values(first, count)

    def stop(self) -> None:
        """Zero the reference at the leading edge."""
        if not self.stopped:
            self._interrupt()
            self._reference.end(self.now_hold)

    def write(self, hold: int, value_v: float) -> None:
        """Put out another reference from a hold on; for a host-written reference only."""
        self._reference.write(max(hold, self.now_hold), value_v)

    def remount(self, mount: Mount) -> None:
        """Change lock, arm or weight at the leading edge."""
        self._interrupt()
        self._mount = mount

    def advance(self, n_samples: int) -> TrueSamples:
        """Return the next samples."""
        volts, angles = [np.zeros((3, 0))], [np.zeros(0)]
        first, left = self._served, n_samples
        while left > 0:
            if self._ready.shape[1] == 0:
                self._extend(left)
                continue
            take = min(left, self._ready.shape[1])
            at = self._served - self._starts_first
            volts.append(self._ready[:, :take])
            angles.append(self._starts[0, at : at + take])
            self._ready = self._ready[:, take:]
            self._served += take
            left -= take
        reference = self.references(first, n_samples)
        self._reference.forget(self._served - 1)
        return TrueSamples(np.concatenate(volts, axis=1), np.concatenate(angles), reference)

    def _state(self, hold: int) -> tuple[float, float]:
        """Return angle and speed at the start of `hold`."""
        angle, speed = self._starts[:, hold - self._starts_first]
        return float(angle), float(speed)

    def _before(self, start: tuple[float, float]) -> FloatArray:
        """Return the channels of the periods before the first sample."""
        angle, speed = start
        angle -= speed * HALF_LENGTH_SAMPLES * self._period_s
        command = np.full(HALF_LENGTH_SAMPLES, speed)
        return self._simulate(-HALF_LENGTH_SAMPLES, command, (angle, speed, speed))[0]

    def _simulate(
        self, first: int, command: FloatArray, start: tuple[float, float, float]
    ) -> tuple[FloatArray, HoldMotion]:
        """Return channels and motion of the holds from `first` on."""
        step_s = self._period_s / self._n_steps
        if self._mount.locked:
            command, start = np.zeros_like(command), (0.0, 0.0, 0.0)
        motion = self._loop.run(command, step_s, self._n_steps, start)
        steps = np.arange(len(command) * self._n_steps, dtype=np.float64)
        time_s = first * self._period_s + steps.reshape(len(command), -1) * step_s
        return self._channels.volts(time_s, motion, self._mount), motion

    def _extend(self, wanted: int) -> None:
        """Compute the next block of holds and filter what it completes."""
        keep = min(self._volts.shape[1], 2 * HALF_LENGTH_SAMPLES - 1)
        holds = self._ahead or wanted + 2 * HALF_LENGTH_SAMPLES - 1 - keep
        references = self.references(self._edge - 1, holds + 1)
        command = command_rad_s(self._channels.profile, references)
        start = (*self._state(self._edge), float(command[0]))
        volts, motion = self._simulate(self._edge, command[1:], start)
        self._volts = np.concatenate((self._volts[:, -keep:], volts), axis=1)
        self._ready = self._decimator.apply(self._volts)
        starts = np.stack((motion.start_angle_rad, motion.start_velocity_rad_s))
        old = self._starts[:, self._served - self._starts_first : self._edge - self._starts_first]
        self._starts = np.concatenate((old, starts), axis=1)
        self._starts_first = self._served
        self._edge += holds

    def _interrupt(self) -> None:
        """Forget what was computed beyond the leading edge."""
        surplus = self._edge - self.now_hold
        if surplus > 0:
            self._volts = self._volts[:, :-surplus]
            self._ready = self._ready[:, :0]
            self._starts = self._starts[:, : self.now_hold - self._starts_first + 1]
            self._edge = self.now_hold
