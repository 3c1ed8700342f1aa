"""A stop on a serial line that another host has not left yet: its guard, or its late replies."""

import sys
import threading

import pytest
from faults import replies
from faults.lines import emulated
from serial import Serial

from hdbench.devices import stop_bench
from hdbench.devices.emulator.node import build_core
from hdbench.devices.node import registers as reg
from hdbench.devices.node.access import span
from hdbench.devices.wire.link import read_registers
from hdbench.errors import DeviceError

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")

# the guard's look at a node: 52 bytes, which no read of the stop has
STATUS = read_registers(*span(reg.STATUS))[0]


def _served(strange):
    """Serve a node whose first replies are those to another host's questions."""
    core = build_core(replies.CountingBench(), replies.PROFILE, 0, pace="fast")
    answer, left = core.answer, iter(range(strange))

    def late(pdu, connection, transaction=0):
        return answer(pdu if next(left, None) is None else STATUS, connection, transaction)

    core.answer = late
    return emulated(core, "rtu")


def test_a_stop_waits_past_the_late_replies_of_another_host():
    with _served(strange=12) as address:
        assert stop_bench(replies.PROFILE, address=address).confirmed


def test_a_stop_on_a_line_where_nobody_else_ever_ends_says_so_in_time(monkeypatch):
    monkeypatch.setattr("hdbench.devices.opening._OTHERS_S", 0.5)
    with (
        _served(strange=10_000) as address,
        pytest.raises(DeviceError, match="a reply of 52 bytes"),
    ):
        stop_bench(replies.PROFILE, address=address)


def test_a_stop_waits_for_a_guard_that_has_the_line():
    with _served(strange=0) as address:
        other = Serial(address.removeprefix("rtu://"), timeout=0, exclusive=True)
        leaves = threading.Timer(0.5, other.close)
        leaves.start()
        assert stop_bench(replies.PROFILE, address=address).confirmed
        leaves.join()


def test_a_port_that_is_not_there_is_told_at_once(monkeypatch):
    monkeypatch.setattr("hdbench.devices.opening._OTHERS_S", 600.0)
    with pytest.raises(DeviceError, match="serial port failed"):
        stop_bench(replies.PROFILE, address="rtu:///dev/no-such-port")
