"""Anybody can stop any bench, with or without a run on it."""

import time
from contextlib import ExitStack, closing

import pytest
from changing import with_keys

from hdbench.devices import AcquisitionSettings, open_bench, opening, stop_bench
from hdbench.devices.driver import open_daq
from hdbench.devices.emulator.process import running_emulator
from hdbench.errors import BusyError, DeviceError, UsageError
from hdbench.profile import load_profile
from hdbench.profile.schema import ReferenceWave

WAVE = ReferenceWave(wave="constant", amplitude_v=1.0)


@pytest.mark.parametrize("name", ["cim-tr-97-06", "labjack-t7", "di-2108-ek9000"])
def test_a_bench_that_nobody_runs_is_stopped_and_confirmed(name):
    data = load_profile(name).data
    with running_emulator(data, plant="as-modelled", seed=0, pace="realtime") as found:
        safe = stop_bench(opening._at(data, found, deadline_s=0.9))
    assert safe.confirmed, safe.detail
    assert abs(safe.velocity_rad_s) < 0.5


def test_a_labjack_that_another_session_drives_is_stopped(tmp_path):
    data = load_profile("labjack-t7").data
    with ExitStack() as stack:
        found = stack.enter_context(
            running_emulator(data, plant="as-modelled", seed=0, pace="realtime")
        )
        there = opening._at(data, found, deadline_s=0.9)
        bench = stack.enter_context(open_bench(there))
        bench.configure(AcquisitionSettings(2e-3, 100_000, WAVE))
        bench.start()
        taken = 0
        until_s = time.monotonic() + 10.0
        while taken < 200 and time.monotonic() < until_s:
            block = bench.read_block()
            taken += len(block) if block else 0
        bench.fall_silent()
        safe = stop_bench(there)
        bench.safe_state()
    assert taken >= 200
    assert safe.confirmed, safe.detail


def test_the_embedded_bench_has_nobody_else_to_stop_it():
    with pytest.raises(UsageError, match="inside the command"):
        stop_bench(load_profile("cim-tr-97-06"), address="embedded")


@pytest.mark.parametrize("what", ["port", "name", "line"])
def test_whatever_keeps_the_inputs_away_the_outputs_are_stopped(what, tmp_path, monkeypatch):
    """No such port, a name server that is down, a frozen run on the line: the motor stops."""
    data = load_profile("di-2108-ek9000").data
    with running_emulator(data, plant="as-modelled", seed=0, pace="realtime") as found:
        there = opening._at(data, found, deadline_s=0.9)
        if what == "port":
            gone = there.daq.inputs.model_copy(update={"address": f"serial://{tmp_path}/gone"})
            there = with_keys(there, daq={"inputs": gone})
        inputs = there.daq.inputs.address

        def number(address):
            if address == inputs and what == "name":
                raise DeviceError("the host name is not known", where=address, fix="correct it")
            return address

        def release(address):
            if address == inputs and what == "line":
                raise BusyError("a run that does not end has it", where=address, fix="kill it")

        if what != "port":
            monkeypatch.setattr(opening, "numbered", number)
            monkeypatch.setattr(opening, "release", release)
        safe = stop_bench(there)
    assert safe.reference_v == pytest.approx(0.0, abs=0.01)
    assert "but" in safe.detail
    assert not safe.confirmed, "nobody has seen the motor stand"


def test_outputs_stand_before_anybody_waits_for_the_line_of_the_inputs(monkeypatch):
    """A frozen run gives the line up after six seconds, or never."""
    data = load_profile("di-2108-ek9000").data
    with running_emulator(data, plant="as-modelled", seed=0, pace="realtime") as found:
        there = opening._at(data, found, deadline_s=0.9)
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
