"""``[daq]`` of the amplifier: its keys with unit, domain and meaning."""

from typing import Annotated, Literal

from pydantic import Field

from hdbench.profile.acquiring import Acquisition, Role


class BridgeTable(Acquisition):
    """A strain-gauge amplifier with ASCII commands on a serial port."""

    driver: Annotated[Literal["example-bridge"], Field(description="driver of the DAQ")]
    address: Annotated[
        str,
        Field(
            pattern=r"^(embedded|serial://(/dev/[A-Za-z0-9._/-]+|COM\d+)|socket://[\d.]+:\d+)$",
            description="`embedded`, serial:///dev/NAME, serial://COM3 or socket://NUMBER:PORT",
        ),
    ] = "embedded"
    baud_bd: Annotated[int, Field(ge=1200, le=921600, description="bit rate, bit/s")] = 115200
    channels: Annotated[tuple[Role], Field(description="its one input")] = ("torque",)
