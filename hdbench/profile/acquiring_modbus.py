"""``[daq]`` of any polled Modbus device, described by its registers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import BaseModel, Field, PositiveFloat, model_validator

from hdbench.profile.acquiring_table import Acquisition, OutputChannel, Role, SerialLine, TlsFiles
from hdbench.profile.tables import Conflict, NonNegative, Table, refuse

Key = tuple[str | int, ...]

# first number of each table as Modicon's manuals count: five digits for 9999 of them, six for all
_MODICON = {"coil": (1, 1), "discrete": (10001, 100001), "input": (30001, 300001),
            "holding": (40001, 400001)}  # fmt: skip
_SHORT, _ALL = 9999, 65536
_REGISTERS = {"i16": 1, "u16": 1, "i32": 2, "u32": 2, "f32": 2, "f64": 4}
# 465536 is the last holding register in Modicon's numbers
_Address = Annotated[
    int, Field(ge=0, le=465536, description="first register or coil, counted as `numbering` says")
]
_Type = Annotated[
    Literal["i16", "u16", "i32", "u32", "f32", "f64"],
    Field(description="type of the value in registers; a coil is one bit"),
]
_Order = Annotated[
    Literal["ABCD", "CDAB", "BADC", "DCBA"],
    Field(
        description="order of the bytes on the wire: most significant first, words swapped, bytes "
        "swapped in each word, least significant first"
    ),
]


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

    table: Literal["holding", "input", "coil", "discrete"] = Field(
        default="holding", description="table it stands in: read by function 3, 4, 1, 2"
    )
    address: _Address
    type: _Type = "i16"
    order: _Order = "ABCD"


class ModbusIdentify(ModbusPlace):
    """A value by which the device is known; checked before anything is written."""

    equals: float | None = Field(default=None, description="what it must read")
    mask: int | None = Field(
        default=None, ge=1, description="bits that are compared; left out: all of them"
    )
    low: float | None = Field(default=None, description="lowest allowed value")
    high: float | None = Field(default=None, description="highest allowed value")

    @model_validator(mode="after")
    def _says_something(self) -> ModbusIdentify:
        if self.equals is None and self.low is None and self.high is None:
            what = "does not say what it must read; needed: equals, or low and high"
            refuse([Conflict((), what, "add equals")])
        return self


class ModbusStatus(ModbusPlace):
    """A word that tells whether a channel can be believed."""

    mask: int = Field(ge=1, description="bits of it that count")
    good: int = Field(default=0, ge=0, description="what they read while the reading is good")
    type: Literal["u16", "u32"] = Field(default="u16", description="type of the word")


class ModbusSign(ModbusPlace):
    """A bit that stands for the sign of a channel, which itself reads without one."""

    bit: int = Field(ge=0, le=31, description="number of the bit, 0 the lowest")
    type: Literal["u16", "u32"] = Field(default="u16", description="type of the word")


class ModbusChannel(ModbusPlace):
    """One value that is polled."""

    role: Role = Field(description="what it measures")
    scale: float = Field(default=1.0, description="units of the role per step")
    offset: float = Field(default=0.0, description="value at zero, units of the role")
    low: float | None = Field(
        default=None, description="lower end of its range, units of the role; left out: of its type"
    )
    high: float | None = Field(
        default=None, description="upper end of its range, units of the role; left out: of its type"
    )
    wrap_bits: int | None = Field(
        default=None, ge=8, le=32, description="of a counter: it wraps after 2 to the power of this"
    )
    invalid: tuple[float, ...] = Field(
        default=(), description="raw values that stand for no reading: that sample counts as lost"
    )
    status: ModbusStatus | None = Field(
        default=None, description="word that must be good, else that sample counts as lost"
    )
    sign: ModbusSign | None = Field(
        default=None, description="bit that is 1 while the value is negative"
    )

    @model_validator(mode="after")
    def _fits_its_role(self) -> ModbusChannel:
        refuse(self._conflicts())
        return self

    def _conflicts(self) -> Iterator[Conflict]:
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

    value: float = Field(description="what is written")
    function: Literal[5, 6, 16] | None = Field(
        default=None,
        description="Modbus function; left out: 5 for a coil, 6 for one register, else 16",
    )
    read_back: bool = Field(
        default=True, description="whether it reads back as written; false for a command register"
    )


class ModbusEnable(ModbusPlace):
    """The drive's enable line."""

    on: int = Field(default=1, ge=0, le=65535, description="value that enables the drive")
    off: int = Field(default=0, ge=0, le=65535, description="value that disables it")
    table: Literal["holding", "coil"] = Field(default="coil", description="table it stands in")
    type: Literal["u16"] = Field(default="u16", description="type of the value")


class ModbusFeed(ModbusPlace):
    """What is written to feed the watchdog; it must move nothing."""

    kind: Literal["key", "toggle", "increment"] = Field(
        default="toggle",
        description="always `value`, 0 and `value` in turn, or one more every time",
    )
    value: int = Field(default=1, ge=1, le=65535, description="value that is written")
    type: Literal["u16"] = Field(default="u16", description="type of the value")


class ModbusWatchdog(Table):
    """The watchdog that lives in the device."""

    time: ModbusPlace = Field(description="register of its time")
    unit_s: PositiveFloat = Field(description="one step of that register, s")
    min_s: PositiveFloat = Field(description="shortest time, s")
    max_s: PositiveFloat = Field(description="longest time, s")
    fed_by: Literal["message", "write", "key"] = Field(
        description="what feeds it: any request, any write, or a key in a register"
    )
    feed: ModbusFeed | None = Field(
        default=None, description="what is written to feed it; none for `message`"
    )
    tripped: ModbusIdentify = Field(description="what reads so after it has tripped")
    drops: tuple[Literal["reference", "enable"], ...] = Field(
        default=("reference", "enable"), min_length=1, description="outputs that it makes safe"
    )
    latches: bool = Field(default=True, description="whether outputs stay safe until it is cleared")
    clear: tuple[ModbusWrite, ...] = Field(
        default=(), description="writes that clear a trip, in order"
    )


class ModbusOutput(OutputChannel, ModbusPlace):
    """The motor reference, the drive's enable line and the watchdog behind them."""

    table: Literal["holding"] = Field(default="holding", description="table it stands in")
    scale: float = Field(default=1.0, description="V per step")
    offset: float = Field(default=0.0, description="output at zero, V")
    function: Literal[6, 16] | None = Field(
        default=None, description="Modbus function; left out: 6 for one register, else 16"
    )
    read_back: ModbusPlace | None = Field(
        default=None, description="where the output reads back; left out: where it is written"
    )
    brake_s: NonNegative = Field(
        default=0.1,
        le=1.0,
        description="time from reference zero to enable off in the safe state, s",
    )
    enable: ModbusEnable | None = Field(
        default=None, description="[daq.output.enable]: none, no enable line"
    )
    watchdog: ModbusWatchdog | None = Field(
        default=None, description="[daq.output.watchdog]: none, no motion"
    )

    @model_validator(mode="after")
    def _consistent(self) -> ModbusOutput:
        refuse(self._conflicts())
        return self

    def _conflicts(self) -> Iterator[Conflict]:
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

    driver: Literal["modbus"] = Field(description="driver that speaks to the DAQ")
    address: str = Field(
        default="embedded",
        pattern=r"^(embedded|(tcp|tls|udp|rtu\+tcp)://(\[[0-9A-Fa-f:.]+(%\w+)?\]|[A-Za-z0-9._-]+)(:[0-9]{1,5})?"
        r"|(rtu|ascii)://(/[A-Za-z0-9._:,+@/-]+|COM[0-9]{1,3})(\?[a-z0-9_=&.-]*)?)$",
        max_length=256,
        description="`embedded` (emulated), tcp://, tls://, udp:// or rtu+tcp://HOST[:PORT], "
        "rtu:// or ascii:///dev/NAME?baud=RATE",
    )
    vendor: str = Field(default="", max_length=64, description="who makes the device")
    model: str = Field(default="", max_length=64, description="model of the device")
    unit: int = Field(default=1, ge=1, le=247, description="Modbus unit identifier")
    numbering: Literal["zero", "one", "modicon"] = Field(
        default="zero",
        description="how `address` counts: from 0 as on the wire, from 1, or as 40001 "
        "(holding), 30001 (input), 10001 (discrete), 1 (coil)",
    )
    max_read_registers: int = Field(
        default=125, ge=1, le=125, description="most registers that one request may read"
    )
    bridge_registers: int = Field(
        default=0,
        ge=0,
        le=64,
        description="registers that are not listed and may be read with their neighbours, so "
        "that one request does for two",
    )
    min_gap_s: NonNegative = Field(
        default=0.0, le=1.0, description="rest of the device between two requests, s"
    )
    reply_s: NonNegative = Field(
        default=0.01,
        le=1.0,
        description="time that the device takes for a reply, the wire left out, s",
    )
    refresh_hz: PositiveFloat | None = Field(
        default=None,
        description="how often the device renews its values, Hz; none: with every request",
    )
    identify: tuple[ModbusIdentify, ...] = Field(
        default=(), description="values by which the device is known, checked before any write"
    )
    init: tuple[ModbusWrite, ...] = Field(
        default=(), description="settings, written only where they differ: flash wears out"
    )
    channels: tuple[ModbusChannel, ...] = Field(default=(), description="what is polled, in order")
    output: ModbusOutput | None = Field(
        default=None, description="[daq.output]: motor reference; none: no motion"
    )
    serial: SerialLine | None = Field(
        default=None, description="[daq.serial], for rtu:// and ascii:// only: the serial line"
    )
    tls: TlsFiles | None = Field(
        default=None, description="[daq.tls], for tls:// only: the certificates"
    )

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
