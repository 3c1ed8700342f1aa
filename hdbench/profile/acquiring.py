"""Tables of ``[daq]``: one per driver, told apart by the key ``driver``, and what is installed."""

from __future__ import annotations

import difflib
import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Annotated, Any, Literal, Union

from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    GetCoreSchemaHandler,
    PositiveFloat,
    Tag,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic_core import CoreSchema

from hdbench.profile.tables import Conflict, NonNegative, Table, item, refuse

Group = Literal["hdbench.drivers", "hdbench.tables"]
"""Entry points of drivers, and of the tables that describe their devices in a profile."""

BROKEN = (ImportError, AttributeError, TypeError, ValueError, SyntaxError)
"""What loading a package that does not fit may raise."""

# where the driver of a name is, and its table
_OWN = {
    "node": ("hdbench.devices.node.driver", "hdbench.profile.acquiring:NodeAcquisition"),
    "modbus": (
        "hdbench.devices.modbus.driver",
        "hdbench.profile.acquiring_modbus:ModbusAcquisition",
    ),
    "labjack-t": (
        "hdbench.drivers.labjack.driver",
        "hdbench.drivers.labjack.table:LabJackAcquisition",
    ),
    "dataq": ("hdbench.drivers.dataq.driver", "hdbench.drivers.dataq.table:DataqAcquisition"),
    "composite": ("hdbench.devices.composite", "hdbench.profile.acquiring:CompositeAcquisition"),
}
Role = Literal["torque", "tacho", "current", "reference", "encoder"]
ROLES: tuple[Role, ...] = ("torque", "tacho", "current", "reference", "encoder")
_TAG = "driver:"
_DEFAULT = "node"
_COMPOSITE = "composite"


def installed(group: Group) -> tuple[EntryPoint, ...]:
    """Return what is installed; hdbench's own first, so that nobody takes the name of one."""
    own = (_own(group, name) for name in _OWN)
    return (*own, *sorted(entry_points(group=group), key=lambda entry: entry.name))


def find(group: Group, name: str) -> EntryPoint | None:
    """Return what is installed under a name, None where there is nothing."""
    if name in _OWN:
        return _own(group, name)
    return next(iter(entry_points(group=group, name=name)), None)


def closest(name: str) -> tuple[str, str]:
    """Return which drivers are installed, and what to do where `name` is none of them."""
    names = list(dict.fromkeys(entry.name for entry in installed("hdbench.drivers")))
    near = difflib.get_close_matches(name, names, n=1)
    fix = f"did you mean {near[0]!r}?" if near else "install the package that brings this driver"
    return ", ".join(names), fix


def _own(group: Group, name: str) -> EntryPoint:
    module, table = _OWN[name]
    return EntryPoint(name, table if group == "hdbench.tables" else f"{module}:DRIVER", group)


class Acquisition(Table):
    """The DAQ: how it is reached and how it samples."""

    driver: str = item("driver that speaks to the DAQ")
    address: str = item(
        "`embedded` (simulated bench), tcp://HOST:PORT, tls://HOST:PORT, rtu:///dev/NAME and "
        "others; which of them depends on the driver",
        "embedded",
        min_length=1,
        max_length=256,
    )
    sample_period_s: PositiveFloat = item("sampling period, s", ge=1e-4, le=1.0)
    range_v: PositiveFloat = item("input range +-, V", 10.0)
    resolution_bits: int = item("ADC resolution, bit", 16, ge=8, le=24)
    watchdog_s: PositiveFloat = item(
        "host silence after which the device zeroes the motor, s", 0.5, le=5.0
    )
    deadline_s: PositiveFloat = item("longest wait for one reply, s", 0.25, le=2.0)
    verified: Literal["none", "emulator", "hardware"] = item("what this table was tried on", "none")

    @field_validator("driver")
    @classmethod
    def _installed(cls, driver: str) -> str:
        if find("hdbench.drivers", driver) is None:
            names, fix = closest(driver)
            refuse([Conflict((), f"names {driver!r}; installed: {names}", fix)])
        return driver

    @field_validator("deadline_s")
    @classmethod
    def _in_time(cls, deadline_s: float, info: ValidationInfo) -> float:
        watchdog_s = info.data.get("watchdog_s")
        if watchdog_s is not None and not deadline_s < watchdog_s:
            what = (
                f"found {deadline_s:g} s; needed: below daq.watchdog_s = {watchdog_s:g} s, "
                "or one late reply stops the motor"
            )
            refuse([Conflict((), what, "shorten daq.deadline_s")])
        return deadline_s

    @property
    def roles(self) -> tuple[Role, ...]:
        """Roles of the channels that are sampled, in order."""
        channels = getattr(self, "channels", ())
        return tuple(getattr(channel, "role", channel) for channel in channels)

    def part_tables(self) -> dict[str, Acquisition]:
        """Return the devices by their keys here: the one that samples first, that drives last."""
        return {"": self}

    def conflicts(self) -> Iterator[Conflict]:
        """Yield the keys of this table that do not go together."""
        roles = self.roles
        twice = sorted({role for role in roles if roles.count(role) > 1})
        if twice:
            yield Conflict(
                ("channels",),
                f"has {', '.join(twice)} more than once; needed: each role once",
                "take one of them out",
            )
        scheme = self.address.partition("://")[0]
        if scheme == "tls" and getattr(self, "tls", None) is None:
            yield Conflict(
                ("address",),
                "is tls://, but there is no [daq.tls]; needed: certificate, key, authority",
                "add [daq.tls], or use tcp:// on a network of its own",
            )
        for name, needed in (("serial", ("rtu", "ascii")), ("tls", ("tls",))):
            if getattr(self, name, None) is not None and scheme not in (*needed, "embedded"):
                yield Conflict(
                    (name,),
                    f"is for {':// and '.join(needed)}:// only; the address is {scheme}://",
                    "take the table out, or change the address",
                )


class SerialLine(Table):
    """A serial line that carries Modbus RTU or ASCII."""

    baud_bd: int = item("bit rate of the line, bit/s", 115200, ge=1200, le=4_000_000)
    parity: Literal["none", "even", "odd"] = item("parity; Modbus asks for even", "even")
    stop_bits: int = item("stop bits; two where there is no parity", 1, ge=1, le=2)
    data_bits: Literal[7, 8] | None = item("data bits; left out: 8, of Modbus ASCII 7", None)
    gap_s: NonNegative | None = item(
        "silence between frames, s; left out: 3.5 characters, as up to 19200 bit/s the "
        "specification asks; above that it advises 1.75 ms",
        None,
        le=1.0,
    )


class TlsFiles(Table):
    """Certificates of Modbus/TCP Security (``tls://HOST:802``)."""

    certificate: str = item("PEM file of this computer's certificate")
    key: str = item("PEM file of its private key, mode 0600")
    authority: str = item("PEM file of whoever signed the device's")
    server_name: str | None = item(
        "name in the device's certificate; left out: its host name", None
    )


class OutputChannel(Table):
    """The motor reference where the host writes it."""

    limit_v: PositiveFloat = item("largest motor reference, either sign, V")
    update_s: PositiveFloat = item(
        "time between two values of the reference, s", 0.01, ge=1e-3, le=1.0
    )
    slew_v_per_s: PositiveFloat = item("fastest change of the reference, V/s", 1000.0)


class NodeAcquisition(Acquisition):
    """A bench controller node on Modbus (docs/node-protocol.md)."""

    driver: Literal["node"] = item("driver that speaks to the DAQ", "node")
    address: str = item(
        "`embedded` (simulated bench), tcp://HOST:PORT, tls://HOST:PORT or "
        "rtu:///dev/NAME?baud=RATE",
        "embedded",
        pattern=r"^(embedded|(tcp|tls)://(\[[0-9A-Fa-f:.]+(%\w+)?\]|[A-Za-z0-9._-]+):[0-9]{1,5}"
        r"|rtu://(/[A-Za-z0-9._:,+@/-]+|COM[0-9]{1,3})(\?[a-z0-9_=&.-]*)?)$",
        max_length=256,
    )
    resolution_bits: int = item("ADC resolution, bit", 16, ge=8, le=16)
    watchdog_s: PositiveFloat = item(
        "host silence after which the node zeroes the motor, s", 0.5, le=2.0
    )
    channels: tuple[Role, ...] = item(
        "what is sampled; fewer channels let a slow serial line follow", ROLES, min_length=1
    )
    unit: int = item("Modbus unit identifier", 1, ge=1, le=247)
    serial: SerialLine | None = item("[daq.serial], for rtu:// only: the serial line", None)
    tls: TlsFiles | None = item("[daq.tls], for tls:// only: the certificates", None)


class PluginAcquisition(Acquisition):
    """A DAQ of another package that brings no table of its own."""

    driver: str = item(
        "name of the driver: an entry point of the group hdbench.drivers",
        pattern=r"^[a-z0-9][a-z0-9-]{0,31}$",
    )
    channels: tuple[Role, ...] = item("what is sampled, in order", ROLES, min_length=1)
    options: dict[str, str | int | float | bool] = item(
        "keys of that driver's own", default_factory=dict
    )

    @field_validator("driver")
    @classmethod
    def _loads(cls, driver: str) -> str:
        try:
            load_table(driver)
        except BROKEN as error:
            why = f"{type(error).__name__}: {error}"
            what = f"names {driver!r}, whose table cannot be loaded ({why})"
            refuse([Conflict((), what, "install the package of this driver again")])
        return driver


@functools.cache
def table_of(driver: str) -> type[Acquisition]:
    """Return the table of a driver."""
    try:
        return load_table(driver)
    except BROKEN:
        return PluginAcquisition


def load_table(driver: str) -> type[Acquisition]:
    """Return the table of a driver, or raise one of `BROKEN` where it cannot be loaded."""
    entry = find("hdbench.tables", driver)
    if entry is None:
        return PluginAcquisition
    table = entry.load()
    if not (isinstance(table, type) and issubclass(table, Acquisition)):
        raise TypeError(f"{entry.value} is no subclass of Acquisition")
    return table


@dataclass(frozen=True)
class ByDriver:
    """Marks a table whose keys depend on ``driver``.

    The tables are looked up when the first profile is checked, not on import: those of other
    packages import this module.
    """

    part: bool = False  # whether it is a part of a composite, and therefore no composite itself

    def tables(self) -> dict[str, type[Acquisition]]:
        """Return every table by the name of its driver."""
        names = dict.fromkeys(entry.name for entry in installed("hdbench.tables"))
        return {name: table_of(name) for name in names if not (self.part and name == _COMPOSITE)}

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Return the schema of all tables."""
        tables = {**self.tables(), "": PluginAcquisition}

        def tag(value: object) -> str:
            driver = value.get("driver", _DEFAULT) if isinstance(value, Mapping) else None
            if isinstance(value, BaseModel):
                driver = getattr(value, "driver", None)
            return f"{_TAG}{driver if isinstance(driver, str) and driver in tables else ''}"

        tagged = tuple(Annotated[table, Tag(_TAG + name)] for name, table in tables.items())
        return handler.generate_schema(Annotated[Union[tagged], Discriminator(tag)])  # noqa: UP007


AnyAcquisition = Annotated[Acquisition, ByDriver()]
_Part = Annotated[Acquisition, ByDriver(part=True)]


class CompositeAcquisition(Acquisition):
    """Inputs of one device and outputs of another, on one clock."""

    model_config = ConfigDict(defer_build=True)

    driver: Literal["composite"] = item("two devices that act as one")
    address: Literal["embedded", "parts"] = item(
        "`embedded` emulates both parts; `parts`: each part names its own", "parts"
    )
    channels: tuple[Role, ...] = item("what is sampled, in order", ROLES, min_length=1)
    inputs: _Part = item("table of the device that samples")
    outputs: _Part = item("table of the device that drives the motor; has the watchdog")
    max_skew_s: PositiveFloat = item(
        "largest doubt of an output's time on the input's clock, s", 0.02, le=1.0
    )

    @model_validator(mode="before")
    @classmethod
    def _one_period(cls, raw: Any) -> Any:
        """Give the parts the composite's sampling period where they name none."""
        if not isinstance(raw, Mapping) or "sample_period_s" not in raw:
            return raw
        period = {"sample_period_s": raw["sample_period_s"]}
        parts = {
            name: {**period, **raw[name]}
            for name in ("inputs", "outputs")
            if isinstance(raw.get(name), Mapping)
        }
        return {**raw, **parts}

    def part_tables(self) -> dict[str, Acquisition]:
        """Return the device that samples, then the one that drives."""
        return {"inputs": self.inputs, "outputs": self.outputs}

    def conflicts(self) -> Iterator[Conflict]:
        """Yield the keys of this table that do not go together."""
        yield from super().conflicts()
        for name, part in self.part_tables().items():
            if self.address != "embedded" and part.address == "embedded":
                yield Conflict(
                    (name, "address"),
                    'is missing; needed: where this device is, or address = "embedded" in [daq]',
                    "give its address",
                )


def driver_table(part: Any) -> type[Acquisition] | None:
    """Return the table that one part of pydantic's error location names, None for other parts."""
    if not isinstance(part, str) or not part.startswith(_TAG):
        return None
    return table_of(part.removeprefix(_TAG))
