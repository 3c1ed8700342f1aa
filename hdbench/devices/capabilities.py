"""What a DAQ can do, told before anything is asked of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = [
    "ROLE_UNITS",
    "Capabilities",
    "InputInfo",
    "OutputInfo",
    "Role",
    "WatchdogInfo",
]

Role = Literal["torque", "tacho", "current", "reference", "encoder"]
"""What a channel of a bench measures."""

ROLE_UNITS: dict[Role, str] = {
    "torque": "V",
    "tacho": "V",
    "current": "A",
    "reference": "V",
    "encoder": "count",
}


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
class OutputInfo:
    """One output that the host writes.

    Parameters
    ----------
    name : str
        ``reference`` is the motor reference.
    low, high : float
        Range that may be written, V.
    step : float
        Smallest change that the converter shows, V; 0 where it is not known.
    write_s : float
        Time that one confirmed write takes, typically, s.
    """

    name: str
    low: float
    high: float
    step: float
    write_s: float


@dataclass(frozen=True, slots=True)
class WatchdogInfo:
    """The watchdog that lives in the device.

    Parameters
    ----------
    min_s, max_s, step_s : float
        Shortest and longest time, and its grain, s.
    fed_by : {"message", "write", "key", "heartbeat"}
        What feeds it: any message, any write, a key written to a register of its own, or a changed
        number. With ``message`` a stuck program that still polls keeps the motor alive.
    drops : tuple of str
        Outputs that it makes safe: ``reference``, ``enable``. Empty: it stops nothing.
    latches : bool
        Whether outputs stay safe until the trip is cleared.
    """

    min_s: float
    max_s: float
    step_s: float
    fed_by: Literal["message", "write", "key", "heartbeat"]
    drops: tuple[str, ...]
    latches: bool


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
    outputs : tuple of OutputInfo
        Outputs that the host writes.
    generator : bool
        Whether the device makes the motor reference itself (`DaqSettings.reference`), sample by
        sample; otherwise the host writes it.
    enable : bool
        Whether the drive's enable line is under the device's control.
    buffered : bool
        Whether the device samples on its own clock into a buffer; otherwise every sample is asked
        for, and its time is the host's.
    buffer_scans : int
        Scans that the buffer holds with all of `inputs`; 0 for a polled device.
    watchdog : WatchdogInfo or None
        The device's watchdog, if it has one.
    simulated : bool
        True for an emulator: no real motor turns.
    """

    inputs: tuple[InputInfo, ...]
    max_rates_hz: tuple[float, ...]
    min_rate_hz: float
    outputs: tuple[OutputInfo, ...]
    generator: bool
    enable: bool
    buffered: bool
    buffer_scans: int
    watchdog: WatchdogInfo | None
    simulated: bool

    @property
    def roles(self) -> tuple[Role, ...]:
        """Roles of the inputs, in their order."""
        return tuple(info.role for info in self.inputs)

    @property
    def drives(self) -> bool:
        """Whether the device can put out a motor reference."""
        return self.generator or any(info.name == "reference" for info in self.outputs)

    @property
    def guarded(self) -> bool:
        """Whether a watchdog in the device stops the motor when the host falls silent."""
        return self.watchdog is not None and bool(self.watchdog.drops)

    def input(self, role: Role) -> InputInfo | None:
        """Return the channel of `role`, None where there is none."""
        return next((info for info in self.inputs if info.role == role), None)

    def output(self, name: str) -> OutputInfo | None:
        """Return the output called `name`, None where there is none."""
        return next((info for info in self.outputs if info.name == name), None)

    def max_rate_hz(self, n_channels: int) -> float:
        """Return the highest sustained scan rate with `n_channels`, Hz; 0 where it has fewer."""
        if not 1 <= n_channels <= len(self.max_rates_hz):
            return 0.0
        return self.max_rates_hz[n_channels - 1]
