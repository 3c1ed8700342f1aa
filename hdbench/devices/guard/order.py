"""Order of the guard: what it sends to stop a motor and what must be read back, as plain data."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from hdbench.devices.driver import driver_of
from hdbench.devices.wire.address import Address
from hdbench.devices.wire.link import Request
from hdbench.profile.acquiring import TlsFiles
from hdbench.profile.schema import ProfileData
from hdbench.system.children import child_command

# how long the guard goes on trying after the session's end, s
_TRY_S = 60.0


@dataclass(frozen=True, slots=True)
class Check:
    """One value in a reply that must lie between two others.

    Parameters
    ----------
    name : str
        What it is, with its unit, for messages.
    at : int
        Offset in the reply's PDU, byte.
    form : str
        As `struct` takes it, such as ``>f``.
    low, high : float
        Both allowed.
    mask : int
        Bits that count, of an integer; 0 for all.
    order : tuple of int
        Which byte of the reply is the most significant, the next, and so on; empty: as they come.
    """

    name: str
    at: int
    form: str
    low: float
    high: float
    mask: int = 0
    order: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Look:
    """One read of the device.

    Parameters
    ----------
    request : Request
        Function code and data, and the form of its reply.
    checks : tuple of Check
        What its reply must hold; without any, in an identity: what it held before the motion.
    """

    request: Request
    checks: tuple[Check, ...] = ()


@dataclass(frozen=True, slots=True)
class Target:
    """One device.

    Parameters
    ----------
    place : mapping
        Wire and address, as `target_at` gives them.
    acts : tuple of Request
        Requests that stop the motor; each may be sent again and again.
    looks : tuple of Look
        Reads that prove it.
    identity : tuple of Look
        Reads that tell the device from another one.
    finals : tuple of Request
        Requests that disable the drive once the motor stands, or has had 1 s to brake.
    final_looks : tuple of Look
        Reads that prove that.
    brake_s : float
        Time that the drive gets in any case before it is disabled, s.
    """

    place: dict[str, Any]
    acts: tuple[Request, ...]
    looks: tuple[Look, ...]
    identity: tuple[Look, ...]
    finals: tuple[Request, ...] = ()
    final_looks: tuple[Look, ...] = ()
    brake_s: float = 0.0


@dataclass(frozen=True, slots=True)
class GuardOrder:
    """What the guard is to do.

    Parameters
    ----------
    targets : tuple of Target
        Devices to make safe; empty where the driver itself has to do it.
    command : tuple of str
        Command that makes the bench safe through its driver, in place of `targets`.
    stdin : str
        What that command reads.
    try_s : float
        How long it goes on trying after the session's end, s.
    """

    targets: tuple[Target, ...] = ()
    command: tuple[str, ...] = ()
    stdin: str = ""
    try_s: float = _TRY_S


def as_json(order: GuardOrder | Target, **more: object) -> str:
    """Return an order as the guard reads it, bytes as hexadecimal digits."""
    return json.dumps({**asdict(order), **more}, default=bytes.hex)


def target_at(
    address: Address, unit: int, tls: TlsFiles | None = None, *, rest_s: float = 0.0
) -> dict[str, Any]:
    """Return where a device is."""
    place: dict[str, Any] = {**asdict(address), "unit": unit, "rest_s": rest_s, "tls": None}
    if address.scheme == "tls" and tls is not None:
        place["tls"] = {
            "certificate": str(Path(tls.certificate).absolute()),
            "key": str(Path(tls.key).absolute()),
            "authority": str(Path(tls.authority).absolute()),
            "server_name": tls.server_name,
        }
    return place


def order_of(profile: ProfileData) -> GuardOrder:
    """Return what the guard of a bench is to do.

    Parameters
    ----------
    profile : ProfileData
        The bench, its addresses as they are in use.

    Returns
    -------
    GuardOrder
        The bytes themselves where the driver gives them; else a command that stops the bench
        through its driver, which takes as long as the libraries need to load.
    """
    *_, driving = profile.daq.part_tables().values()
    target = driver_of(driving.driver).stop_target(profile, driving)
    if target is None:
        command = child_command("hdbench.devices.guard")
        return GuardOrder(command=command, stdin=profile.model_dump_json(exclude_none=True))
    return GuardOrder(targets=(target,))
