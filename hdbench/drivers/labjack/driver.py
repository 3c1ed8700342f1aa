"""A LabJack T4 or T7 as `hdbench.devices.daq.Daq`."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping

from hdbench.devices import daq
from hdbench.devices.base import DeviceBase
from hdbench.devices.bench import Identity
from hdbench.devices.driver import Driver, later
from hdbench.devices.safestate import Seen
from hdbench.devices.transactor import TWICE, same_reply
from hdbench.devices.wire.address import address_of
from hdbench.devices.wire.link import connect
from hdbench.drivers.labjack import scanlist
from hdbench.drivers.labjack.control import Control, Session, decoded, feedback_request
from hdbench.drivers.labjack.outputs import Outputs, stop_target
from hdbench.drivers.labjack.registers import IDENTITY, STREAM_ENABLE, TEST, user_name
from hdbench.drivers.labjack.stream import Acquisition
from hdbench.drivers.labjack.table import LabJackAcquisition
from hdbench.errors import BusyError, HdbenchError, UsageError
from hdbench.profile.schema import ProfileData

# what TEST reads where the words come in the right order (ljm_constants.json)
TEST_VALUE = 0x00112233
_SWAPPED = 0x22330011
# the device name that hdbench's own emulator answers with
EMULATOR_NAME = "hdbench-emulator"
_MODELS = {4: "T4", 7: "T7", 8: "T8"}


def check_identity(control: Control, table: LabJackAcquisition) -> Identity:
    """Return who answers, if it is the device that the profile means."""
    (test,) = control.read(TEST)
    if test != TEST_VALUE:
        swapped = "; its words are swapped" if test == _SWAPPED else ""
        raise control.error_at(
            TEST,
            f"reads 0x{int(test):08X}; needed: 0x{TEST_VALUE:08X}{swapped}",
            "this is no LabJack T-series device, or a gateway on the way swaps its words",
        )
    request = feedback_request((), IDENTITY)
    reply = control.ask(request, IDENTITY[0], TWICE)
    product, _, firmware, serial = decoded(IDENTITY, reply[1:])
    _check_model(control, round(product), int(serial), table)
    control.recognise(same_reply(request, reply[1:]))
    return Identity(
        vendor="LabJack",
        model=table.model,
        serial=str(int(serial)),
        firmware=f"{firmware:.4f}",
        simulated=_name(control) == EMULATOR_NAME,
    )


def _check_model(control: Control, product: int, serial: int, table: LabJackAcquisition) -> None:
    model = _MODELS.get(product, f"product {product}")
    if product not in (4, 7):
        raise control.error_at(
            IDENTITY[0],
            f"a {model} answers; this driver knows T4 and T7. A T8 keeps the constants that turn "
            "its streamed words into volts in a layout that has not been published for direct use",
            "use a T4 or T7, or read a T8 through a driver of its maker's library",
        )
    if model != table.model:
        what = f"a {model} answers; the profile names a {table.model}"
        raise control.error_at(IDENTITY[0], what, "correct daq.model or daq.address in the profile")
    if table.serial_number is not None and serial != table.serial_number:
        what = f"serial number {serial} answers; the profile names {table.serial_number}"
        fix = "correct daq.serial_number or daq.address in the profile"
        raise control.error_at(IDENTITY[3], what, fix)


def _name(control: Control) -> str:
    """Return the device's name, control characters removed; empty where it tells none."""
    words = control.read_block(user_name())
    return daq.clean_text(b"".join(int(word).to_bytes(2, "big") for word in words))


class LabJackDaq(DeviceBase[Acquisition]):
    """Driver of one device; implements `hdbench.devices.daq.Daq`.

    `read_block` reads the stream's own socket; everything else goes over the Modbus port, one
    transaction at a time. The two never wait for each other but for a moment at start and stop.
    """

    outputs: Outputs | None

    def __init__(
        self,
        control: Control,
        table: LabJackAcquisition,
        stream_address: tuple[str, int],
        *,
        tacho_rad_s_per_v: float,
    ) -> None:
        outputs = None if table.output is None else Outputs(control, table.output, table.model)
        super().__init__(control.where, outputs, control)
        self.control = control
        self.table = table
        self._stream_address = stream_address
        self._tacho_rad_s_per_v = tacho_rad_s_per_v
        self._session = Session(control)
        self._scales: dict[daq.Role, scanlist.InputScale] = {}

    def capabilities(self) -> daq.Capabilities:
        """Return what the device can do as the profile wires it."""
        return scanlist.describe_abilities(self.table)

    def claim(self) -> None:
        """Become the one host, and clean up what a dead one has left running."""
        self.identity()
        if self._session.claim():
            self._make_safe()
            scanlist.stop_stream(self.control)
        elif self.control.read(STREAM_ENABLE)[0]:
            self._session.release()
            raise BusyError(
                "another program has a stream running on this device",
                where=f"{self.where}, register {STREAM_ENABLE.describe()}",
                fix="end that program; if nobody owns the stream any more, run `hdbench stop`",
            )

    def configure(self, settings: daq.DaqSettings) -> float:
        """Set inputs and stream, outputs safe, and return the actual sample period, s."""
        self.identity()
        self._drop_acquisition()
        scanlist.stop_stream(self.control)
        self._make_safe()
        scanlist.set_up_inputs(self.control, self.table)
        if not self._scales:
            self._scales = scanlist.input_scales(self.control, self.table)
        plan = scanlist.plan_scan(self.table, settings.roles, self._scales)
        setup = scanlist.set_up_stream(
            self.control,
            plan,
            settings.sample_period_s,
            stop_when_full=None if self.table.model == "T4" else not self.table.auto_recover,
        )
        self._acquisition = Acquisition(plan, setup, settings.n_samples)
        return setup.period_s

    def start(self) -> None:
        """Open the stream's socket, then start it; sent once, then read back."""
        self._configured().open(self._stream_address, self.table.deadline_s)
        self.control.write((STREAM_ENABLE,), (1,))
        if not self.control.read(STREAM_ENABLE)[0]:
            raise self.error("the stream did not start", "configure it again")

    def read_block(self) -> daq.ScanBlock | None:
        """Return the next scans; None when none has come within a packet's time."""
        acquisition = self._running()
        block = acquisition.next_block(self.outputs)
        if acquisition.complete and not acquisition.stopped:
            self.stop()
        # a running one may be late
        if block is None and acquisition.silent and not self.control.read(STREAM_ENABLE)[0]:
            # what it sent before it stopped is here by now, and says why
            block = acquisition.next_block(self.outputs)
            if block is None:
                raise self.error(
                    f"the device no longer streams after {acquisition.delivered} scans",
                    "it was restarted, or another program stopped it: check both, then run again",
                )
        return block

    def stop(self) -> None:
        """Stop the stream; scans already taken can still be read."""
        scanlist.stop_stream(self.control)
        if self._acquisition is not None:
            self._acquisition.stopped = True

    def snapshot(self) -> Mapping[daq.Role, float]:
        """Return one reading of every channel; empty while a stream has the inputs."""
        if self._acquisition is not None and self._acquisition.sampling:
            return {}
        return scanlist.read_inputs(self.control, self.table)

    def close(self) -> None:
        """Give the bench back and close both connections; never raises."""
        if self._acquisition is not None and self._acquisition.sampling:
            with contextlib.suppress(HdbenchError):
                scanlist.stop_stream(self.control)
        self._drop_acquisition()
        self._session.release()
        self.control.close()

    def _who(self) -> Identity:
        return check_identity(self.control, self.table)

    def _seen(self) -> Seen:
        """Return reference, V, and motor speed, rad/s, as the inputs show them now."""
        seen = scanlist.read_inputs(self.control, self.table)
        tacho_v = seen.get("tacho")
        speed = None if tacho_v is None else tacho_v * self._tacho_rad_s_per_v
        return Seen(seen.get("reference", self._driving().read_back()), speed)


# 502 and 702
STREAM_OFFSET = 200


def open_labjack(profile: ProfileData, table: LabJackAcquisition) -> LabJackDaq:
    """Open the device; nothing is connected or written yet."""
    address = address_of(table, default_port=502)
    if address.scheme != "tcp":
        raise UsageError(
            f"{table.address!r}: a LabJack is reached by tcp://HOST[:PORT]",
            where="key daq.address",
            fix="for example tcp://192.168.0.7",
        )
    port = address.port + STREAM_OFFSET if table.stream_port is None else table.stream_port
    return LabJackDaq(
        Control(connect(address), deadline_s=table.deadline_s),
        table,
        (address.host, port),
        tacho_rad_s_per_v=profile.tacho.gain_rad_s_per_v,
    )


def labjack_rate_hz(table: LabJackAcquisition) -> float:
    """Return the highest scan rate of the table's channels."""
    if table.model == "T8":
        return math.inf
    return scanlist.describe_abilities(table).max_rates_hz[-1]


DRIVER = Driver(
    open=open_labjack,
    verify=scanlist.check_table,
    rate_hz=labjack_rate_hz,
    drives=lambda table: table.output is not None,
    stop_target=stop_target,
    emulate=later("hdbench.drivers.labjack.emulator.device:emulate_labjack"),
    # the host writes the reference every millisecond of real time then, what two cores still keep
    emulated_speed=5.0,
)
