"""An emulated DATAQ instrument in a thread of this process, and a driver that talks to it."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Any

from changing import REPORT
from faults.lines import in_thread
from served import InThread

from hdbench.devices.daq import DaqSettings
from hdbench.devices.emulator.instrument import SimulatedInstrument
from hdbench.devices.emulator.serving import Emulation, EmulatorSettings
from hdbench.drivers.dataq.driver import DataqDaq, open_dataq
from hdbench.drivers.dataq.emulator import DataqDevice, EmulatedDataq, emulate_dataq
from hdbench.drivers.dataq.table import DataqAcquisition

ROLES = ("torque", "tacho", "current", "reference")


def table(model: str = "DI-2108", roles: tuple[str, ...] = ROLES, **keys: Any) -> DataqAcquisition:
    """Return a table with one input per role."""
    range_v = keys.pop("range_v", 5.0 if model == "DI-4718B" else 10.0)
    inputs = ("counter" if role == "encoder" else f"analog {n}" for n, role in enumerate(roles))
    channels = tuple(
        {"role": role, "input": place, "range_v": range_v}
        for role, place in zip(roles, inputs, strict=True)
    )
    return DataqAcquisition.model_validate(
        {"driver": "dataq", "model": model, "sample_period_s": 0.001, "channels": channels, **keys}
    )


@dataclass
class Served(InThread):
    """An emulated instrument in a thread."""

    device: DataqDevice
    line: EmulatedDataq
    instrument: SimulatedInstrument
    address: str


@contextmanager
def served(what: DataqAcquisition, *, speed: float = 1.0) -> Iterator[Served]:
    """Serve an instrument on a pseudo-terminal."""
    emulation = Emulation(REPORT, "as-modelled", 3)
    emulation.speed = speed
    instrument, line = emulation.instrument, emulate_dataq(emulation, what)
    with in_thread(lambda: line.open(EmulatorSettings()), line.close) as (loop, found):
        yield Served(loop, line.device, line, instrument, str(found["address"]))


def driver(what: DataqAcquisition, address: str, **changes: Any) -> closing[DataqDaq]:
    """Open a driver at an address, patient as it may be."""
    update = {"address": address, "deadline_s": 0.9, **changes}
    return closing(open_dataq(REPORT, what.model_copy(update=update)))


@contextmanager
def opened(
    what: DataqAcquisition | None = None, speed: float = 1.0
) -> Iterator[tuple[Served, DataqDaq]]:
    """Serve an instrument, a DI-2108 unless told, and open it; yields both."""
    what = what or table()
    with served(what, speed=speed) as found, driver(what, found.address) as daq:
        yield found, daq


def settings(n_samples: int, period_s: float = 1e-3, roles: tuple[str, ...] = ROLES) -> DaqSettings:
    """Return an acquisition."""
    return DaqSettings(roles, period_s, n_samples, 1.0)  # type: ignore[arg-type]
