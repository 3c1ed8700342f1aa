"""The one interface of every DAQ: what a driver implements, and nothing more."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from numpy import bool_
from numpy.typing import NDArray

from hdbench.devices.capabilities import (
    ROLE_UNITS,
    Capabilities,
    InputInfo,
    OutputInfo,
    Role,
    WatchdogInfo,
)
from hdbench.devices.ports import Identity, SafeState
from hdbench.model.program import ReferenceProgram
from hdbench.profile.schema import ReferenceWave
from hdbench.records.trace import FloatArray

__all__ = [
    "ROLE_UNITS",
    "Capabilities",
    "Daq",
    "DaqSettings",
    "InputInfo",
    "OutputInfo",
    "Role",
    "ScanBlock",
    "WatchdogInfo",
    "WatchdogState",
]


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


@dataclass(frozen=True, slots=True)
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
        ...

    def identity(self) -> Identity:
        """Return who answers, control characters removed; raises if it is not the device meant."""
        ...

    def claim(self) -> None:
        """Become the one host that may write, where the device knows sessions."""
        ...

    def configure(self, settings: DaqSettings) -> float:
        """Write everything but motion, read it back, and return the actual sample period, s.

        The watchdog's time is written here where the device arms it by itself at the start.
        Settings kept in flash are written only where they differ.
        """
        ...

    def start(self) -> None:
        """Start sampling; a device with a generator starts the motion with the first scan."""
        ...

    def read_block(self) -> ScanBlock | None:
        """Acknowledge the previous block and return the next; None when none is ready yet.

        A block that is not `running` and has no `depth` is the last one; a call after it returns
        an empty one again. After an empty answer the next call waits a little by itself. A device
        whose watchdog is fed by a heartbeat in the block exchange is fed by this call.
        """
        ...

    def stop(self) -> None:
        """Stop sampling, and the device's own generator; scans already taken can still be read."""
        ...

    def write_output(self, name: str, value: float) -> float:
        """Write an output within its limits and return what is read back, V.

        A value outside the range is refused with an error, never clipped. A read-back that differs
        by more than one `OutputInfo.step` is an error, too.
        """
        ...

    def enable(self, *, on: bool) -> bool:
        """Switch the drive's enable line and return what is read back."""
        ...

    def arm_watchdog(self, time_s: float) -> float:
        """Set the watchdog's time, start it, and return the time read back, s."""
        ...

    def feed_watchdog(self) -> None:
        """Feed it once. Called by the control thread only, after its checks."""
        ...

    def watchdog(self) -> WatchdogState:
        """Return its state as read from the device."""
        ...

    def clear_watchdog(self) -> None:
        """Clear a latched trip, and disarm; outputs stay safe."""
        ...

    def snapshot(self) -> Mapping[Role, float]:
        """Return one reading of the channels at this moment, outside of an acquisition.

        Units as in `ROLE_UNITS`; a device with a speed of its own gives ``tacho`` in V by the
        profile's scale. Empty where the device cannot.
        """
        ...

    def safe_state(self) -> SafeState:
        """Stop, reference zero, enable off, all read back; from any state, never raises.

        `SafeState.velocity_rad_s` is None where the device does not measure the motor's speed; its
        standstill is confirmed elsewhere then.
        """
        ...

    def close(self) -> None:
        """Close the connection; never raises."""
        ...
