"""Anybody can stop any bench, with or without a run on it."""

from contextlib import closing, contextmanager

import pytest
from changing import with_keys
from nodekit import realtime_emulator
from served import WAVE, begin, read_samples

from hdbench.devices import AcquisitionSettings, open_bench, opening, stop_bench
from hdbench.devices.driver import open_daq
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
