"""``[daq]`` of a LabJack of the T series."""

from __future__ import annotations

from typing import Literal

from pydantic import PositiveFloat

from hdbench.profile.acquiring import Acquisition, OutputChannel, Role
from hdbench.profile.tables import Table, item


class LabJackChannel(Table):
    """One channel of the scan list."""

    role: Role = item("what it measures")
    input: str = item(
        "AINn, or `quadrature` for the encoder lines of the model",
        pattern=r"^(AIN[0-9]{1,3}|quadrature)$",
    )
    negative: int | None = item("AIN of the negative side; none: single-ended", None, ge=0, le=249)
    range_v: PositiveFloat = item("input range +-, V", 10.0)
    scale: float = item("units of the role per volt; 1 except for a current, A/V", 1.0)

    @property
    def number(self) -> int:
        """N of AINn."""
        return int(self.input.removeprefix("AIN"))


class LabJackOutput(OutputChannel):
    """The motor reference and the drive's enable line."""

    output: str = item(
        "DACn (0 to 5 V) or TDACn of a LJTick-DAC (+-10 V)", pattern=r"^(DAC[01]|TDAC[0-9]{1,2})$"
    )
    enable_line: int = item("DIO of the drive's enable; the watchdog drops it", ge=0, le=22)
    enable_high: bool = item("whether a high line enables the drive", True)


class LabJackAcquisition(Acquisition):
    """A LabJack T4, T7 or T8 on Ethernet: control and stream."""

    driver: Literal["labjack-t"] = item("driver that speaks to the DAQ")
    address: str = item(
        "`embedded` (emulated) or tcp://HOST[:PORT], port 502 by default",
        "embedded",
        pattern=r"^(embedded|tcp://[A-Za-z0-9.-]+(:[0-9]{1,5})?)$",
    )
    stream_port: int | None = item(
        "TCP port of the stream; none: 200 above the other, as 702 is above 502",
        None,
        ge=1,
        le=65535,
    )
    model: Literal["T4", "T7", "T8"] = item("model that must answer", "T7")
    serial_number: int | None = item("serial number that must answer; none: any", None, ge=1)
    calibration: Literal["device", "nominal"] = item(
        "constants from words to volts: the device's own, or the data sheet's", "device"
    )
    auto_recover: bool = item(
        "after a full buffer: true goes on with a gap that is counted and marked, false ends the "
        "run",
        True,
    )
    watchdog_s: PositiveFloat = item(
        "host silence after which the enable drops, s, whole", 1.0, ge=1.0, le=5.0
    )
    channels: tuple[LabJackChannel, ...] = item("what is streamed, in order", min_length=1)
    output: LabJackOutput | None = item("[daq.output]: motor reference; none: no motion", None)
