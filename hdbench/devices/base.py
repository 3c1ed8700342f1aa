"""Bases of drivers: a device with its identity, outputs that a host writes, an acquisition."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from typing import Generic, Protocol, TypeVar

from numpy import bool_
from numpy.typing import NDArray

from hdbench.devices.bench import Identity, SafeState
from hdbench.devices.daq import Role, ScanBlock, WatchdogState, repeats_of
from hdbench.devices.safestate import Seen, reach_safe_state
from hdbench.errors import DeviceError, HdbenchError, UsageError
from hdbench.records.trace import FloatArray

WAIT_S = 0.02
"""Longest wait of one call for scans, s."""
# beyond three packets' time, silence after which something is wrong, s
_SILENCE_S = 0.5


class StreamedAcquisition:
    """Base of a driver's acquisition: it delivers exactly the scans asked for.

    Parameters
    ----------
    n_samples : int
        Scans to deliver, lost ones counted.
    packet_s : float
        Time in which one packet of the device fills, s.

    Attributes
    ----------
    delivered : int
        Scans delivered or told as lost.
    started, stopped : bool
        Whether the device was told to start, and to stop.
    """

    def __init__(self, n_samples: int, packet_s: float) -> None:
        self.delivered = 0
        self.started = self.stopped = False
        self._n_samples = n_samples
        self._packet_s = packet_s
        self._heard_s = 0.0

    @property
    def complete(self) -> bool:
        """Whether every scan was delivered or told as lost."""
        return self.delivered >= self._n_samples

    @property
    def sampling(self) -> bool:
        """Whether the device may still be sampling."""
        return self.started and not self.stopped

    @property
    def silent(self) -> bool:
        """Whether nothing has come for longer than packets take."""
        quiet_s = time.monotonic() - self._heard_s
        return self.sampling and quiet_s > _SILENCE_S + 3.0 * self._packet_s

    def begin(self) -> None:
        """Note that the device was told to start."""
        self.started = True
        self._hear()

    def close(self) -> None:
        """Let go of what it has open; never raises."""

    def _hear(self) -> None:
        """Note that something has come."""
        self._heard_s = time.monotonic()

    def _delivered(
        self,
        values: FloatArray,
        saturated: NDArray[bool_],
        read_s: tuple[float, float],
        *,
        lost: int = 0,
        waiting: int = 0,
        depth: int = 0,
        tripped: bool = False,
        time_s: FloatArray | None = None,
    ) -> ScanBlock:
        """Count scans and return their block; `waiting` ones stay behind in this computer."""
        first = self.delivered + lost
        self.delivered = first + len(values)
        return ScanBlock(
            first_index=first,
            lost_before=lost,
            values=values,
            saturated=saturated,
            running=not (self.complete or (self.stopped and not waiting)),
            watchdog_tripped=tripped,
            depth=0 if self.complete else depth + waiting,
            read_s=read_s,
            time_s=time_s,
        )


class Watchdog(Protocol):
    """A watchdog that lives in the device; the calls are those of `Daq`."""

    def arm(self, time_s: float) -> float:
        """Set its time, start it, and return the time read back, s."""

    def feed(self) -> None:
        """Feed it once."""

    def state(self) -> WatchdogState:
        """Return its state as read from the device."""

    def clear(self) -> None:
        """Clear a trip; the outputs are safe already."""


@dataclass(eq=False)
class HostOutputs(ABC):
    """Base of the outputs that a host writes: motor reference, enable line and watchdog.

    Parameters
    ----------
    where : str
        The device, for messages.
    name : str
        What the reference is there, for messages.
    ends_v : tuple of float
        Range that may be written, V.
    zero_v : float
        What still counts as reference zero, V.
    brake_s : float, optional
        Time from reference zero to drive off in any case, s.

    Attributes
    ----------
    watchdog : Watchdog or None
        The watchdog that lives in the device.
    """

    where: str
    name: str
    ends_v: tuple[float, float]
    _: KW_ONLY
    zero_v: float
    brake_s: float = 0.0
    watchdog: Watchdog | None = field(default=None, init=False)

    def write(self, value: float) -> float:
        """Write the reference once and return what is read back, V; NaN is outside of the range."""
        low, high = self.ends_v
        if not low <= value <= high:
            raise UsageError(
                f"reference {value!r} V; needed: {low:g} to {high:g} V",
                where=f"{self.where}, {self.name}",
                fix="ask for less, or raise daq.output.limit_v if the drive allows it",
            )
        return self._put(value)

    def zero(self) -> None:
        """Bring the reference to zero."""
        self.write(0.0)

    def switch_off(self) -> bool:
        """Switch the enable line off and return whether it reads as off."""
        return not self.enable(on=False)

    def make_safe(self) -> None:
        """Bring the reference to zero and switch the enable line off."""
        self.zero()
        if not self.switch_off():
            raise DeviceError(
                "the enable line reads back as on after it was switched off",
                where=self.where,
                fix="use the emergency stop, then check the line's wiring and [daq.output]",
            )

    @abstractmethod
    def read_back(self) -> float | None:
        """Return the reference that stands at the output, V; None where it cannot be read."""

    @abstractmethod
    def enable(self, *, on: bool) -> bool:
        """Write the enable line once and return what it reads back; False without a line."""

    @abstractmethod
    def _put(self, value: float) -> float:
        """Write a value within the range and return what is read back, V."""


_Acquired = TypeVar("_Acquired", bound=StreamedAcquisition)


class DeviceBase(Generic[_Acquired]):
    """Base of drivers: asks once who answers, and refuses what the device does not have.

    A driver has its own `capabilities`, `configure`, `start`, `read_block`, `stop` and `close`.

    Parameters
    ----------
    where : str
        The device, for messages.
    outputs : HostOutputs, optional
        What drives the motor; without them all that drives is refused.
    wire : object, optional
        Counts the requests that were sent again, see `repeats_of`.
    """

    _identity: Identity | None = None
    _acquisition: _Acquired | None = None

    def __init__(self, where: str, outputs: HostOutputs | None = None, wire: object = None) -> None:
        self.where = where
        self.outputs = outputs
        self._wire = wire

    @property
    def repeats(self) -> int:
        """Requests that were sent again so far."""
        return repeats_of(self._wire)

    def identity(self) -> Identity:
        """Return who answers; asked once, before anything is written."""
        if self._identity is None:
            self._identity = self._who()
        return self._identity

    def claim(self) -> None:
        """Check who answers: hosts that the device does not know of are not seen."""
        self.identity()

    def stop(self) -> None:
        """Stop sampling; scans already taken can still be read."""
        raise NotImplementedError

    def write_output(self, name: str, value: float) -> float:
        """Write the motor reference once and return what is read back, V."""
        if name != "reference":
            raise UsageError(
                f"no output {name!r}; there is one, reference",
                where=self.where,
                fix="name the output reference",
            )
        return self._driving().write(value)

    def enable(self, *, on: bool) -> bool:
        """Switch the drive's enable line and return what is read back."""
        return self._driving().enable(on=on)

    def arm_watchdog(self, time_s: float) -> float:
        """Set the watchdog's time, start it, and return the time read back, s."""
        return self._guard().arm(time_s)

    def feed_watchdog(self) -> None:
        """Feed it once."""
        self._guard().feed()

    def watchdog(self) -> WatchdogState:
        """Return its state as read from the device; not armed where there is none."""
        dog = None if self.outputs is None else self.outputs.watchdog
        return WatchdogState(False, False, 0.0) if dog is None else dog.state()

    def clear_watchdog(self) -> None:
        """Make the outputs safe, then clear a trip."""
        self._make_safe()
        if self.outputs is not None and self.outputs.watchdog is not None:
            self.outputs.watchdog.clear()

    def snapshot(self) -> Mapping[Role, float]:
        """Return nothing: no reading is needed to see a motor stand."""
        return {}

    def safe_state(self) -> SafeState:
        """Zero the reference, disable the drive at standstill, stop sampling; all read back.

        Never raises. Another device at this address is never written to: the safe state is not
        confirmed then.
        """
        outputs = self.outputs
        try:
            if outputs is None:
                self.identity()
                self.stop()
                return SafeState(True, None, None, "the device drives nothing")

            def stop() -> None:
                self.identity()
                outputs.zero()
                self.stop()

            def disable() -> bool:
                self.identity()
                return outputs.switch_off()

            return reach_safe_state(
                stop=stop,
                look=self._seen,
                disable=disable,
                zero_v=outputs.zero_v,
                brake_s=outputs.brake_s,
            )
        except HdbenchError as error:
            return SafeState(False, None, None, error.what)
        finally:
            self._drop_acquisition()

    def error(self, what: str, fix: str) -> DeviceError:
        """Return an error of this device."""
        return DeviceError(what, where=self.where, fix=fix)

    def _who(self) -> Identity:
        """Ask who answers; raises if it is not the device meant."""
        raise NotImplementedError

    def _seen(self) -> Seen:
        """Return what the device shows of its outputs and its motor."""
        return Seen(self._driving().read_back())

    def _make_safe(self) -> None:
        if self.outputs is not None:
            self.outputs.make_safe()

    def _configured(self) -> _Acquired:
        if self._acquisition is None or self._acquisition.started:
            raise self.error("no acquisition is configured", "configure it first")
        return self._acquisition

    def _running(self) -> _Acquired:
        if self._acquisition is None or not self._acquisition.started:
            raise self.error("no acquisition has been started", "start it first")
        return self._acquisition

    def _drop_acquisition(self) -> None:
        if self._acquisition is not None:
            self._acquisition.close()
        self._acquisition = None

    def _driving(self) -> HostOutputs:
        if self.outputs is None:
            raise self.error(
                "this device has no analog output in the profile",
                "add [daq.output] where it has one, or drive the motor with another device: "
                'driver = "composite"',
            )
        return self.outputs

    def _guard(self) -> Watchdog:
        dog = self._driving().watchdog
        if dog is None:
            raise self.error(
                "the profile names no watchdog", "add [daq.output.watchdog], or drive nothing"
            )
        return dog
