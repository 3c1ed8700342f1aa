"""``[daq]`` of a bench controller node."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, PositiveFloat

from hdbench.profile.acquiring_table import ROLES, Acquisition, Role, SerialLine, TlsFiles

__all__ = ["NodeAcquisition"]


class NodeAcquisition(Acquisition):
    """A bench controller node on Modbus (docs/node-protocol.md)."""

    driver: Annotated[Literal["node"], Field(description="driver that speaks to the DAQ")] = "node"
    address: Annotated[
        str,
        Field(
            pattern=r"^(embedded|(tcp|tls)://(\[[0-9A-Fa-f:.]+(%\w+)?\]|[A-Za-z0-9._-]+):[0-9]{1,5}"
            r"|rtu://(/[A-Za-z0-9._:,+@/-]+|COM[0-9]{1,3})(\?[a-z0-9_=&.-]*)?)$",
            max_length=256,
            description="`embedded` (simulated bench), tcp://HOST:PORT, tls://HOST:PORT or "
            "rtu:///dev/NAME?baud=RATE",
        ),
    ] = "embedded"
    resolution_bits: Annotated[int, Field(ge=8, le=16, description="ADC resolution, bit")] = 16
    watchdog_s: Annotated[
        PositiveFloat,
        Field(le=2.0, description="host silence after which the node zeroes the motor, s"),
    ] = 0.5
    channels: Annotated[
        tuple[Role, ...],
        Field(
            min_length=1,
            description="what is sampled; fewer channels let a slow serial line follow",
        ),
    ] = ROLES
    unit: Annotated[int, Field(ge=1, le=247, description="Modbus unit identifier")] = 1
    serial: Annotated[
        SerialLine | None, Field(description="[daq.serial], for rtu:// only: the serial line")
    ] = None
    tls: Annotated[
        TlsFiles | None, Field(description="[daq.tls], for tls:// only: the certificates")
    ] = None
