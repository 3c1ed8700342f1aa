"""The simulated bench as an electrical instrument: what any emulated DAQ has at its terminals.

An emulated device of any make owns one `SimulatedInstrument` and nothing else of the simulation.
It has, in volts and levels:

* inputs: torque (the amplified bridge), tacho, motor current, the motor reference looped back, and
  the counter of a quadrature encoder;
* outputs: the motor reference, which the host writes through the device, and the enable line of
  the drive. The drive follows the reference only while the line is on; switched off it brakes to
  standstill within its limits, whatever stands at its reference input.

Time is that of the `clock` handed in, in seconds, and passes by itself. `device_clock` is the
monotonic clock, or a multiple of it for an accelerated pace; a host that is to keep up with an
accelerated device needs the same multiple for its own reference program and nothing else (deadlines
on the wire and watchdogs stay in real time). What is written takes effect at the next hold, that is
within one sampling period.

How a device uses it::

    instrument = SimulatedInstrument(bench, counts_per_turn, clock=device_clock())
    instrument.write_enable(on=True)
    instrument.write_reference(1.5)
    instrument.begin(sample_period_s=1e-3)      # a scan clock starts
    while streaming:
        samples = instrument.take(max_samples)  # every sample whose time has come
    instrument.end()
    reading = instrument.look()                 # polled devices: the last of these is now

A polled device never calls `begin`. A device with a scan clock reads single values with `look`
only between `end` and `begin`, as real ones do. A tick every 5 ms (`catch_up`) keeps the motor
moving and its record complete while nobody asks.

Plant, model, seed and all computation are those of the emulated node (`SimulatedBench`): with the
same seed both show the same bench, the same torque and, sample by sample, the same noise; the
motion differs by how a host's writes fall on the holds.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hdbench.plant.bench import SimulatedBench
from hdbench.plant.converter import HALF_LENGTH_SAMPLES, to_count
from hdbench.plant.timeline import ReferenceLine
from hdbench.records.trace import FloatArray

Input = Literal["torque", "tacho", "current", "reference"]
"""An analog input."""
Terminal = tuple[Input, float]
"""What is wired to an input of a device, and how many volts of it stand there per volt."""
Record = Callable[[Mapping[str, object]], None]
# grain of the simulation while no scan clock runs, s
IDLE_PERIOD_S = 1e-3
# idle time is made up by at most this many samples at once
_MAX_IDLE_SAMPLES = 1000
# below this speed, rad/s, a motor with command zero stands: a quarter of a count of 1.6 mrad per s
_STANDSTILL_RAD_S = 4e-4


def device_clock(
    speed: float = 1.0, *, clock: Callable[[], float] = time.monotonic
) -> Callable[[], float]:
    """Return a clock that runs `speed` times as fast as another, from 0 now on."""
    start_s = clock()
    return lambda: speed * (clock() - start_s)


@dataclass(frozen=True, slots=True)
class ElectricalSamples:
    """What stands at the terminals at the sampling instants.

    Parameters
    ----------
    first_index : int
        Index of the first sample since `begin`.
    volts : dict of str to ndarray, shape (n,)
        ``torque``, ``tacho``, ``current``, ``reference`` in V, before any converter.
    count : ndarray of int64, shape (n,)
        Quadrature counts since the device was switched on; never wraps.
    """

    first_index: int
    volts: dict[Input, FloatArray]
    count: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.count)


@dataclass(eq=False)
class SimulatedInstrument:
    """One simulated bench wired to a device.

    Parameters
    ----------
    bench : SimulatedBench
        Drive, load and sensor.
    counts_per_turn : int
        Encoder counts per motor turn after quadrature.
    clock : callable
        Device time, s.
    record : callable, optional
        Takes one mapping per change and while the motor turns: ``event``, ``monotonic_s``,
        ``device_s``, ``reference_v``, ``enabled``, ``velocity_rad_s``, ``samples_taken``.
    monotonic : callable, optional
        Wall clock of the records, s.
    """

    bench: SimulatedBench
    counts_per_turn: int
    _: KW_ONLY
    clock: Callable[[], float]
    record: Record = lambda _: None
    monotonic: Callable[[], float] = time.monotonic

    def __post_init__(self) -> None:
        self.reference_v = 0.0
        self.enabled = False
        self._sampling = False
        # what the counter reads at the home mark
        self._count_offset = 0
        self._newest: ElectricalSamples | None = None
        self._open(IDLE_PERIOD_S, counted=False)

    @property
    def velocity_rad_s(self) -> float:
        """True motor speed now, rad/s."""
        return self._timeline.state_now[1]

    @property
    def moving(self) -> bool:
        """Whether the motor turns, or is about to."""
        return self._command_v != 0.0 or abs(self.velocity_rad_s) > _STANDSTILL_RAD_S

    @property
    def count(self) -> int:
        """Quadrature count now; never wraps."""
        return int(self._newest.count[-1]) if self._newest is not None else 0

    @property
    def sampling(self) -> bool:
        """Whether a scan clock runs."""
        return self._sampling

    def write_reference(self, value_v: float) -> None:
        """Put `value_v` out as motor reference from the next hold on."""
        self.reference_v = value_v
        self._put_out.write(self._next_hold(), value_v)
        self._drive("reference")

    def write_enable(self, *, on: bool) -> None:
        """Switch the drive's enable line from the next hold on."""
        self.enabled = on
        self._drive("enable" if on else "disable")

    def begin(self, sample_period_s: float) -> None:
        """Start a scan clock; its first sample is index 0, one period from now.

        Notes
        -----
        A bench that stands is at its home marks then, as on the emulated node: a hand has turned it
        to motor angle 0, and the encoder has counted that. One that turns goes on turning.
        """
        self.catch_up()
        self._open(sample_period_s, start=self._timeline.state_now if self.moving else (0.0, 0.0))
        self._sampling = True
        self._note("begin")

    def end(self) -> None:
        """Stop the scan clock; motor and time go on."""
        self._sampling = False
        self._note("end")

    def due(self) -> int:
        """Return how many samples of the scan clock have come and were not taken yet."""
        return max(0, int(self._holds()) - (HALF_LENGTH_SAMPLES - 1) - self._timeline.served)

    def take(self, max_samples: int) -> ElectricalSamples:
        """Return the samples whose time has come, oldest first."""
        return self._produce(min(self.due(), max_samples))

    def look(self) -> ElectricalSamples:
        """Return one reading of this moment, outside of a scan clock."""
        self._pass_time()
        # asked again within a sampling period, the same reading stands
        return self._newest if self._newest is not None else self._produce(1)

    def catch_up(self) -> None:
        """Keep a motor moving while nobody asks; for a device's own tick."""
        if not self._sampling and self.moving:
            self._pass_time()

    def present(self) -> SimulatedBench:
        """Return the bench as it is now, for who sets its lock, weights or shunt."""
        self._pass_time()
        return self.bench

    @property
    def _command_v(self) -> float:
        return self.reference_v if self.enabled else 0.0

    def _pass_time(self) -> None:
        """Let the time pass that has passed; a bench that nobody watched skips all but the end."""
        if self._sampling:
            # the samples belong to the scan clock
            return
        due = self.due()
        surplus = due - _MAX_IDLE_SAMPLES
        if surplus > 0:
            self._origin_s += surplus * self._timeline.sample_period_s
        self._produce(min(due, _MAX_IDLE_SAMPLES))

    def _holds(self) -> float:
        """Return how many holds have passed by now."""
        return (self.clock() - self._origin_s) / self._timeline.sample_period_s

    def _next_hold(self) -> int:
        """Return the first hold that a value written now can still fill."""
        # a hold that began a hundredth of itself ago is taken for one that begins now
        return max(0, int(self._holds() + 0.99))

    def _open(
        self, period_s: float, *, start: tuple[float, float] = (0.0, 0.0), counted: bool = True
    ) -> None:
        self._timeline = self.bench.begin_host_written(
            sample_period_s=period_s, start=start, counted=counted
        )
        self._origin_s = self.clock()
        self._put_out = ReferenceLine(np.array([self.reference_v]))
        self._timeline.write(0, self._command_v)

    def _drive(self, event: str) -> None:
        self._timeline.write(self._next_hold(), self._command_v)
        self._note(event)

    def _produce(self, count: int) -> ElectricalSamples:
        first = self._timeline.served
        true = self.bench.measure(count)
        volts: dict[Input, FloatArray] = {
            "torque": true.torque_v,
            "tacho": true.tacho_v,
            "current": true.current_v,
            "reference": self._put_out.values(first, count),
        }
        self._put_out.forget(self._timeline.served - 1)
        angle = to_count(true.angle_rad, self.counts_per_turn)
        samples = ElectricalSamples(first, volts, angle + self._count_offset)
        if count:
            self._newest = samples
            if self.moving:
                self._note("turning")
        return samples

    def _note(self, event: str) -> None:
        self.record(
            {
                "event": event,
                "monotonic_s": self.monotonic(),
                "device_s": self.clock(),
                "reference_v": self.reference_v,
                "enabled": self.enabled,
                "velocity_rad_s": self.velocity_rad_s,
                "samples_taken": self._timeline.served if self._sampling else 0,
            }
        )
