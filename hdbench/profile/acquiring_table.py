"""What the tables of all drivers have in common."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, PositiveFloat

from hdbench.profile.tables import NonNegative, Table

__all__ = ["ROLES", "Acquisition", "OutputChannel", "Role", "SerialLine", "TlsFiles"]

Role = Literal["torque", "tacho", "current", "reference", "encoder"]
ROLES: tuple[Role, ...] = ("torque", "tacho", "current", "reference", "encoder")


class Acquisition(Table):
    """The DAQ: how it is reached and how it samples."""

    driver: Annotated[str, Field(description="driver that speaks to the DAQ")]
    address: Annotated[
        str,
        Field(
            min_length=1,
            max_length=256,
            description="`embedded` (simulated bench), tcp://HOST:PORT, tls://HOST:PORT, "
            "rtu:///dev/NAME and others; which of them depends on the driver",
        ),
    ] = "embedded"
    sample_period_s: Annotated[
        PositiveFloat, Field(ge=1e-4, le=1.0, description="sampling period, s")
    ]
    range_v: Annotated[PositiveFloat, Field(description="input range +-, V")] = 10.0
    resolution_bits: Annotated[int, Field(ge=8, le=24, description="ADC resolution, bit")] = 16
    watchdog_s: Annotated[
        PositiveFloat,
        Field(le=5.0, description="host silence after which the device zeroes the motor, s"),
    ] = 0.5
    deadline_s: Annotated[
        PositiveFloat, Field(le=2.0, description="longest wait for one reply, s")
    ] = 0.25
    verified: Annotated[
        Literal["none", "emulator", "hardware"],
        Field(description="what this table was tried on"),
    ] = "none"


class SerialLine(Table):
    """A serial line that carries Modbus RTU or ASCII."""

    baud_bd: Annotated[
        int, Field(ge=1200, le=4_000_000, description="bit rate of the line, bit/s")
    ] = 115200
    parity: Annotated[
        Literal["none", "even", "odd"], Field(description="parity; Modbus asks for even")
    ] = "even"
    stop_bits: Annotated[
        int, Field(ge=1, le=2, description="stop bits; two where there is no parity")
    ] = 1
    data_bits: Annotated[
        Literal[7, 8] | None,
        Field(description="data bits; left out: 8, of Modbus ASCII 7"),
    ] = None
    gap_s: Annotated[
        NonNegative | None,
        Field(
            le=1.0,
            description="silence between frames, s; left out: 3.5 characters, as up to 19200 "
            "bit/s the specification asks; above that it advises 1.75 ms",
        ),
    ] = None


class TlsFiles(Table):
    """Certificates of Modbus/TCP Security (``tls://HOST:802``)."""

    certificate: Annotated[str, Field(description="PEM file of this computer's certificate")]
    key: Annotated[str, Field(description="PEM file of its private key, mode 0600")]
    authority: Annotated[str, Field(description="PEM file of whoever signed the device's")]
    server_name: Annotated[
        str | None, Field(description="name in the device's certificate; left out: its host name")
    ] = None


class OutputChannel(Table):
    """The motor reference where the host writes it."""

    limit_v: Annotated[PositiveFloat, Field(description="largest motor reference, either sign, V")]
    update_s: Annotated[
        PositiveFloat,
        Field(ge=1e-3, le=1.0, description="time between two values of the reference, s"),
    ] = 0.01
    slew_v_per_s: Annotated[
        PositiveFloat, Field(description="fastest change of the reference, V/s")
    ] = 1000.0
