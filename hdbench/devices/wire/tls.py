"""Modbus/TCP Security: TLS with a certificate on either side."""

from __future__ import annotations

import socket
import ssl
import stat
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Protocol

from hdbench.devices.wire.address import Address
from hdbench.errors import UsageError
from hdbench.system.files import is_private

__all__ = ["Certificates", "client_security"]


class Certificates(Protocol):
    """Paths of PEM files, and the name in the device's certificate where it is not the host's."""

    @property
    def certificate(self) -> str: ...  # noqa: D102
    @property
    def key(self) -> str: ...  # noqa: D102
    @property
    def authority(self) -> str: ...  # noqa: D102
    @property
    def server_name(self) -> str | None: ...  # noqa: D102


def client_security(
    address: Address, files: Certificates | None
) -> Callable[[socket.socket], ssl.SSLSocket]:
    """Return what wraps a connection to `address` in mutual TLS.

    Notes
    -----
    TLS 1.2 or newer, both certificates checked, as "MODBUS/TCP Security Protocol Specification"
    v36 (2021) asks. There is no way to switch the check off.
    """
    if files is None:
        raise UsageError(
            f"tls://{address.host} needs certificates; found none",
            where="key daq.tls",
            fix="add [daq.tls] with certificate, key and authority",
        )
    _check_key(Path(files.key))
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_verify_locations(files.authority)
    except (OSError, ValueError) as error:
        raise _unusable("authority", error) from error
    try:
        context.load_cert_chain(files.certificate, files.key)
    except (OSError, ValueError) as error:
        raise _unusable("certificate", error) from error
    return partial(context.wrap_socket, server_hostname=files.server_name or address.host)


def _unusable(name: str, error: Exception) -> UsageError:
    return UsageError(
        f"the {name} cannot be used ({error})",
        where=f"key daq.tls.{name}",
        fix="give the path of a PEM file that this user can read",
    )


def _check_key(path: Path) -> None:
    """Refuse a private key that others may read."""
    try:
        mode = path.stat().st_mode
    except OSError as error:
        raise UsageError(
            f"{path} cannot be read ({error.strerror})",
            where="key daq.tls.key",
            fix="give the path of the private key's PEM file",
        ) from error
    if not is_private(mode):
        raise UsageError(
            f"{path} has mode {stat.S_IMODE(mode):04o}; needed: 0600, nobody else may read it",
            where="key daq.tls.key",
            fix=f"chmod 600 {path}",
        )
