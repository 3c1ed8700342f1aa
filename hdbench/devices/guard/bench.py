"""A bench whose motor never turns without its guard."""

from __future__ import annotations

from collections.abc import Callable

from hdbench.devices.bench import AcquisitionSettings, Block, Identity, SafeState
from hdbench.devices.daq import Capabilities
from hdbench.devices.guard.launch import GuardProcess
from hdbench.devices.host import HostedBench
from hdbench.devices.simulation import Simulation
from hdbench.errors import DeviceError

__all__ = ["GuardedBench"]


class GuardedBench:
    """Implements `hdbench.devices.bench.Bench`; the guard lives from motion to safe state.

    Parameters
    ----------
    bench : HostedBench
        The bench; owned from now on.
    start_guard : callable
        Starts a guard, once, when the first motion is configured.
    simulation : Simulation, optional
        Control channel of a simulated bench; whatever the device says, without it it is a real one.
    """

    def __init__(
        self,
        bench: HostedBench,
        start_guard: Callable[[], GuardProcess],
        simulation: Simulation | None = None,
    ) -> None:
        self.bench = bench
        self.simulation = simulation
        self.guard: GuardProcess | None = None
        self.start_guard = start_guard
        self._moves = False

    def identity(self) -> Identity:
        """Return who answers."""
        return self.bench.identity()

    def capabilities(self) -> Capabilities:
        """Return what the device can do."""
        return self.bench.capabilities()

    def configure(self, settings: AcquisitionSettings) -> None:
        """Configure the bench; before the first motion the guard is started."""
        self.bench.configure(settings)
        self._moves = settings.reference is not None
        if self._moves and self.guard is None:
            self.guard = self.start_guard()

    def start(self) -> None:
        """Start sampling and, with a reference, the motion under the guard's eyes."""
        guard = self.guard if self._moves else None
        if guard is not None:
            guard.watch("patiently")
        self.bench.start()
        if guard is not None:
            guard.watch("closely")

    def read_block(self) -> Block | None:
        """Return the next block; every call that comes back is a sign of life."""
        block = self.bench.read_block()
        if self.guard is not None:
            self.guard.beat()
        return block

    def stop(self) -> None:
        """Stop normally."""
        if self.guard is not None and self._moves:
            self.guard.watch("patiently")
        self.bench.stop()
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
        safe = self.bench.safe_state()
        if safe.confirmed and self.guard is not None:
            self.guard.end()
            self.guard = None
        return safe

    def close(self) -> None:
        """Close the connection; a guard that is still there stops the motor. Never raises."""
        self.bench.close()
        if self.guard is not None:
            self.guard.abandon()
            self.guard = None
