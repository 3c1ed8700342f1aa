"""``[daq]`` of a LabJack of the T series."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, PositiveFloat

from hdbench.profile.acquiring_table import Acquisition, OutputChannel, Role
from hdbench.profile.tables import Table


class LabJackChannel(Table):
    """One channel of the scan list."""

    role: Role = Field(description="what it measures")
    input: str = Field(
        pattern=r"^(AIN[0-9]{1,3}|quadrature)$",
        description="AINn, or `quadrature` for the encoder lines of the model",
    )
    negative: int | None = Field(
        default=None, ge=0, le=249, description="AIN of the negative side; none: single-ended"
    )
    range_v: PositiveFloat = Field(default=10.0, description="input range +-, V")
    scale: float = Field(
        default=1.0, description="units of the role per volt; 1 except for a current, A/V"
    )

    @property
    def number(self) -> int:
        """N of AINn."""
        return int(self.input.removeprefix("AIN"))


class LabJackOutput(OutputChannel):
    """The motor reference and the drive's enable line."""

    output: str = Field(
        pattern=r"^(DAC[01]|TDAC[0-9]{1,2})$",
        description="DACn (0 to 5 V) or TDACn of a LJTick-DAC (+-10 V)",
    )
    enable_line: int = Field(
        ge=0, le=22, description="DIO of the drive's enable; the watchdog drops it"
    )
    enable_high: bool = Field(default=True, description="whether a high line enables the drive")


class LabJackAcquisition(Acquisition):
    """A LabJack T4, T7 or T8 on Ethernet: control and stream."""

    driver: Literal["labjack-t"] = Field(description="driver that speaks to the DAQ")
    address: str = Field(
        default="embedded",
        pattern=r"^(embedded|tcp://[A-Za-z0-9.-]+(:[0-9]{1,5})?)$",
        description="`embedded` (emulated) or tcp://HOST[:PORT], port 502 by default",
    )
    stream_port: int | None = Field(
        default=None,
        ge=1,
        le=65535,
        description="TCP port of the stream; none: 200 above the other, as 702 is above 502",
    )
    model: Literal["T4", "T7", "T8"] = Field(default="T7", description="model that must answer")
    serial_number: int | None = Field(
        default=None, ge=1, description="serial number that must answer; none: any"
    )
    calibration: Literal["device", "nominal"] = Field(
        default="device",
        description="constants from words to volts: the device's own, or the data sheet's",
    )
    auto_recover: bool = Field(
        default=True,
        description="after a full buffer: true goes on with a gap that is counted and marked, "
        "false ends the run",
    )
    watchdog_s: PositiveFloat = Field(
        default=1.0,
        ge=1.0,
        le=5.0,
        description="host silence after which the enable drops, s, whole",
    )
    channels: tuple[LabJackChannel, ...] = Field(
        min_length=1, description="what is streamed, in order"
    )
    output: LabJackOutput | None = Field(
        default=None, description="[daq.output]: motor reference; none: no motion"
    )
