"""Addresses of devices, and numbers of hosts in place of their names."""

from __future__ import annotations

import ipaddress
import queue
import re
import socket
import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal
from urllib.parse import parse_qsl

from hdbench.errors import DeviceError, UsageError
from hdbench.system.lines import is_port

if TYPE_CHECKING:
    from hdbench.profile.acquiring import Acquisition, SerialLine

NETWORK = re.compile(
    r"(?P<scheme>tcp|tls|udp|rtu\+tcp)://(?P<host>\[[0-9A-Fa-f:.]+(?:%\w+)?\]|[A-Za-z0-9._-]+)"
    r"(?::(?P<port>[^:/?\[\]]*))?"
)
"""An address on the network: a host name, an IPv4 address, or an IPv6 address in brackets."""

# name servers are asked one after the other, 5 s each: one of them may be down
_LONGEST_S = 6.0
# of several numbers of one name, each has so long to take a connection
_TRY_S = 1.0
_PORT = 502
_PARITIES = {"none": "N", "even": "E", "odd": "O", "n": "N", "e": "E", "o": "O"}
_FIX = (
    "for example tcp://192.168.0.7:502, tls://bench-7:802, rtu:///dev/ttyUSB0?baud=115200 or, on "
    "Windows, rtu://COM3?baud=115200"
)
Scheme = Literal["tcp", "tls", "udp", "rtu+tcp", "rtu", "ascii"]
_NETWORKS: dict[str, Scheme] = {name: name for name in ("tcp", "tls", "udp", "rtu+tcp")}
# Modbus over Serial Line V1.02, 2.5: a character of the ASCII form has seven bits
_LINES: dict[str, Scheme] = {"rtu": "rtu", "ascii": "ascii"}
_DATA_BITS = {"rtu": 8, "ascii": 7}
# 1.75 ms, which the specification advises above 19200 bit/s, is for hosts that cannot time less
_GAP_CHARACTERS = 3.5


def numbered(address: str) -> str:
    """Return an address with the host's number in place of its name, if it names a host.

    Of several numbers it is the first that takes a connection.
    """
    found = NETWORK.fullmatch(address)
    port = "" if found is None else found["port"] or str(_PORT)
    # what is no address is refused by its driver
    if found is None or not re.fullmatch("[0-9]{1,5}", port):
        return address
    number = bracketed(_number(found["host"].strip("[]"), int(port), address))
    return f"{found['scheme']}://{number}{address[found.end('host') :]}"


def dial(
    target: tuple[str, int], timeout_s: float, kind: socket.SocketKind = socket.SOCK_STREAM
) -> socket.socket:
    """Return a connection to a host that is given by its number: no name server is waited for.

    It is a stream, or of datagrams to and from this host alone.
    """
    found = socket.getaddrinfo(*target, type=kind, flags=socket.AI_NUMERICHOST)
    family, _, _, _, place = found[0]
    connection = socket.socket(family, kind)
    try:
        connection.settimeout(timeout_s)
        connection.connect(place)
        if kind == socket.SOCK_STREAM:
            # a request is sent at once
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    except OSError:
        connection.close()
        raise
    return connection


def bracketed(host: str) -> str:
    """Return a host as it stands in an address: IPv6 in brackets."""
    return f"[{host}]" if ":" in host else host


def _number(host: str, port: int, address: str) -> str:
    try:
        return _shortest(host)
    except ValueError:
        numbers = _asked(host, port, address)
    if len(numbers) > 1:
        numbers = [one for one in numbers if _answers(one, port)] or numbers
    return numbers[0]


def _shortest(number: str) -> str:
    found = ipaddress.ip_address(number)
    return str(getattr(found, "ipv4_mapped", None) or found)


def _asked(host: str, port: int, address: str) -> list[str]:
    """Return the numbers of a host, each once, in the resolver's order."""
    answers: queue.SimpleQueue[list[str] | OSError] = queue.SimpleQueue()

    def ask() -> None:
        try:
            places = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
            answers.put(list(dict.fromkeys(_shortest(str(place[4][0])) for place in places)))
        except (OSError, ValueError) as error:
            answers.put(error if isinstance(error, OSError) else OSError(0, str(error)))

    # the system's resolver has no time limit of its own that holds
    threading.Thread(target=ask, daemon=True).start()
    try:
        answer = answers.get(timeout=_LONGEST_S)
    except queue.Empty:
        answer = OSError(0, f"no answer from the name servers in {_LONGEST_S:g} s")
    if isinstance(answer, OSError):
        raise DeviceError(
            f"the host name {host!r} is not known ({answer.strerror or answer})",
            where=address,
            fix="correct the name, or give the host's number, for example tcp://192.168.0.7:502",
        ) from answer
    return answer


def _answers(number: str, port: int) -> bool:
    try:
        dial((number, port), _TRY_S).close()
    except OSError:
        return False
    return True


@dataclass(frozen=True, slots=True)
class SerialSettings:
    """A serial line.

    Parameters
    ----------
    baud_bd : int
        Bit rate, bit/s.
    parity : {"N", "E", "O"}
        Parity.
    stop_bits : int
        1 or 2.
    gap_s : float or None
        Silence between frames, s; None for 3.5 characters.
    data_bits : int or None
        Of a character; None for what the form of Modbus asks for: 8, of ASCII 7.
    """

    baud_bd: int = 115200
    parity: str = "E"
    stop_bits: int = 1
    gap_s: float | None = None
    data_bits: int | None = None

    @property
    def character_s(self) -> float:
        """Time of one character on the wire, s: start, data, parity, stop bits."""
        bits = 1 + (self.data_bits or 8) + (self.parity != "N") + self.stop_bits
        return bits / self.baud_bd

    @property
    def silence_s(self) -> float:
        """Silence between frames, s."""
        return _GAP_CHARACTERS * self.character_s if self.gap_s is None else self.gap_s

    def exchange_s(self, sent: int, received: int) -> float:
        """Return the shortest time of one exchange, s: characters and the silence around them."""
        return (sent + received) * self.character_s + 2.0 * self.silence_s


@dataclass(frozen=True, slots=True)
class Address:
    """A parsed address.

    Parameters
    ----------
    scheme : {"tcp", "tls", "udp", "rtu+tcp", "rtu", "ascii"}
        What is spoken.
    host : str
        Host name or address; empty for a serial line.
    port : int
        TCP or UDP port; 0 for a serial line.
    path : str
        Serial port; empty for a network.
    serial : SerialSettings
        Settings of a serial line.
    """

    scheme: Scheme
    host: str = ""
    port: int = 0
    path: str = ""
    serial: SerialSettings = SerialSettings()

    @property
    def is_line(self) -> bool:
        """Whether it is a serial port of this computer."""
        return self.scheme in _LINES

    @property
    def is_numbered(self) -> bool:
        """Whether every reply carries the number of its request."""
        return self.scheme in ("tcp", "tls", "udp")

    def __str__(self) -> str:
        """Return the address in its shortest form."""
        if self.is_line:
            return f"{self.scheme}://{self.path}"
        return f"{self.scheme}://{bracketed(self.host)}:{self.port}"


def serial_settings(line: SerialLine) -> SerialSettings:
    """Return the settings that ``[daq.serial]`` of a profile gives."""
    return SerialSettings(
        line.baud_bd, _PARITIES[line.parity], line.stop_bits, line.gap_s, line.data_bits
    )


def address_of(table: Acquisition, *, default_port: int | None = None) -> Address:
    """Return the address of a table, with the settings of its serial line."""
    line: SerialLine | None = getattr(table, "serial", None)
    given = None if line is None else serial_settings(line)
    return parse_address(table.address, given, default_port=default_port)


def parse_address(
    address: str, serial: SerialSettings | None = None, *, default_port: int | None = None
) -> Address:
    """Return the parts of an address.

    It is ``tcp://``, ``tls://``, ``udp://`` or ``rtu+tcp://HOST:PORT`` (IPv6 in brackets), or
    ``rtu://`` or ``ascii:///dev/NAME[?KEY=VALUE&...]`` (on Windows ``rtu://COM3``) with the keys
    ``baud``, ``parity`` (``none``, ``even``, ``odd``), ``stop``, ``bits`` and ``gap_us``. `serial`
    and `default_port` hold where the address does not say; without the latter it must.
    """
    scheme, _, rest = address.partition("://")
    if scheme in _LINES:
        return _serial(address, _LINES[scheme], rest, serial or SerialSettings())
    if scheme not in _NETWORKS:
        raise _bad(address, "needed: tcp://HOST:PORT, tls://HOST:PORT or rtu:///dev/NAME")
    found = NETWORK.fullmatch(address)
    if found is None:
        raise _bad(
            address, "needed: tcp://HOST:PORT with a host name, an IPv4 address or [an IPv6 one]"
        )
    port = str(default_port or 0) if found["port"] is None else found["port"]
    if not re.fullmatch("[0-9]{1,5}", port) or not 0 < int(port) < 65536:
        raise _bad(address, "needed: tcp://HOST:PORT with a port from 1 to 65535")
    return Address(_NETWORKS[scheme], found["host"].strip("[]"), int(port))


def _serial(address: str, scheme: Scheme, rest: str, given: SerialSettings) -> Address:
    path, _, query = rest.partition("?")
    if not is_port(path):
        raise _bad(
            address, f"needed: a serial port after {scheme}://, such as /dev/ttyUSB0 or COM3"
        )
    values: dict[str, str] = dict(parse_qsl(query, keep_blank_values=True))
    unknown = sorted(set(values) - {"baud", "parity", "stop", "bits", "gap_us"})
    if unknown:
        raise _bad(address, f"{unknown[0]!r} is no key; known: baud, parity, stop, bits, gap_us")
    parity = values.get("parity", "").lower()
    if parity and parity not in _PARITIES:
        raise _bad(address, f"parity {parity!r}; needed: none, even or odd")
    gap_us = _whole(address, values, "gap_us", (0, 1_000_000))
    settings = SerialSettings(
        _whole(address, values, "baud", (1200, 4_000_000)) or given.baud_bd,
        _PARITIES[parity] if parity else given.parity,
        _whole(address, values, "stop", (1, 2)) or given.stop_bits,
        given.gap_s if gap_us is None else gap_us / 1e6,
        _whole(address, values, "bits", (7, 8)) or given.data_bits or _DATA_BITS[scheme],
    )
    if settings.data_bits != 8 and scheme == "rtu":
        raise _bad(address, "bits 7; RTU needs 8")
    return Address(scheme, path=path, serial=settings)


def _whole(address: str, values: dict[str, str], key: str, ends: tuple[int, int]) -> int | None:
    text = values.get(key)
    if text is None:
        return None
    low, high = ends
    # seven digits hold every range above
    if not re.fullmatch(r"[0-9]{1,7}", text) or not low <= int(text) <= high:
        raise _bad(address, f"{key} {text[:20]!r}; needed: a whole number from {low} to {high}")
    return int(text)


def _bad(address: str, what: str) -> UsageError:
    return UsageError(
        f"{address[:80]!r} is no address of a device; {what}", where="address", fix=_FIX
    )
