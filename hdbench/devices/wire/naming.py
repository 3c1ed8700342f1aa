"""Numbers of hosts in place of their names, asked for once before anything moves."""

from __future__ import annotations

import ipaddress
import queue
import re
import socket
import threading

from hdbench.errors import DeviceError

__all__ = ["NETWORK", "bracketed", "dial", "numbered"]

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


def numbered(address: str) -> str:
    """Return an address with the host's number in place of its name.

    Parameters
    ----------
    address : str
        Any address of a device.

    Returns
    -------
    str
        As it is where it names no host; of several numbers the first that takes a connection.

    Raises
    ------
    DeviceError
        If nobody knows the name, or the name servers do not answer in 6 s.
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

    Parameters
    ----------
    target : tuple of str and int
        Number of the host, and port.
    timeout_s : float
        Longest time, s.
    kind : SocketKind, optional
        A stream, or datagrams to and from this host alone.

    Returns
    -------
    socket.socket

    Raises
    ------
    OSError
        If there is none, or the host is a name.
    """
    found = socket.getaddrinfo(*target, type=kind, flags=socket.AI_NUMERICHOST)
    family, _, _, _, place = found[0]
    connection = socket.socket(family, kind)
    try:
        connection.settimeout(timeout_s)
        connection.connect(place)
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
