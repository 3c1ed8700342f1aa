"""``[daq]`` of any polled Modbus device, described by its registers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from pydantic import BaseModel, PositiveFloat

from hdbench.profile.acquiring import Acquisition, OutputChannel, Role, SerialLine, TlsFiles
from hdbench.profile.tables import Conflict, NonNegative, Table, item

Key = tuple[str | int, ...]

# first number of each table as Modicon's manuals count: five digits for 9999 of them, six for all
_MODICON = {"coil": (1, 1), "discrete": (10001, 100001), "input": (30001, 300001),
            "holding": (40001, 400001)}  # fmt: skip
_SHORT, _ALL = 9999, 65536
_REGISTERS = {"i16": 1, "u16": 1, "i32": 2, "u32": 2, "f32": 2, "f64": 4}


def number_ranges(numbering: str, table: str) -> tuple[tuple[int, int], ...]:
    """Return first and last number of a table's registers, shorter numbers first."""
    if numbering != "modicon":
        first = 1 if numbering == "one" else 0
        return ((first, first + _ALL - 1),)
    short, long = _MODICON[table]
    if short == long:
        return ((short, short + _ALL - 1),)
    return ((short, short + _SHORT - 1), (long, long + _ALL - 1))


class ModbusPlace(Table):
    """One value in the device's map."""

    table: Literal["holding", "input", "coil", "discrete"] = item(
        "table it stands in: read by function 3, 4, 1, 2", "holding"
    )
    # 465536 is the last holding register in Modicon's numbers
    address: int = item("first register or coil, counted as `numbering` says", ge=0, le=465536)
    type: Literal["i16", "u16", "i32", "u32", "f32", "f64"] = item(
        "type of the value in registers; a coil is one bit", "i16"
    )
    order: Literal["ABCD", "CDAB", "BADC", "DCBA"] = item(
        "order of the bytes on the wire: most significant first, words swapped, bytes swapped in "
        "each word, least significant first",
        "ABCD",
    )


class ModbusIdentify(ModbusPlace):
    """A value by which the device is known; checked before anything is written."""

    equals: float | None = item("what it must read", None)
    mask: int | None = item("bits that are compared; left out: all of them", None, ge=1)
    low: float | None = item("lowest allowed value", None)
    high: float | None = item("highest allowed value", None)

    def conflicts(self) -> Iterator[Conflict]:
        """Return what is wrong with an identification that nothing can fail."""
        if self.equals is None and self.low is None and self.high is None:
            what = "does not say what it must read; needed: equals, or low and high"
            yield Conflict((), what, "add equals")


class ModbusStatus(ModbusPlace):
    """A word that tells whether a channel can be believed."""

    mask: int = item("bits of it that count", ge=1)
    good: int = item("what they read while the reading is good", 0, ge=0)
    type: Literal["u16", "u32"] = item("type of the word", "u16")


class ModbusSign(ModbusPlace):
    """A bit that stands for the sign of a channel, which itself reads without one."""

    bit: int = item("number of the bit, 0 the lowest", ge=0, le=31)
    type: Literal["u16", "u32"] = item("type of the word", "u16")


class ModbusChannel(ModbusPlace):
    """One value that is polled."""

    role: Role = item("what it measures")
    scale: float = item("units of the role per step", 1.0)
    offset: float = item("value at zero, units of the role", 0.0)
    low: float | None = item(
        "lower end of its range, units of the role; left out: of its type", None
    )
    high: float | None = item(
        "upper end of its range, units of the role; left out: of its type", None
    )
    wrap_bits: int | None = item(
        "of a counter: it wraps after 2 to the power of this", None, ge=8, le=32
    )
    invalid: tuple[float, ...] = item(
        "raw values that stand for no reading: that sample counts as lost", ()
    )
    status: ModbusStatus | None = item(
        "word that must be good, else that sample counts as lost", None
    )
    sign: ModbusSign | None = item("bit that is 1 while the value is negative", None)

    def conflicts(self) -> Iterator[Conflict]:
        """Return the keys that do not fit the role."""
        encoder = self.role == "encoder"
        if self.wrap_bits is not None and not encoder:
            yield Conflict(
                ("wrap_bits",), "is for an encoder only", "take it out, or correct the role"
            )
        if encoder and not (self.scale == 1.0 and self.offset == 0.0 and self.type[0] in "iu"):
            yield Conflict(
                ("scale",),
                "an encoder is polled in counts: a whole-number type, scale 1, offset 0",
                "scale it by encoder.counts_per_turn instead",
            )
        if self.scale == 0.0:
            yield Conflict(("scale",), "is 0; needed: another number", "give units per step")


class ModbusWrite(ModbusPlace):
    """One value that is written, and read back."""

    value: float = item("what is written")
    function: Literal[5, 6, 16] | None = item(
        "Modbus function; left out: 5 for a coil, 6 for one register, else 16", None
    )
    read_back: bool = item("whether it reads back as written; false for a command register", True)


class ModbusEnable(ModbusPlace):
    """The drive's enable line."""

    on: int = item("value that enables the drive", 1, ge=0, le=65535)
    off: int = item("value that disables it", 0, ge=0, le=65535)
    table: Literal["holding", "coil"] = item("table it stands in", "coil")
    type: Literal["u16"] = item("type of the value", "u16")


class ModbusFeed(ModbusPlace):
    """What is written to feed the watchdog; it must move nothing."""

    kind: Literal["key", "toggle", "increment"] = item(
        "always `value`, 0 and `value` in turn, or one more every time", "toggle"
    )
    value: int = item("value that is written", 1, ge=1, le=65535)
    type: Literal["u16"] = item("type of the value", "u16")


class ModbusWatchdog(Table):
    """The watchdog that lives in the device."""

    time: ModbusPlace = item("register of its time")
    unit_s: PositiveFloat = item("one step of that register, s")
    min_s: PositiveFloat = item("shortest time, s")
    max_s: PositiveFloat = item("longest time, s")
    fed_by: Literal["message", "write", "key"] = item(
        "what feeds it: any request, any write, or a key in a register"
    )
    feed: ModbusFeed | None = item("what is written to feed it; none for `message`", None)
    tripped: ModbusIdentify = item("what reads so after it has tripped")
    drops: tuple[Literal["reference", "enable"], ...] = item(
        "outputs that it makes safe", ("reference", "enable"), min_length=1
    )
    latches: bool = item("whether outputs stay safe until it is cleared", True)
    clear: tuple[ModbusWrite, ...] = item("writes that clear a trip, in order", ())


class ModbusOutput(OutputChannel, ModbusPlace):
    """The motor reference, the drive's enable line and the watchdog behind them."""

    table: Literal["holding"] = item("table it stands in", "holding")
    scale: float = item("V per step", 1.0)
    offset: float = item("output at zero, V", 0.0)
    function: Literal[6, 16] | None = item(
        "Modbus function; left out: 6 for one register, else 16", None
    )
    read_back: ModbusPlace | None = item(
        "where the output reads back; left out: where it is written", None
    )
    brake_s: NonNegative = item(
        "time from reference zero to enable off in the safe state, s", 0.1, le=1.0
    )
    enable: ModbusEnable | None = item("[daq.output.enable]: none, no enable line", None)
    watchdog: ModbusWatchdog | None = item("[daq.output.watchdog]: none, no motion", None)

    def conflicts(self) -> Iterator[Conflict]:
        """Return the keys of output, enable line and watchdog that do not go together."""
        if self.scale == 0.0:
            yield Conflict(("scale",), "is 0; needed: V per step", "give V per step")
        if self.enable is not None and self.enable.on == self.enable.off:
            yield Conflict(
                ("enable", "off"), "is the same as on", "give the value that disables the drive"
            )
        watchdog = self.watchdog
        if watchdog is None:
            return
        if watchdog.fed_by in ("write", "key") and watchdog.feed is None:
            yield Conflict(
                ("watchdog", "feed"),
                "is missing; needed: a register whose writing moves nothing",
                "add [daq.output.watchdog.feed]",
            )
        if "enable" in watchdog.drops and self.enable is None:
            yield Conflict(
                ("watchdog", "drops"),
                "names enable, but there is no [daq.output.enable]",
                'name "reference" only, or describe the enable line',
            )


class ModbusAcquisition(Acquisition):
    """A polled Modbus device: requests per sample, times are the host's."""

    driver: Literal["modbus"] = item("driver that speaks to the DAQ")
    address: str = item(
        "`embedded` (emulated), tcp://, tls://, udp:// or rtu+tcp://HOST[:PORT], rtu:// or "
        "ascii:///dev/NAME?baud=RATE",
        "embedded",
        pattern=r"^(embedded|(tcp|tls|udp|rtu\+tcp)://(\[[0-9A-Fa-f:.]+(%\w+)?\]|[A-Za-z0-9._-]+)(:[0-9]{1,5})?"
        r"|(rtu|ascii)://(/[A-Za-z0-9._:,+@/-]+|COM[0-9]{1,3})(\?[a-z0-9_=&.-]*)?)$",
        max_length=256,
    )
    vendor: str = item("who makes the device", "", max_length=64)
    model: str = item("model of the device", "", max_length=64)
    unit: int = item("Modbus unit identifier", 1, ge=1, le=247)
    numbering: Literal["zero", "one", "modicon"] = item(
        "how `address` counts: from 0 as on the wire, from 1, or as 40001 (holding), 30001 "
        "(input), 10001 (discrete), 1 (coil)",
        "zero",
    )
    max_read_registers: int = item("most registers that one request may read", 125, ge=1, le=125)
    bridge_registers: int = item(
        "registers that are not listed and may be read with their neighbours, so that one request "
        "does for two",
        0,
        ge=0,
        le=64,
    )
    min_gap_s: NonNegative = item("rest of the device between two requests, s", 0.0, le=1.0)
    reply_s: NonNegative = item(
        "time that the device takes for a reply, the wire left out, s", 0.01, le=1.0
    )
    refresh_hz: PositiveFloat | None = item(
        "how often the device renews its values, Hz; none: with every request", None
    )
    identify: tuple[ModbusIdentify, ...] = item(
        "values by which the device is known, checked before any write", ()
    )
    init: tuple[ModbusWrite, ...] = item(
        "settings, written only where they differ: flash wears out", ()
    )
    channels: tuple[ModbusChannel, ...] = item("what is polled, in order", ())
    output: ModbusOutput | None = item("[daq.output]: motor reference; none: no motion", None)
    serial: SerialLine | None = item(
        "[daq.serial], for rtu:// and ascii:// only: the serial line", None
    )
    tls: TlsFiles | None = item("[daq.tls], for tls:// only: the certificates", None)

    def conflicts(self) -> Iterator[Conflict]:
        """Yield the keys of this table that do not go together."""
        yield from super().conflicts()
        for key, place in places_in(self):
            yield from self._place_conflicts(key, place)
        if (self.output is not None or self.init) and not self.identify:
            yield Conflict(
                ("output" if self.output is not None else "init",),
                "would be written to a device that nothing identifies; needed: [[daq.identify]]",
                "add a register whose value tells this device from others",
            )

    def _place_conflicts(self, key: Key, place: ModbusPlace) -> Iterator[Conflict]:
        ranges = number_ranges(self.numbering, place.table)
        if not any(low <= place.address <= high for low, high in ranges):
            words = " or ".join(f"{low} to {high}" for low, high in ranges)
            yield Conflict(
                (*key, "address"),
                f"is {place.address}; needed for numbering {self.numbering!r}, "
                f"table {place.table!r}: {words}",
                "count as the device's manual does, and say so in daq.numbering",
            )
        size = _REGISTERS[place.type]
        if size > 1 and getattr(place, "function", None) == 6:
            yield Conflict(
                (*key, "function"), "is 6, which writes one register; needed: 16", "take it out"
            )
        if place.table in ("holding", "input") and size > self.max_read_registers:
            yield Conflict(
                (*key, "type"),
                f"takes {size} registers; one request reads {self.max_read_registers} "
                "(daq.max_read_registers)",
                "a value must come in one request: raise the limit, or name a shorter type",
            )


def places_in(table: BaseModel, base: Key = ()) -> Iterator[tuple[Key, ModbusPlace]]:
    """Yield every place in a table and the tables below it, with its key."""
    for name, value in table:
        several = isinstance(value, tuple)
        for number, part in enumerate(value if several else (value,)):
            if isinstance(part, BaseModel):
                key = (*base, name, number) if several else (*base, name)
                if isinstance(part, ModbusPlace):
                    yield key, part
                yield from places_in(part, key)
