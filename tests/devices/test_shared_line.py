"""A stop on a serial line that another host has not left yet: its guard, or its late replies."""

import os
import sys
import threading

import pytest
from faults import replies
from faults.lines import emulated
from serial import Serial

from hdbench.devices import stop_bench
from hdbench.devices.emulator.node import build_core
from hdbench.devices.guard.process.stopping import Wire
from hdbench.devices.node import registers as reg
from hdbench.devices.node.access import span
from hdbench.devices.wire.link import read_registers
from hdbench.errors import BusyError, DeviceError
from hdbench.system.lines import open_port

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


def test_a_guard_whose_session_is_dead_has_the_line_for_itself_while_it_works():
    near, far = os.openpty()
    path = os.ttyname(far)
    place = {
        "scheme": "rtu", "path": path, "host": "", "port": 0, "unit": 1, "rest_s": 0.0, "tls": None,
        "serial": {"baud_bd": 115200, "parity": "N", "stop_bits": 1, "gap_s": None},
    }  # fmt: skip
    wire = Wire(place, alone=True)
    try:
        # nobody answers, and the port stays open
        with pytest.raises(Exception, match="no valid reply"):
            wire.transact(("0300000001", {"head": "0302", "size": 4, "spare_bits": 0}))
        with pytest.raises(BusyError):
            open_port(path, path, baud_bd=115200)
        wire.close()
        open_port(path, path, baud_bd=115200).close()
    finally:
        wire.close()
        os.close(near)
        os.close(far)
