"""An emulated Modbus device in a thread of this process, and a driver that talks to it."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from typing import Any

from changing import REPORT
from faults.lines import in_thread
from served import InThread

from hdbench.devices.daq import DaqSettings
from hdbench.devices.emulator.instrument import SimulatedInstrument
from hdbench.devices.emulator.modbus import ModbusDevice
from hdbench.devices.emulator.server import ModbusServer, Wire
from hdbench.devices.emulator.serving import Emulation
from hdbench.devices.modbus.driver import ModbusDaq, open_modbus
from hdbench.profile import load_profile
from hdbench.profile.acquiring_modbus import ModbusAcquisition

# an EK9000 that answers at once
COUPLER = load_profile("di-2108-ek9000").data.daq.outputs.model_copy(update={"reply_s": 0.0})
TORQUE = {"role": "torque", "address": 10, "type": "f32"}
KNOWN = {"address": 1, "type": "u16", "equals": 4660}
OUTPUT = {"address": 50, "type": "i16", "scale": 0.001, "limit_v": 5.0}


def table(**keys: Any) -> ModbusAcquisition:
    """Return a table without a wait for replies."""
    base = {"driver": "modbus", "sample_period_s": 0.02, "reply_s": 0.0, "channels": (TORQUE,)}
    return ModbusAcquisition.model_validate({**base, **keys})


def driving(**keys: Any) -> ModbusAcquisition:
    """Return the table of a device that is known and has an output."""
    return table(identify=(KNOWN,), output=OUTPUT, **keys)


@dataclass
class Served(InThread):
    """An emulated device in a thread."""

    device: ModbusDevice
    instrument: SimulatedInstrument
    address: str
    server: ModbusServer
    requests: list[bytes] = field(default_factory=list)

    @property
    def written(self) -> list[bytes]:
        """Requests that write."""
        return [pdu for pdu in self.requests if pdu[0] in (5, 6, 15, 16)]

    def torque_v(self) -> float:
        """Return what stands at the terminal of the torque."""
        return self.call(lambda: float(self.instrument.look().volts["torque"][-1]))


@contextmanager
def served(what: ModbusAcquisition, *, wire: Wire = "tcp") -> Iterator[Served]:
    """Serve a device; every request it hears is kept."""
    instrument = Emulation(REPORT, "as-modelled", 3).instrument
    device = ModbusDevice(instrument, what, amperes_per_v=1.0)
    server = ModbusServer(device, wire)
    with in_thread(server.open, server.close) as (loop, address):
        found = Served(loop, device, instrument, address, server)
        answer = device.answer

        def kept(pdu: bytes, *numbers: int) -> bytes | None:
            found.requests.append(pdu)
            return answer(pdu, *numbers)

        device.answer = kept
        yield found


def driver(what: ModbusAcquisition, address: str, **changes: Any) -> closing[ModbusDaq]:
    """Open a driver at an address, patient as it may be."""
    update = {"address": address, "deadline_s": 0.9, **changes}
    return closing(open_modbus(REPORT, what.model_copy(update=update)))


@contextmanager
def opened(
    what: ModbusAcquisition, wire: Wire = "tcp", **changes: Any
) -> Iterator[tuple[Served, ModbusDaq]]:
    """Serve a device and open it, with changes of the host's own table; yields both."""
    with served(what, wire=wire) as found, driver(what, found.address, **changes) as daq:
        yield found, daq


def settings(n_samples: int, period_s: float = 0.02, roles: tuple[str, ...] = ("torque",)) -> Any:
    """Return an acquisition."""
    return DaqSettings(roles, period_s, n_samples, 1.0)
