"""Anybody can stop any bench, with or without a run on it, on a line that another host has."""

import threading
from contextlib import closing, contextmanager

import pytest
from changing import with_keys
from faults import lines, replies
from nodekit import realtime_emulator
from serial import Serial
from served import WAVE, begin, read_samples

from hdbench.devices import AcquisitionSettings, open_bench, opening, stop_bench
from hdbench.devices.driver import open_daq
from hdbench.devices.emulator.node import build_core
from hdbench.devices.node import registers as reg
from hdbench.devices.node.access import span
from hdbench.devices.wire.link import read_registers
from hdbench.errors import BusyError, DeviceError, UsageError
from hdbench.profile import load_profile


@contextmanager
def emulated(name):
    """Emulate a bench in real time; yields its profile, patient as it may be."""
    data = load_profile(name).data
    with realtime_emulator(data) as found:
        yield opening._at(data, found, deadline_s=0.9)


@pytest.mark.parametrize("name", ["cim-tr-97-06", "labjack-t7", "di-2108-ek9000"])
def test_a_bench_that_nobody_runs_is_stopped_and_confirmed(name):
    with emulated(name) as there:
        safe = stop_bench(there)
    assert safe.confirmed, safe.detail
    assert abs(safe.velocity_rad_s) < 0.5


def test_a_labjack_that_another_session_drives_is_stopped():
    with emulated("labjack-t7") as there, open_bench(there) as bench:
        begin(bench, AcquisitionSettings(2e-3, 100_000, WAVE))
        read_samples(bench, 200)
        bench.fall_silent()
        safe = stop_bench(there)
        bench.safe_state()
    assert safe.confirmed, safe.detail


def test_the_embedded_bench_has_nobody_else_to_stop_it():
    with pytest.raises(UsageError, match="inside the command"):
        stop_bench(load_profile("cim-tr-97-06"), address="embedded")


@pytest.mark.parametrize("what", ["port", "name", "line"])
def test_whatever_keeps_the_inputs_away_the_outputs_are_stopped(what, tmp_path, monkeypatch):
    """No such port, a name server that is down, a frozen run on the line: the motor stops."""
    with emulated("di-2108-ek9000") as there:
        if what == "port":
            gone = there.daq.inputs.model_copy(update={"address": f"serial://{tmp_path}/gone"})
            there = with_keys(there, daq={"inputs": gone})

        def failing(works, error):
            def call(address):
                if address == there.daq.inputs.address:
                    raise error("cannot be had", where=address, fix="mend it")
                return works(address)

            return call

        if what == "name":
            monkeypatch.setattr(opening, "numbered", failing(opening.numbered, DeviceError))
        if what == "line":
            monkeypatch.setattr(opening, "release", failing(opening.release, BusyError))
        safe = stop_bench(there)
    assert safe.reference_v == pytest.approx(0.0, abs=0.01)
    assert "but" in safe.detail
    assert not safe.confirmed, "nobody has seen the motor stand"


def test_outputs_stand_before_anybody_waits_for_the_line_of_the_inputs(monkeypatch):
    """A frozen run gives the line up after six seconds, or never."""
    with emulated("di-2108-ek9000") as there:
        seen = []

        def release(address):
            if address == there.daq.inputs.address:
                with closing(open_daq(there, there.daq.outputs)) as other:
                    seen.append(other.outputs.read_back())
                raise BusyError("a frozen run has it", where=address, fix="kill it")

        monkeypatch.setattr(opening, "release", release)
        with closing(open_daq(there, there.daq.outputs)) as daq:
            daq.identity()
            daq.arm_watchdog(there.daq.watchdog_s)
            assert daq.write_output("reference", 1.0) == pytest.approx(1.0, abs=0.01)
        stop_bench(there)
    assert seen == [pytest.approx(0.0, abs=0.01)]


# the guard's look at a node: 52 bytes, which no read of the stop has
STATUS = read_registers(*span(reg.STATUS))[0]


def _served(strange):
    """Serve a node whose first replies are those to another host's questions."""
    core = build_core(replies.CountingBench(), replies.PROFILE, 0, pace="fast")
    answer, left = core.answer, iter(range(strange))

    def late(pdu, connection, transaction=0):
        return answer(pdu if next(left, None) is None else STATUS, connection, transaction)

    core.answer = late
    return lines.emulated(core, "rtu")


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
