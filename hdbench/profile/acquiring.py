"""Tables of ``[daq]``: one per driver, told apart by the key ``driver``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Discriminator, Field, PositiveFloat, Tag, model_validator

from hdbench.profile.acquiring_dataq import DataqAcquisition
from hdbench.profile.acquiring_labjack import LabJackAcquisition
from hdbench.profile.acquiring_modbus import ModbusAcquisition
from hdbench.profile.acquiring_node import NodeAcquisition
from hdbench.profile.acquiring_table import (
    ROLES,
    Acquisition,
    OutputChannel,
    Role,
    SerialLine,
    TlsFiles,
)

__all__ = [
    "DRIVERS",
    "ROLES",
    "Acquisition",
    "AnyAcquisition",
    "CompositeAcquisition",
    "DataqAcquisition",
    "LabJackAcquisition",
    "ModbusAcquisition",
    "NodeAcquisition",
    "OutputChannel",
    "PluginAcquisition",
    "Role",
    "SerialLine",
    "TlsFiles",
    "driver_table",
]

_TAG = "driver:"
DEFAULT_DRIVER = "node"


class PluginAcquisition(Acquisition):
    """A DAQ whose driver comes with another package."""

    driver: Annotated[
        str,
        Field(
            pattern=r"^[a-z0-9][a-z0-9-]{0,31}$",
            description="name of the driver: an entry point of the group hdbench.drivers",
        ),
    ]
    channels: Annotated[
        tuple[Role, ...], Field(min_length=1, description="what is sampled, in order")
    ] = ROLES
    options: Annotated[
        dict[str, str | int | float | bool],
        Field(default_factory=dict, description="keys of that driver's own"),
    ]


def _tag(value: object) -> str:
    """Return the tag of the table that `value` is meant to be."""
    driver = value.get("driver", DEFAULT_DRIVER) if isinstance(value, Mapping) else None
    if isinstance(value, BaseModel):
        driver = getattr(value, "driver", DEFAULT_DRIVER)
    known = isinstance(driver, str) and driver in DRIVERS
    return f"{_TAG}{driver}" if known else f"{_TAG}plugin"


_Single = Annotated[
    Annotated[NodeAcquisition, Tag("driver:node")]
    | Annotated[ModbusAcquisition, Tag("driver:modbus")]
    | Annotated[LabJackAcquisition, Tag("driver:labjack-t")]
    | Annotated[DataqAcquisition, Tag("driver:dataq")]
    | Annotated[PluginAcquisition, Tag("driver:plugin")],
    Discriminator(lambda value: _part_tag(value)),
]


def _part_tag(value: object) -> str:
    tag = _tag(value)
    # a composite in a composite is taken for a driver that nobody has installed
    return f"{_TAG}plugin" if tag == f"{_TAG}composite" else tag


class CompositeAcquisition(Acquisition):
    """Inputs of one device and outputs of another, on one clock."""

    driver: Annotated[Literal["composite"], Field(description="two devices that act as one")]
    address: Annotated[
        Literal["embedded", "parts"],
        Field(description="`embedded` emulates both parts; `parts`: each part names its own"),
    ] = "parts"
    channels: Annotated[
        tuple[Role, ...], Field(min_length=1, description="what is sampled, in order")
    ] = ROLES
    inputs: Annotated[_Single, Field(description="table of the device that samples")]
    outputs: Annotated[
        _Single, Field(description="table of the device that drives the motor; has the watchdog")
    ]
    max_skew_s: Annotated[
        PositiveFloat,
        Field(le=1.0, description="largest doubt of an output's time on the input's clock, s"),
    ] = 0.02

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


DRIVERS: dict[str, type[Acquisition]] = {
    "node": NodeAcquisition,
    "modbus": ModbusAcquisition,
    "labjack-t": LabJackAcquisition,
    "dataq": DataqAcquisition,
    "composite": CompositeAcquisition,
}

AnyAcquisition = Annotated[
    Annotated[NodeAcquisition, Tag("driver:node")]
    | Annotated[ModbusAcquisition, Tag("driver:modbus")]
    | Annotated[LabJackAcquisition, Tag("driver:labjack-t")]
    | Annotated[DataqAcquisition, Tag("driver:dataq")]
    | Annotated[CompositeAcquisition, Tag("driver:composite")]
    | Annotated[PluginAcquisition, Tag("driver:plugin")],
    Discriminator(_tag),
]


def driver_table(part: Any) -> type[Acquisition] | None:
    """Return the table that one part of pydantic's error location names, None for other parts.

    Parameters
    ----------
    part : str or int
        Part of an error's ``loc``.

    Returns
    -------
    type of Acquisition or None
    """
    if not isinstance(part, str) or not part.startswith(_TAG):
        return None
    return DRIVERS.get(part.removeprefix(_TAG), PluginAcquisition)
