"""``[daq]`` of a DATAQ instrument with ASCII commands and a binary stream."""

from __future__ import annotations

from typing import Literal

from pydantic import PositiveFloat

from hdbench.profile.acquiring import Acquisition, Role
from hdbench.profile.tables import Table, item


class DataqChannel(Table):
    """One entry of the scan list."""

    role: Role = item("what it measures")
    input: str = item(
        "`analog N`; `counter` (DI3) for the encoder only, with one of its lines: the direction "
        "comes from the sign of the tacho",
        pattern=r"^(analog [0-7]|counter)$",
    )
    range_v: PositiveFloat = item("input range +-, V", 10.0)
    scale: float = item("units of the role per volt; 1 except for a current, A/V", 1.0)
    counts_per_edge: int = item(
        "of the counter: encoder counts per edge that it counts", 4, ge=1, le=4
    )

    @property
    def number(self) -> int:
        """N of `analog n`."""
        return int(self.input.removeprefix("analog "))


class DataqAcquisition(Acquisition):
    """A DATAQ instrument on its serial port; it has no analog output."""

    driver: Literal["dataq"] = item("driver that speaks to the DAQ")
    address: str = item(
        "`embedded` (emulated) or serial:///dev/NAME",
        "embedded",
        pattern=r"^(embedded|serial://(/[A-Za-z0-9._:,+@/-]+|COM[0-9]{1,3}))$",
    )
    model: Literal[
        "DI-1100", "DI-1110", "DI-1120", "DI-2008", "DI-2108", "DI-2108P", "DI-4108", "DI-4208",
        "DI-4718B",
    ] = item("model that must answer")  # fmt: skip
    serial_number: str | None = item(
        "serial number that must answer; none: any", None, pattern=r"^[0-9A-F]{8}$"
    )
    average: int = item(
        "conversions that the device averages to one sample; 1 takes every sample as it is. "
        "Averaging delays by half of its length",
        1,
        ge=1,
        le=512,
    )
    channels: tuple[DataqChannel, ...] = item("what is streamed, in order", min_length=1)
