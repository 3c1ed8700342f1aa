"""An emulated T7 in a thread of this process, and a driver that talks to it."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Any

from daqkit import Clock
from faults.lines import in_thread
from served import InThread, begin

from hdbench.devices.daq import DaqSettings
from hdbench.devices.driver import open_daq
from hdbench.devices.emulator.instrument import ElectricalSamples, SimulatedInstrument
from hdbench.devices.emulator.serving import Emulation, EmulatorSettings
from hdbench.devices.wire.address import parse_address
from hdbench.drivers.labjack.driver import LabJackDaq
from hdbench.drivers.labjack.emulator.device import EmulatedLabJack, LabJackDevice
from hdbench.drivers.labjack.emulator.streaming import Wiring
from hdbench.profile import load_profile

PROFILE = load_profile("labjack-t7").data
ROLES = ("torque", "tacho", "current", "reference", "encoder")


@dataclass
class Served(InThread):
    """An emulated device in a thread."""

    server: EmulatedLabJack
    instrument: SimulatedInstrument
    host: str
    port: int
    watchdog_clock: Clock

    @property
    def device(self) -> LabJackDevice:
        return self.server.device

    def noted_writes(self) -> list[int]:
        """Return the list in which the device notes the address of every write from now on."""
        addresses: list[int] = []
        write = self.device.memory.write
        self.device.memory.write = lambda space, at, raw: (
            addresses.append(at),
            write(space, at, raw),
        )[1]
        return addresses

    def noted_samples(self) -> list[ElectricalSamples]:
        """Return the list in which the device notes what it samples while it streams."""
        taken: list[ElectricalSamples] = []
        take = self.instrument.take

        def noting(count: int) -> ElectricalSamples:
            samples = take(count)
            if self.instrument.sampling:
                taken.append(samples)
            return samples

        self.instrument.take = noting
        return taken


@contextmanager
def served(*, speed: float = 1.0, seed: int = 3, table: Any = None) -> Iterator[Served]:
    """Serve a device on a free pair of ports."""
    emulation = Emulation(PROFILE, "as-modelled", seed)
    emulation.speed = speed
    made = table or PROFILE.daq
    terminals = {c.number: (c.role, 1.0) for c in made.channels if c.role != "encoder"}
    wiring = Wiring(emulation.instrument, made, terminals, seed)
    # it goes when told, so that no busy machine trips the watchdog
    clock = Clock(0.0)
    server = EmulatedLabJack(LabJackDevice(wiring, seed, clock=clock))
    with in_thread(lambda: server.open(EmulatorSettings()), server.close) as (loop, found):
        address = parse_address(str(found["address"]))
        yield Served(loop, server, emulation.instrument, address.host, address.port, clock)


def driver(port: int, **changes: Any) -> closing[LabJackDaq]:
    """Open a driver at a served device, patient as it may be."""
    update = {"address": f"tcp://127.0.0.1:{port}", "deadline_s": 0.9, **changes}
    return closing(open_daq(PROFILE, PROFILE.daq.model_copy(update=update)))


@contextmanager
def claimed(*, speed: float = 1.0, **changes: Any) -> Iterator[tuple[Served, LabJackDaq]]:
    """Serve a device and claim it; yields both."""
    with served(speed=speed) as device, driver(device.port, **changes) as daq:
        daq.claim()
        yield device, daq


@contextmanager
def streaming(n_samples: int, **keys: Any) -> Iterator[tuple[Served, LabJackDaq]]:
    """Serve a device, claim it and start an acquisition; yields device and driver."""
    with claimed(**keys) as (device, daq):
        begin(daq, settings(n_samples))
        yield device, daq


def settings(n_samples: int, period_s: float = 1e-3, roles: tuple[str, ...] = ROLES) -> DaqSettings:
    """Return an acquisition of `n_samples`."""
    return DaqSettings(roles, period_s, n_samples, 1.0)


def turning(daq: LabJackDaq, n_samples: int, reference_v: float) -> None:
    """Start an acquisition with the watchdog armed and the motor on."""
    begin(daq, settings(n_samples))
    daq.arm_watchdog(1.0)
    daq.enable(on=True)
    daq.write_output("reference", reference_v)
