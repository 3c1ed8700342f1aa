"""One strict Modbus client for all drivers: TCP, TLS and serial lines."""

from __future__ import annotations

from hdbench.devices.wire.address import Address, dial, numbered, parse_address
from hdbench.devices.wire.link import (
    ExceptionReply,
    FrameError,
    Link,
    Probe,
    ReplyCheck,
    ReplyForm,
    Request,
    StaleReply,
    connect,
    exchange_registers,
    read_bits,
    read_registers,
    registers_check,
    write_bit,
    write_register,
    write_registers,
)

__all__ = [
    "Address",
    "ExceptionReply",
    "FrameError",
    "Link",
    "Probe",
    "ReplyCheck",
    "ReplyForm",
    "Request",
    "StaleReply",
    "connect",
    "dial",
    "exchange_registers",
    "numbered",
    "parse_address",
    "read_bits",
    "read_registers",
    "registers_check",
    "write_bit",
    "write_register",
    "write_registers",
]
