"""Guarded bench: a bench whose motor never turns without its guard."""

from __future__ import annotations

from collections.abc import Callable

from hdbench.devices.bench import AcquisitionSettings, Block, SafeState
from hdbench.devices.daq import Daq
from hdbench.devices.guard.launch import GuardProcess
from hdbench.devices.host import HostedBench, HostSettings
from hdbench.devices.simulation import Simulation
from hdbench.errors import DeviceError


class GuardedBench(HostedBench):
    """A `HostedBench` with a guard that lives from the first motion to the safe state.

    Parameters
    ----------
    daq : Daq
        The device, or a composite; owned by the bench from now on.
    settings : HostSettings
        What the profile says.
    start_guard : callable
        Starts a guard, once, when the first motion is configured.
    simulation : Simulation, optional
        Control channel of a simulated bench; whatever the device says, without it it is a real one.
    speed : float, optional
        Device seconds per second; other than 1 for an accelerated emulator only.
    """

    def __init__(
        self,
        daq: Daq,
        settings: HostSettings,
        start_guard: Callable[[], GuardProcess],
        simulation: Simulation | None = None,
        *,
        speed: float = 1.0,
    ) -> None:
        super().__init__(daq, settings, speed=speed)
        self.simulation = simulation
        self.guard: GuardProcess | None = None
        self.start_guard = start_guard
        self._moves = False

    def configure(self, settings: AcquisitionSettings) -> None:
        """Configure the bench; before the first motion the guard is started."""
        super().configure(settings)
        self._moves = settings.reference is not None
        if self._moves and self.guard is None:
            self.guard = self.start_guard()

    def start(self) -> None:
        """Start sampling and, with a reference, the motion under the guard's eyes."""
        guard = self.guard if self._moves else None
        if guard is not None:
            guard.watch("patiently")
        super().start()
        if guard is not None:
            guard.watch("closely")

    def read_block(self) -> Block | None:
        """Return the next block; every call that comes back is a sign of life."""
        block = super().read_block()
        if self.guard is not None:
            self.guard.beat()
        return block

    def stop(self) -> None:
        """Stop normally."""
        if self.guard is not None and self._moves:
            self.guard.watch("patiently")
        super().stop()
        if self.guard is not None and self._moves:
            self.guard.watch("end-only")

    def safe_state(self) -> SafeState:
        """Make the bench safe; the guard goes once that is confirmed. Never raises."""
        if self.guard is not None:
            try:
                self.guard.watch("patiently")
            except DeviceError:
                # what it has to say was said, or will be, elsewhere; the motor comes first
                self._moves = False
        safe = super().safe_state()
        if safe.confirmed and self.guard is not None:
            self.guard.end()
            self.guard = None
        return safe

    def close(self) -> None:
        """Close the connection; a guard that is still there stops the motor. Never raises."""
        super().close()
        if self.guard is not None:
            self.guard.abandon()
            self.guard = None
