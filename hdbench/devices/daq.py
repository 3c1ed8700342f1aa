"""DAQ: the one interface of every acquisition device, and what it can do."""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

from numpy import bool_
from numpy.typing import NDArray

from hdbench.devices.bench import Identity, SafeState
from hdbench.profile.schema import ReferenceWave
from hdbench.profile.waves import ReferenceProgram
from hdbench.records.trace import FloatArray

Role = Literal["torque", "tacho", "current", "reference", "encoder"]
"""What a channel of a bench measures."""
ROLE_UNITS: dict[Role, str] = {
    "torque": "V",
    "tacho": "V",
    "current": "A",
    "reference": "V",
    "encoder": "count",
}


def clean_text(raw: bytes) -> str:
    """Return device text without control, format and undecodable characters."""
    text = raw.split(b"\0", 1)[0].decode("utf-8", errors="replace")
    printable = (c for c in text if unicodedata.category(c)[0] != "C")
    return "".join(printable).replace("\N{REPLACEMENT CHARACTER}", "").strip()


@dataclass(frozen=True, slots=True)
class InputInfo:
    """One channel that can be sampled.

    Parameters
    ----------
    role : {"torque", "tacho", "current", "reference", "encoder"}
        What it measures; its unit stands in `ROLE_UNITS`.
    low, high : float
        Ends of its range in the unit of its role; a value at either end is saturated. For an
        encoder the ends of its count.
    bits : int
        Resolution, bit; 0 where it is not known.
    wrap : int
        Period of a counter, counts: 2**16 or 2**32; 0 for channels that do not wrap.
    """

    role: Role
    low: float
    high: float
    bits: int = 0
    wrap: int = 0


@dataclass(frozen=True, slots=True)
class WatchdogInfo:
    """The watchdog that lives in the device.

    Parameters
    ----------
    min_s, max_s : float
        Shortest and longest time, s.
    fed_by : {"message", "write", "key", "heartbeat"}
        What feeds it: any message, any write, a key written to a register of its own, or a changed
        number. With ``message`` a stuck program that still polls keeps the motor alive.
    drops : tuple of str
        Outputs that it makes safe: ``reference``, ``enable``. Empty: it stops nothing.
    """

    min_s: float
    max_s: float
    fed_by: Literal["message", "write", "key", "heartbeat"]
    drops: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Capabilities:
    """What one DAQ can do as it is configured in the profile.

    Parameters
    ----------
    inputs : tuple of InputInfo
        Channels that can be sampled; at most one per role.
    max_rates_hz : tuple of float
        Highest sustained scan rate with 1, 2, ... channels, Hz, the wire included. Empty for a
        device without inputs.
    min_rate_hz : float
        Lowest scan rate, Hz.
    reference : bool
        Whether the host writes the motor reference.
    generator : bool
        Whether the device makes the motor reference itself (`DaqSettings.reference`), sample by
        sample; otherwise the host writes it.
    enable : bool
        Whether the drive's enable line is under the device's control.
    watchdog : WatchdogInfo or None
        The device's watchdog, if it has one.
    """

    inputs: tuple[InputInfo, ...]
    max_rates_hz: tuple[float, ...]
    min_rate_hz: float
    reference: bool = False
    generator: bool = False
    enable: bool = False
    watchdog: WatchdogInfo | None = None

    @property
    def roles(self) -> tuple[Role, ...]:
        """Roles of the inputs, in their order."""
        return tuple(info.role for info in self.inputs)

    @property
    def drives(self) -> bool:
        """Whether the device can put out a motor reference."""
        return self.generator or self.reference

    @property
    def guarded(self) -> bool:
        """Whether a watchdog in the device stops the motor when the host falls silent."""
        return self.watchdog is not None and bool(self.watchdog.drops)

    def input(self, role: Role) -> InputInfo | None:
        """Return the channel of `role`, None where there is none."""
        return next((info for info in self.inputs if info.role == role), None)

    def max_rate_hz(self, n_channels: int) -> float:
        """Return the highest sustained scan rate with `n_channels`, Hz; 0 where it has fewer."""
        if not 1 <= n_channels <= len(self.max_rates_hz):
            return 0.0
        return self.max_rates_hz[n_channels - 1]


@dataclass(frozen=True, slots=True)
class DaqSettings:
    """One acquisition.

    Parameters
    ----------
    roles : tuple of Role
        Channels of a scan, in the order in which `ScanBlock.values` holds them.
    sample_period_s : float
        Sampling period, s.
    n_samples : int
        Scans to take, >= 1; the device, or the driver, stops by itself after them.
    watchdog_s : float
        Host silence after which the device makes its outputs safe, s.
    reference : ReferenceWave, ReferenceProgram or None
        For devices with a generator: the motor reference, V. None keeps the drive disabled. Other
        devices are always given None.
    """

    roles: tuple[Role, ...]
    sample_period_s: float
    n_samples: int
    watchdog_s: float
    reference: ReferenceWave | ReferenceProgram | None = None


# a frozen one takes three times as long to make
@dataclass(slots=True)
class ScanBlock:
    """Adjacent scans of one read.

    Parameters
    ----------
    first_index : int
        Index of the first scan since the start.
    lost_before : int
        Scans lost between the previous block and this one, exactly.
    values : ndarray, shape (n, channels)
        In the units of `ROLE_UNITS`; counters as the device counts them, not unwrapped.
    saturated : ndarray of bool, shape (n, channels)
        True where a channel sits at the end of its range.
    running : bool
        Whether the device is still sampling.
    watchdog_tripped : bool
        Whether the device has made its outputs safe for want of a host.
    depth : int
        Scans still waiting in the device; at least 1 while losses at the end are untold.
    read_s : tuple of float
        Host's monotonic clock before the request and after the reply, s: the newest scan was taken
        before the second one.
    time_s : ndarray, shape (n,), or None
        Host's monotonic time of every scan of a polled device, s, the middle between request and
        reply; None where the device has a sample clock.
    """

    first_index: int
    lost_before: int
    values: FloatArray
    saturated: NDArray[bool_]
    running: bool
    watchdog_tripped: bool
    depth: int
    read_s: tuple[float, float]
    time_s: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.values)


@dataclass(frozen=True, slots=True)
class WatchdogState:
    """What the device's watchdog says.

    Parameters
    ----------
    armed, tripped : bool
        Whether it runs, and whether it has made the outputs safe.
    time_s : float
        Its time as read back, s.
    """

    armed: bool
    tripped: bool
    time_s: float


class Daq(Protocol):
    """A DAQ on its wire.

    Every call keeps its own deadline on the monotonic clock and raises `DeviceError` when the
    device does not answer in time, answers wrongly, or refuses. Nothing that moves is sent twice.
    Nothing is written before `identity` has been checked, and only to registers (or with commands)
    that the driver or the profile lists.

    `write_output`, `enable`, the watchdog's calls and `safe_state` may come from another thread
    than `read_block`: a driver has a connection of its own for them, or a lock that is never held
    longer than one transaction.
    """

    def capabilities(self) -> Capabilities:
        """Return what the device can do; asks the device once at most."""

    def identity(self) -> Identity:
        """Return who answers, control characters removed; raises if it is not the device meant."""

    def claim(self) -> None:
        """Become the one host that may write, where the device knows sessions."""

    def configure(self, settings: DaqSettings) -> float:
        """Write everything but motion, read it back, and return the actual sample period, s.

        The watchdog's time is written here where the device arms it by itself at the start.
        Settings kept in flash are written only where they differ.
        """

    def start(self) -> None:
        """Start sampling; a device with a generator starts the motion with the first scan."""

    def read_block(self) -> ScanBlock | None:
        """Acknowledge the previous block and return the next; None when none is ready yet.

        A block that is not `running` and has no `depth` is the last one; a call after it returns
        an empty one again. After an empty answer the next call waits a little by itself. A device
        whose watchdog is fed by a heartbeat in the block exchange is fed by this call.
        """

    def stop(self) -> None:
        """Stop sampling, and the device's own generator; scans already taken can still be read."""

    def write_output(self, name: str, value: float) -> float:
        """Write an output within its limits and return what is read back, V.

        A value outside the range is refused with an error, never clipped. A read-back that differs
        by more than one step of the converter is an error, too.
        """

    def enable(self, *, on: bool) -> bool:
        """Switch the drive's enable line and return what is read back."""

    def arm_watchdog(self, time_s: float) -> float:
        """Set the watchdog's time, start it, and return the time read back, s."""

    def feed_watchdog(self) -> None:
        """Feed it once. Called by the control thread only, after its checks."""

    def watchdog(self) -> WatchdogState:
        """Return its state as read from the device."""

    def clear_watchdog(self) -> None:
        """Clear a latched trip, and disarm; outputs stay safe."""

    def snapshot(self) -> Mapping[Role, float]:
        """Return one reading of the channels at this moment, outside of an acquisition.

        Units as in `ROLE_UNITS`; a device with a speed of its own gives ``tacho`` in V by the
        profile's scale. Empty where the device cannot.
        """

    def safe_state(self) -> SafeState:
        """Stop, reference zero, enable off, all read back; from any state, never raises.

        `SafeState.velocity_rad_s` is None where the device does not measure the motor's speed; its
        standstill is confirmed elsewhere then.
        """

    def close(self) -> None:
        """Close the connection; never raises."""


def repeats_of(daq: object) -> int:
    """Return how many requests a driver has sent again so far; 0 where it does not count."""
    return int(getattr(daq, "repeats", 0))
