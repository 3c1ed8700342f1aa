"""A DATAQ instrument as `hdbench.devices.daq.Daq`."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import NoReturn

import numpy as np

from hdbench.devices import daq
from hdbench.devices.base import DeviceBase
from hdbench.devices.bench import Identity
from hdbench.devices.driver import Driver, later
from hdbench.drivers.dataq import scans
from hdbench.drivers.dataq.port import Commands, Port, port_path
from hdbench.drivers.dataq.table import DataqAcquisition, DataqChannel
from hdbench.errors import DeviceError
from hdbench.profile.schema import ProfileData

# the name that hdbench's own emulator has
EMULATOR_NAME = "hdbench-emulator"
_VENDOR, _MODEL, _FIRMWARE, _NAME, _SERIAL = 0, 1, 2, 5, 6
_DIGITS = 8
# one reading outside of an acquisition: a short stream at this period, and the time it may take
_LOOK_PERIOD_S = 0.002
_LOOK_SCANS = 8
_LOOK_S = 0.5
_STEP = "run again; if it comes back, exchange the cable and leave the digital inputs open"
_PROBE_S = 0.3


def check_identity(commands: Commands, table: DataqAcquisition) -> Identity:
    """Return who answers, if it is the instrument that the profile means.

    The line has no checksum: every answer is asked for until two in a row agree.
    """
    vendor, model = _agreed(commands, _VENDOR), _agreed(commands, _MODEL)
    serial = _agreed(commands, _SERIAL)[:_DIGITS]
    wanted = scans.MODELS[table.model].number
    if vendor != "DATAQ" or model.removeprefix("DI-").upper() != wanted:
        raise DeviceError(
            f"{vendor[:20]!r} {model[:20]!r} answers; needed: DATAQ {wanted}",
            where=commands.where,
            fix="correct daq.model or daq.address in the profile",
        )
    if table.serial_number is not None and serial.upper() != table.serial_number:
        raise DeviceError(
            f"serial number {serial!r} answers; needed: {table.serial_number}",
            where=commands.where,
            fix="correct daq.serial_number or daq.address in the profile",
        )
    return Identity(
        vendor="DATAQ",
        model=table.model,
        serial=serial,
        firmware=_version(_agreed(commands, _FIRMWARE)),
        simulated=_agreed(commands, _NAME) == EMULATOR_NAME,
    )


def _agreed(commands: Commands, item: int) -> str:
    """Return an item that two answers in a row agree about."""
    last = None
    for _ in range(4):
        answer = commands.ask(f"info {item}")
        if answer == last:
            return answer
        last = answer
    raise DeviceError(
        f"'info {item}' is answered differently every time: {answer[:20]!r}",
        where=commands.where,
        fix="exchange the cable",
    )


def _version(text: str) -> str:
    """Return hexadecimal 65 as 1.01."""
    try:
        return f"{int(text, 16) / 100.0:.2f}"
    except ValueError:
        return text


def _input(channel: DataqChannel, bits: int) -> daq.InputInfo:
    if channel.input == "counter":
        return daq.InputInfo(channel.role, 0.0, scans.WRAP - 1.0, 32, scans.WRAP)
    end = channel.range_v * abs(channel.scale)
    return daq.InputInfo(channel.role, -end, end, bits)


def max_rates_hz(table: DataqAcquisition) -> tuple[float, ...]:
    """Return the highest rate with the first 1, 2, ... channels, Hz, the mark included."""
    roles = table.roles
    return tuple(
        scans.highest_rate_hz(
            scans.MODELS[table.model],
            len(scans.plan_scan(table, roles[:count]).words),
            table.average,
        )
        for count in range(1, len(roles) + 1)
    )


class DataqDaq(DeviceBase[scans.Acquisition]):
    """Driver of one instrument; implements `hdbench.devices.daq.Daq`.

    No model has an analog output, so this driver drives nothing: it is the inputs of a composite,
    or measures a bench that stands.
    """

    def __init__(self, commands: Commands, table: DataqAcquisition) -> None:
        super().__init__(commands.where)
        self._commands = commands
        self.close = commands.close
        self._table = table
        self._quiet = False

    def capabilities(self) -> daq.Capabilities:
        """Return what the instrument can do as the profile wires it."""
        table, model = self._table, scans.MODELS[self._table.model]
        entries = len(scans.plan_scan(table, table.roles).words)
        return daq.Capabilities(
            inputs=tuple(_input(channel, model.bits) for channel in table.channels),
            max_rates_hz=max_rates_hz(table),
            min_rate_hz=scans.lowest_rate_hz(model, entries),
        )

    def configure(self, settings: daq.DaqSettings) -> float:
        """Send scan list, rate and packet size, and return the actual sample period, s."""
        self.identity()
        self._acquisition = None
        plan = scans.plan_scan(self._table, settings.roles)
        encoder = self._encoder(settings.roles)
        self._acquisition = self._set_up(
            plan, settings.sample_period_s, self._table.average, settings.n_samples, encoder
        )
        return self._acquisition.period_s

    def start(self) -> None:
        """Start scanning; sent once, and never echoed: the first packet is the proof."""
        acquisition = self._configured()
        self._quiet = False
        self._commands.start()
        acquisition.begin()

    def read_block(self) -> daq.ScanBlock | None:
        """Return the next scans; None when none has come yet."""
        acquisition = self._running()
        try:
            block = acquisition.next_block(self._commands.port)
        except scans.StreamFault as fault:
            self._broken(acquisition, str(fault))
        if acquisition.complete and not acquisition.stopped:
            self._be_quiet()
            acquisition.stop(b"")
        if block is None and acquisition.silent:
            self._broken(acquisition, "the instrument no longer sends")
        return block

    def stop(self) -> None:
        """Stop scanning; scans already taken can still be read."""
        acquisition = self._acquisition
        if acquisition is None or not acquisition.sampling:
            return
        acquisition.stop(self._be_quiet())

    def snapshot(self) -> Mapping[daq.Role, float]:
        """Return the mean of a short stream; empty while an acquisition has the inputs."""
        if self._acquisition is not None and self._acquisition.sampling:
            return {}
        # a counter says nothing without the counts before
        roles = tuple(c.role for c in self._table.channels if c.role != "encoder")
        plan = scans.plan_scan(self._table, roles)
        # the instrument is configured anew before the next acquisition
        self._acquisition = None
        look = self._set_up(plan, self._look_period_s(len(plan.words)), 1, _LOOK_SCANS)
        self._quiet = False
        self._commands.start()
        look.begin()
        try:
            return self._mean_of(look, roles)
        finally:
            self._be_quiet()

    def _who(self) -> Identity:
        # a stream that somebody left is stopped first
        self._be_quiet()
        return check_identity(self._commands, self._table)

    def _set_up(
        self,
        plan: scans.ScanPlan,
        period_s: float,
        average: int,
        n_samples: int,
        encoder: tuple[int, int] | None = None,
    ) -> scans.Acquisition:
        """Send every setting to the quiet instrument; each is echoed as it was sent."""
        self._be_quiet()
        model, entries = scans.MODELS[self._table.model], len(plan.words)
        rate = scans.choose_rate(model, entries, period_s, average)
        code = scans.packet_code(entries, rate.period_s)
        lines = [f"ps {code}", "encode 0"]
        lines += [f"slist {position} {word}" for position, word in enumerate(plan.words)]
        lines.append(f"srate {rate.srate}")
        if model.dec_max > 1:
            lines += [f"dec {rate.dec}", f"filter * {int(average > 1)}"]
        if model.deca_max > 1:
            lines.append(f"deca {rate.deca}")
        for line in lines:
            self._commands.set(line)
        packet_s = (16 << code) / plan.scan_bytes * rate.period_s
        return scans.Acquisition(plan, rate.period_s, packet_s, n_samples, encoder=encoder)

    def _encoder(self, roles: tuple[daq.Role, ...]) -> tuple[int, int] | None:
        """Return counts per edge and the tacho's channel, where an encoder is sampled."""
        spec = next((c for c in self._table.channels if c.role == "encoder"), None)
        if spec is None or "encoder" not in roles:
            return None
        if "tacho" not in roles:
            raise self.error(
                "the counter knows no direction without the tacho", "add tacho to daq.channels"
            )
        return spec.counts_per_edge, roles.index("tacho")

    def _look_period_s(self, entries: int) -> float:
        """Return a period that the model has, near that of a short stream."""
        model = scans.MODELS[self._table.model]
        srate = max(model.shortest(entries), round(model.clock_hz(entries) * _LOOK_PERIOD_S))
        return min(srate, model.srate_max) / model.clock_hz(entries)

    def _mean_of(
        self, look: scans.Acquisition, roles: tuple[daq.Role, ...]
    ) -> dict[daq.Role, float]:
        """Return the mean of the stream's scans; empty where too few came in time."""
        until_s = time.monotonic() + _LOOK_S
        values = []
        while not look.complete and time.monotonic() < until_s:
            try:
                block = look.next_block(self._commands.port)
            except scans.StreamFault as fault:
                raise self.error(str(fault), _STEP) from fault
            if block is not None:
                values.append(block.values)
        if not look.complete:
            return {}
        mean = np.mean(np.concatenate(values), axis=0)
        return {role: float(value) for role, value in zip(roles, mean, strict=True)}

    def _be_quiet(self) -> bytes:
        """Stop a stream, one that a dead host has left included; return what it had sent."""
        if self._quiet:
            return b""
        left = self._commands.stop()
        self._quiet = True
        return left

    def _broken(self, acquisition: scans.Acquisition, what: str) -> NoReturn:
        """Raise what has ended the stream."""
        done = f"after {acquisition.delivered} scans"
        if acquisition.overflowed:
            self._quiet = True
            raise self.error(
                f"the instrument's buffer ran over {done}, and it stopped",
                "free this computer of other work, sample more slowly, or name fewer channels",
            )
        raise self.error(f"{what} ({done})", _STEP)


def open_dataq(profile: ProfileData, table: DataqAcquisition) -> DataqDaq:
    """Open the instrument; the port is not opened yet."""
    return DataqDaq(Commands(Port(port_path(table.address)), deadline_s=table.deadline_s), table)


def verify(table: DataqAcquisition) -> None:
    """Refuse what the model does not have."""
    scans.plan_scan(table, table.roles)


def probe(path: str) -> str:
    """Ask ``info 1``: a DATAQ echoes the words and adds its model."""
    from serial import Serial

    with Serial(path, 115200, timeout=0.05, exclusive=True) as line:
        line.reset_input_buffer()
        line.write(b"info 1\r")
        until_s, reply = time.monotonic() + _PROBE_S, b""
        while time.monotonic() < until_s and len(reply) < 64:
            reply += line.read(64)
    said = daq.clean_text(reply.replace(b"\r", b" "))
    return f"DATAQ: {said.removeprefix('info 1').strip()}" if said.startswith("info 1 ") else ""


DRIVER = Driver(
    open=open_dataq,
    verify=verify,
    rate_hz=lambda table: max_rates_hz(table)[-1],
    # no DATAQ instrument has an analog output
    drives=lambda _: False,
    emulate=later("hdbench.drivers.dataq.emulator:emulate_dataq"),
    emulated_speed=10.0,
    probe=probe,
)
