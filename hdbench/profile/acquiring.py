"""Tables of ``[daq]``: one per driver, told apart by the key ``driver``."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Union

from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    GetCoreSchemaHandler,
    PositiveFloat,
    Tag,
    field_validator,
    model_validator,
)
from pydantic_core import CoreSchema

from hdbench.profile.acquiring_table import BROKEN, ROLES, Role, find, installed
from hdbench.profile.acquiring_table import Acquisition as Acquisition
from hdbench.profile.acquiring_table import NodeAcquisition as NodeAcquisition
from hdbench.profile.acquiring_table import OutputChannel as OutputChannel
from hdbench.profile.tables import Conflict, item, refuse

_TAG = "driver:"
_DEFAULT = "node"
_COMPOSITE = "composite"


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
