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

    table: Annotated[
        Literal["holding", "input", "coil", "discrete"],
        Field(description="table it stands in: read by function 3, 4, 1, 2"),
    ] = "holding"
    address: _Address
    type: _Type = "i16"
    order: _Order = "ABCD"


class ModbusIdentify(ModbusPlace):
    """A value by which the device is known; checked before anything is written."""

    equals: Annotated[float | None, Field(description="what it must read")] = None
    mask: Annotated[
        int | None, Field(ge=1, description="bits that are compared; left out: all of them")
    ] = None
    low: Annotated[float | None, Field(description="lowest allowed value")] = None
    high: Annotated[float | None, Field(description="highest allowed value")] = None

    @model_validator(mode="after")
    def _says_something(self) -> ModbusIdentify:
        if self.equals is None and self.low is None and self.high is None:
            what = "does not say what it must read; needed: equals, or low and high"
            refuse([Conflict((), what, "add equals")])
        return self


class ModbusStatus(ModbusPlace):
    """A word that tells whether a channel can be believed."""

    mask: Annotated[int, Field(ge=1, description="bits of it that count")]
    good: Annotated[int, Field(ge=0, description="what they read while the reading is good")] = 0
    type: Annotated[Literal["u16", "u32"], Field(description="type of the word")] = "u16"


class ModbusSign(ModbusPlace):
    """A bit that stands for the sign of a channel, which itself reads without one."""

    bit: Annotated[int, Field(ge=0, le=31, description="number of the bit, 0 the lowest")]
    type: Annotated[Literal["u16", "u32"], Field(description="type of the word")] = "u16"


class ModbusChannel(ModbusPlace):
    """One value that is polled."""

    role: Annotated[Role, Field(description="what it measures")]
    scale: Annotated[float, Field(description="units of the role per step")] = 1.0
    offset: Annotated[float, Field(description="value at zero, units of the role")] = 0.0
    low: Annotated[
        float | None,
        Field(description="lower end of its range, units of the role; left out: of its type"),
    ] = None
    high: Annotated[
        float | None,
        Field(description="upper end of its range, units of the role; left out: of its type"),
    ] = None
    wrap_bits: Annotated[
        int | None,
        Field(ge=8, le=32, description="of a counter: it wraps after 2 to the power of this"),
    ] = None
    invalid: Annotated[
        tuple[float, ...],
        Field(description="raw values that stand for no reading: that sample counts as lost"),
    ] = ()
    status: Annotated[
        ModbusStatus | None,
        Field(description="word that must be good, else that sample counts as lost"),
    ] = None
    sign: Annotated[
        ModbusSign | None, Field(description="bit that is 1 while the value is negative")
    ] = None

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

    value: Annotated[float, Field(description="what is written")]
    function: Annotated[
        Literal[5, 6, 16] | None,
        Field(description="Modbus function; left out: 5 for a coil, 6 for one register, else 16"),
    ] = None
    read_back: Annotated[
        bool, Field(description="whether it reads back as written; false for a command register")
    ] = True


class ModbusEnable(ModbusPlace):
    """The drive's enable line."""

    on: Annotated[int, Field(ge=0, le=65535, description="value that enables the drive")] = 1
    off: Annotated[int, Field(ge=0, le=65535, description="value that disables it")] = 0
    table: Annotated[Literal["holding", "coil"], Field(description="table it stands in")] = "coil"
    type: Annotated[Literal["u16"], Field(description="type of the value")] = "u16"


class ModbusFeed(ModbusPlace):
    """What is written to feed the watchdog; it must move nothing."""

    kind: Annotated[
        Literal["key", "toggle", "increment"],
        Field(description="always `value`, 0 and `value` in turn, or one more every time"),
    ] = "toggle"
    value: Annotated[int, Field(ge=1, le=65535, description="value that is written")] = 1
    type: Annotated[Literal["u16"], Field(description="type of the value")] = "u16"


class ModbusWatchdog(Table):
    """The watchdog that lives in the device."""

    time: Annotated[ModbusPlace, Field(description="register of its time")]
    unit_s: Annotated[PositiveFloat, Field(description="one step of that register, s")]
    min_s: Annotated[PositiveFloat, Field(description="shortest time, s")]
    max_s: Annotated[PositiveFloat, Field(description="longest time, s")]
    fed_by: Annotated[
        Literal["message", "write", "key"],
        Field(description="what feeds it: any request, any write, or a key in a register"),
    ]
    feed: Annotated[
        ModbusFeed | None, Field(description="what is written to feed it; none for `message`")
    ] = None
    tripped: Annotated[ModbusIdentify, Field(description="what reads so after it has tripped")]
    drops: Annotated[
        tuple[Literal["reference", "enable"], ...],
        Field(min_length=1, description="outputs that it makes safe"),
    ] = ("reference", "enable")
    latches: Annotated[bool, Field(description="whether outputs stay safe until it is cleared")] = (
        True
    )
    clear: Annotated[
        tuple[ModbusWrite, ...], Field(description="writes that clear a trip, in order")
    ] = ()


class ModbusOutput(OutputChannel, ModbusPlace):
    """The motor reference, the drive's enable line and the watchdog behind them."""

    table: Annotated[Literal["holding"], Field(description="table it stands in")] = "holding"
    scale: Annotated[float, Field(description="V per step")] = 1.0
    offset: Annotated[float, Field(description="output at zero, V")] = 0.0
    function: Annotated[
        Literal[6, 16] | None,
        Field(description="Modbus function; left out: 6 for one register, else 16"),
    ] = None
    read_back: Annotated[
        ModbusPlace | None,
        Field(description="where the output reads back; left out: where it is written"),
    ] = None
    brake_s: Annotated[
        NonNegative,
        Field(le=1.0, description="time from reference zero to enable off in the safe state, s"),
    ] = 0.1
    enable: Annotated[
        ModbusEnable | None, Field(description="[daq.output.enable]: none, no enable line")
    ] = None
    watchdog: Annotated[
        ModbusWatchdog | None, Field(description="[daq.output.watchdog]: none, no motion")
    ] = None

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

    driver: Annotated[Literal["modbus"], Field(description="driver that speaks to the DAQ")]
    address: Annotated[
        str,
        Field(
            pattern=r"^(embedded|(tcp|tls|udp|rtu\+tcp)://(\[[0-9A-Fa-f:.]+(%\w+)?\]|[A-Za-z0-9._-]+)(:[0-9]{1,5})?"
            r"|(rtu|ascii)://(/[A-Za-z0-9._:,+@/-]+|COM[0-9]{1,3})(\?[a-z0-9_=&.-]*)?)$",
            max_length=256,
            description="`embedded` (emulated), tcp://, tls://, udp:// or rtu+tcp://HOST[:PORT], "
            "rtu:// or ascii:///dev/NAME?baud=RATE",
        ),
    ] = "embedded"
    vendor: Annotated[str, Field(max_length=64, description="who makes the device")] = ""
    model: Annotated[str, Field(max_length=64, description="model of the device")] = ""
    unit: Annotated[int, Field(ge=1, le=247, description="Modbus unit identifier")] = 1
    numbering: Annotated[
        Literal["zero", "one", "modicon"],
        Field(
            description="how `address` counts: from 0 as on the wire, from 1, or as 40001 "
            "(holding), 30001 (input), 10001 (discrete), 1 (coil)"
        ),
    ] = "zero"
    max_read_registers: Annotated[
        int, Field(ge=1, le=125, description="most registers that one request may read")
    ] = 125
    bridge_registers: Annotated[
        int,
        Field(
            ge=0,
            le=64,
            description="registers that are not listed and may be read with their neighbours, so "
            "that one request does for two",
        ),
    ] = 0
    min_gap_s: Annotated[
        NonNegative, Field(le=1.0, description="rest of the device between two requests, s")
    ] = 0.0
    reply_s: Annotated[
        NonNegative,
        Field(le=1.0, description="time that the device takes for a reply, the wire left out, s"),
    ] = 0.01
    refresh_hz: Annotated[
        PositiveFloat | None,
        Field(description="how often the device renews its values, Hz; none: with every request"),
    ] = None
    identify: Annotated[
        tuple[ModbusIdentify, ...],
        Field(description="values by which the device is known, checked before any write"),
    ] = ()
    init: Annotated[
        tuple[ModbusWrite, ...],
        Field(description="settings, written only where they differ: flash wears out"),
    ] = ()
    channels: Annotated[
        tuple[ModbusChannel, ...], Field(description="what is polled, in order")
    ] = ()
    output: Annotated[
        ModbusOutput | None, Field(description="[daq.output]: motor reference; none: no motion")
    ] = None
    serial: Annotated[
        SerialLine | None,
        Field(description="[daq.serial], for rtu:// and ascii:// only: the serial line"),
    ] = None
    tls: Annotated[
        TlsFiles | None, Field(description="[daq.tls], for tls:// only: the certificates")
    ] = None

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
