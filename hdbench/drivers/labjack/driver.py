"""A LabJack T4 or T7 as `hdbench.devices.daq.Daq`."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass

from hdbench.devices.bench import Identity, SafeState
from hdbench.devices.daq import (
    Capabilities,
    DaqSettings,
    Role,
    ScanBlock,
    WatchdogState,
    clean_text,
)
from hdbench.devices.safestate import Seen, reach_safe_state
from hdbench.devices.wire.address import parse_address
from hdbench.devices.wire.link import connect
from hdbench.drivers.labjack.control import Control, Session
from hdbench.drivers.labjack.outputs import Outputs, Watchdog
from hdbench.drivers.labjack.registers import IDENTITY, STREAM_ENABLE, TEST, user_name
from hdbench.drivers.labjack.scanlist import (
    InputScale,
    describe_abilities,
    input_scales,
    plan_scan,
    read_inputs,
    set_up_inputs,
    set_up_stream,
    stop_stream,
)
from hdbench.drivers.labjack.stream import Acquisition
from hdbench.drivers.labjack.table import LabJackAcquisition
from hdbench.errors import BusyError, DeviceError, HdbenchError, UsageError
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
    product, _, firmware, serial = control.read(*IDENTITY)
    _check_model(control, round(product), int(serial), table)
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
    return clean_text(b"".join(int(word).to_bytes(2, "big") for word in words))


# the looped-back reference: offset and noise of the converter, far below what turns a motor
_ZERO_V = 0.02


@dataclass(eq=False)
class LabJackDaq:
    """Driver of one device; implements `hdbench.devices.daq.Daq`.

    `read_block` reads the stream's own socket; everything else goes over the Modbus port, one
    transaction at a time. The two never wait for each other but for a moment at start and stop.
    """

    control: Control
    table: LabJackAcquisition
    stream_address: tuple[str, int]
    _: KW_ONLY
    tacho_rad_s_per_v: float

    def __post_init__(self) -> None:
        self._session = Session(self.control)
        self._outputs = outputs = Outputs(self.control, self.table)
        self.write_output, self.enable = outputs.write, outputs.enable
        # a trip is forgotten; the watchdog stays on, as it is kept in flash
        self.clear_watchdog = outputs.make_safe
        self._watchdog = (
            Watchdog(self.control, self.table.output) if self.table.output is not None else None
        )
        self._identity: Identity | None = None
        self._scales: dict[Role, InputScale] = {}
        self._acquisition: Acquisition | None = None

    @property
    def repeats(self) -> int:
        """Requests that were sent again so far."""
        return self.control.repeats

    def capabilities(self) -> Capabilities:
        """Return what the device can do as the profile wires it."""
        return describe_abilities(self.table, simulated=self.identity().simulated)

    def identity(self) -> Identity:
        """Return who answers; asked once, before anything is written."""
        if self._identity is None:
            self._identity = check_identity(self.control, self.table)
        return self._identity

    def claim(self) -> None:
        """Become the one host, and clean up what a dead one has left running."""
        self.identity()
        if self._session.claim():
            self._outputs.make_safe()
            stop_stream(self.control)
        elif self.control.read(STREAM_ENABLE)[0]:
            self._session.release()
            raise BusyError(
                "another program has a stream running on this device",
                where=f"{self.control.where}, register {STREAM_ENABLE.describe()}",
                fix="end that program; if nobody owns the stream any more, run `hdbench stop`",
            )

    def configure(self, settings: DaqSettings) -> float:
        """Set inputs and stream, outputs safe, and return the actual sample period, s."""
        self.identity()
        self._drop_acquisition()
        stop_stream(self.control)
        self._outputs.make_safe()
        set_up_inputs(self.control, self.table)
        if not self._scales:
            self._scales = input_scales(self.control, self.table)
        plan = plan_scan(self.table, settings.roles, self._scales)
        setup = set_up_stream(
            self.control,
            plan,
            settings.sample_period_s,
            stop_when_full=None if self.table.model == "T4" else not self.table.auto_recover,
        )
        self._acquisition = Acquisition(plan, setup, settings.n_samples)
        return setup.period_s

    def start(self) -> None:
        """Open the stream's socket, then start it; sent once, then read back."""
        acquisition = self._acquisition
        if acquisition is None or acquisition.started:
            raise self._error("no acquisition is configured", "configure it first")
        acquisition.open(self.stream_address, self.table.deadline_s)
        self.control.write((STREAM_ENABLE,), (1,))
        if not self.control.read(STREAM_ENABLE)[0]:
            raise self._error("the stream did not start", "configure it again")

    def read_block(self) -> ScanBlock | None:
        """Return the next scans; None when none has come within a packet's time."""
        acquisition = self._acquisition
        if acquisition is None or not acquisition.started:
            raise self._error("no acquisition has been started", "start it first")
        block = acquisition.next_block(self._outputs)
        if acquisition.complete and not acquisition.stopped:
            acquisition.stopped = True
            stop_stream(self.control)
        if block is None and acquisition.silent:
            self._why_silent(acquisition)
        return block

    def stop(self) -> None:
        """Stop the stream; scans already taken can still be read."""
        stop_stream(self.control)
        if self._acquisition is not None:
            self._acquisition.stopped = True

    def arm_watchdog(self, time_s: float) -> float:
        """Bring the watchdog in flash to the wanted settings, feed it, and return its time, s."""
        return self._guard().arm(time_s)

    def feed_watchdog(self) -> None:
        """Feed it once; the same transaction shows whether the enable line has dropped."""
        self._outputs.note_levels(self._guard().feed())

    def watchdog(self) -> WatchdogState:
        """Return its state: settings from flash, a trip from the level of the enable line."""
        values = self._guard().read()
        armed = bool(values["WATCHDOG_ENABLE_DEFAULT"] and values["WATCHDOG_STRICT_ENABLE_DEFAULT"])
        self._outputs.look()
        time_s = float(values["WATCHDOG_TIMEOUT_S_DEFAULT"])
        return WatchdogState(armed, self._outputs.tripped, time_s)

    def snapshot(self) -> Mapping[Role, float]:
        """Return one reading of every channel; empty while a stream has the inputs."""
        if self._acquisition is not None and self._acquisition.sampling:
            return {}
        return read_inputs(self.control, self.table)

    def safe_state(self) -> SafeState:
        """Zero the reference, disable the drive at standstill, stop the stream; all read back."""
        self._drop_acquisition()
        try:
            self.identity()
        except HdbenchError as error:
            # a device that is not the one meant is never written to
            return SafeState(False, None, None, error.what)
        return reach_safe_state(
            stop=self._stop,
            look=self._measured,
            disable=lambda: not self._outputs.enable(on=False),
            zero_v=_ZERO_V,
        )

    def close(self) -> None:
        """Give the bench back and close both connections; never raises."""
        if self._acquisition is not None and self._acquisition.sampling:
            with contextlib.suppress(HdbenchError):
                stop_stream(self.control)
        self._drop_acquisition()
        self._session.release()
        self.control.close()

    def _stop(self) -> None:
        self._outputs.zero()
        stop_stream(self.control)

    def _measured(self) -> Seen:
        """Return reference, V, and motor speed, rad/s, as the inputs show them now."""
        seen = read_inputs(self.control, self.table)
        tacho_v = seen.get("tacho")
        speed = None if tacho_v is None else tacho_v * self.tacho_rad_s_per_v
        return Seen(seen.get("reference", self._outputs.read_back()), speed)

    def _drop_acquisition(self) -> None:
        if self._acquisition is not None:
            self._acquisition.close()
        self._acquisition = None

    def _why_silent(self, acquisition: Acquisition) -> None:
        """Ask whether the stream still runs; a running one may be late."""
        if not self.control.read(STREAM_ENABLE)[0]:
            raise self._error(
                f"the device no longer streams after {acquisition.delivered} scans",
                "it was restarted, or another program stopped it: check both, then run again",
            )

    def _guard(self) -> Watchdog:
        if self._watchdog is None:
            raise self._error(
                "the profile names no output, so there is nothing to guard",
                "add [daq.output] with an enable line",
            )
        return self._watchdog

    def _error(self, what: str, fix: str) -> DeviceError:
        return DeviceError(what, where=self.control.where, fix=fix)


# 502 and 702
STREAM_OFFSET = 200


def open_labjack(profile: ProfileData, table: LabJackAcquisition) -> LabJackDaq:
    """Open the device; nothing is connected or written yet."""
    address = parse_address(table.address, default_port=502)
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
    return describe_abilities(table, simulated=False).max_rates_hz[-1]
