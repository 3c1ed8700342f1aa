"""``[daq]`` of a LabJack of the T series."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, PositiveFloat

from hdbench.profile.acquiring_table import Acquisition, OutputChannel, Role
from hdbench.profile.tables import Table


class LabJackChannel(Table):
    """One channel of the scan list."""

    role: Annotated[Role, Field(description="what it measures")]
    input: Annotated[
        str,
        Field(
            pattern=r"^(AIN[0-9]{1,3}|quadrature)$",
            description="AINn, or `quadrature` for the encoder lines of the model",
        ),
    ]
    negative: Annotated[
        int | None, Field(ge=0, le=249, description="AIN of the negative side; none: single-ended")
    ] = None
    range_v: Annotated[PositiveFloat, Field(description="input range +-, V")] = 10.0
    scale: Annotated[
        float, Field(description="units of the role per volt; 1 except for a current, A/V")
    ] = 1.0

    @property
    def number(self) -> int:
        """N of AINn."""
        return int(self.input.removeprefix("AIN"))


class LabJackOutput(OutputChannel):
    """The motor reference and the drive's enable line."""

    output: Annotated[
        str,
        Field(
            pattern=r"^(DAC[01]|TDAC[0-9]{1,2})$",
            description="DACn (0 to 5 V) or TDACn of a LJTick-DAC (+-10 V)",
        ),
    ]
    enable_line: Annotated[
        int, Field(ge=0, le=22, description="DIO of the drive's enable; the watchdog drops it")
    ]
    enable_high: Annotated[bool, Field(description="whether a high line enables the drive")] = True


class LabJackAcquisition(Acquisition):
    """A LabJack T4, T7 or T8 on Ethernet: control and stream."""

    driver: Annotated[Literal["labjack-t"], Field(description="driver that speaks to the DAQ")]
    address: Annotated[
        str,
        Field(
            pattern=r"^(embedded|tcp://[A-Za-z0-9.-]+(:[0-9]{1,5})?)$",
            description="`embedded` (emulated) or tcp://HOST[:PORT], port 502 by default",
        ),
    ] = "embedded"
    stream_port: Annotated[
        int | None,
        Field(
            ge=1,
            le=65535,
            description="TCP port of the stream; none: 200 above the other, as 702 is above 502",
        ),
    ] = None
    model: Annotated[Literal["T4", "T7", "T8"], Field(description="model that must answer")] = "T7"
    serial_number: Annotated[
        int | None, Field(ge=1, description="serial number that must answer; none: any")
    ] = None
    calibration: Annotated[
        Literal["device", "nominal"],
        Field(description="constants from words to volts: the device's own, or the data sheet's"),
    ] = "device"
    auto_recover: Annotated[
        bool,
        Field(
            description="after a full buffer: true goes on with a gap that is counted and marked, "
            "false ends the run"
        ),
    ] = True
    watchdog_s: Annotated[
        PositiveFloat,
        Field(ge=1.0, le=5.0, description="host silence after which the enable drops, s, whole"),
    ] = 1.0
    channels: Annotated[
        tuple[LabJackChannel, ...], Field(min_length=1, description="what is streamed, in order")
    ]
    output: Annotated[
        LabJackOutput | None, Field(description="[daq.output]: motor reference; none: no motion")
    ] = None
