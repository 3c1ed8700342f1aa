"""``[daq]`` of a DATAQ instrument with ASCII commands and a binary stream."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, PositiveFloat

from hdbench.profile.acquiring_table import Acquisition, Role
from hdbench.profile.tables import Table


class DataqChannel(Table):
    """One entry of the scan list."""

    role: Role = Field(description="what it measures")
    input: str = Field(
        pattern=r"^(analog [0-7]|counter)$",
        description="`analog N`; `counter` (DI3) for the encoder only, with one of its lines: the "
        "direction comes from the sign of the tacho",
    )
    range_v: PositiveFloat = Field(default=10.0, description="input range +-, V")
    scale: float = Field(
        default=1.0, description="units of the role per volt; 1 except for a current, A/V"
    )
    counts_per_edge: int = Field(
        default=4,
        ge=1,
        le=4,
        description="of the counter: encoder counts per edge that it counts",
    )

    @property
    def number(self) -> int:
        """N of `analog n`."""
        return int(self.input.removeprefix("analog "))


class DataqAcquisition(Acquisition):
    """A DATAQ instrument on its serial port; it has no analog output."""

    driver: Literal["dataq"] = Field(description="driver that speaks to the DAQ")
    address: str = Field(
        default="embedded",
        pattern=r"^(embedded|serial://(/[A-Za-z0-9._:,+@/-]+|COM[0-9]{1,3}))$",
        description="`embedded` (emulated) or serial:///dev/NAME",
    )
    model: Literal[
        "DI-1100", "DI-1110", "DI-1120", "DI-2008", "DI-2108", "DI-2108P", "DI-4108", "DI-4208",
        "DI-4718B",
    ] = Field(description="model that must answer")  # fmt: skip
    serial_number: str | None = Field(
        default=None,
        pattern=r"^[0-9A-F]{8}$",
        description="serial number that must answer; none: any",
    )
    average: int = Field(
        default=1,
        ge=1,
        le=512,
        description="conversions that the device averages to one sample; 1 takes every sample as "
        "it is. Averaging delays by half of its length",
    )
    channels: tuple[DataqChannel, ...] = Field(
        min_length=1, description="what is streamed, in order"
    )
