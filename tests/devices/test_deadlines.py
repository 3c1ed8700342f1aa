"""A deadline is a moment on the clock: nothing that is tried within it begins it anew."""

import socket
import time

import pytest
from nodekit import ManualClock

from hdbench.devices.node.registers import LIMITS, register
from hdbench.devices.node.wire import NodeWire
from hdbench.devices.wire import ExceptionReply, FrameError, connect, parse_address, read_registers
from hdbench.errors import DeviceError

DEADLINE_S = 0.2


class RefusingLink:
    """Refuses every request after a time, and notes until when it might have taken."""

    where = "nowhere"
    opened = None

    def __init__(self, clock, takes_s):
        self.clock = clock
        self.takes_s = takes_s
        self.untils_s = []

    def transact(self, pdu, check, until_s):
        self.untils_s.append(until_s)
        self.clock.sleep(min(self.takes_s, until_s - self.clock.now_s))
        if not self.clock.now_s < until_s:
            raise FrameError("no valid reply in time")
        raise ExceptionReply(2)

    def close(self):
        pass


@pytest.mark.parametrize(
    "call",
    [lambda wire: wire.read(LIMITS), lambda wire: wire.write_once((register("command"),), b"\0\1")],
    ids=["read", "write"],
)
def test_the_reason_of_a_refusal_is_asked_for_in_what_is_left(call):
    clock = ManualClock()
    link = RefusingLink(clock, 0.45 * DEADLINE_S)
    wire = NodeWire(link, deadline_s=DEADLINE_S, clock=clock)
    start_s = clock.now_s
    with pytest.raises(DeviceError, match="refused"):
        call(wire)
    assert len(link.untils_s) == 2, "the request, and why it was refused"
    assert max(link.untils_s) <= start_s + DEADLINE_S + 1e-9
    assert clock.now_s <= start_s + DEADLINE_S + 1e-9


def test_all_addresses_of_a_host_share_one_deadline(monkeypatch):
    """As long as the first of them does not answer, the others have what it leaves."""
    tried = []

    def unanswered(connection, place):
        tried.append(connection.gettimeout())
        time.sleep(min(connection.gettimeout(), 0.15))
        raise TimeoutError

    places = [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (f"127.0.0.{n}", 9)) for n in (2, 3, 4)]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: places)
    monkeypatch.setattr(socket.socket, "connect", unanswered)
    link = connect(parse_address("tcp://bench:502"))
    start_s = time.monotonic()
    with pytest.raises(FrameError, match="time"):
        link.transact(*read_registers(0, 1), start_s + DEADLINE_S)
    # the scheduler
    assert time.monotonic() - start_s < DEADLINE_S + 0.1
    assert len(tried) == 2
    assert tried[1] <= DEADLINE_S - 0.15
