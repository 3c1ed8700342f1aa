"""The emulator as a process: speed, death of the host, signals, locks."""

import json
import os
import signal
import sys
import time
from contextlib import contextmanager, suppress
from subprocess import PIPE

import numpy as np
import psutil
import pytest
from forked import hdbench_process
from nodekit import PATIENT, PROFILE, driver, host, realtime_emulator, until
from served import begin, read_samples, sampled

from hdbench.devices import AcquisitionSettings, SimulatedOperator, open_bench, stop_bench
from hdbench.devices.node.registers import State
from hdbench.devices.wire.address import parse_address
from hdbench.errors import DeviceError, ProfileError, UsageError
from hdbench.profile.schema import ReferenceWave

# 150 rad/s forward: the watchdog has something to stop
WAVE = ReferenceWave(wave="constant", amplitude_v=150.0 / PROFILE.servo.velocity_gain_rad_s_per_v)
linux_only = pytest.mark.skipif(sys.platform != "linux", reason="needs signals")


def _emulators(pid):
    """Return the children that are emulators: by their command line, or forks of this process."""
    own = psutil.Process().cmdline()
    lines = {child: child.cmdline() for child in psutil.Process(pid).children()}
    return [child for child, line in lines.items() if line == own or "emulator" in str(line)]


def _alive(process):
    with suppress(psutil.NoSuchProcess):
        return process.status() != psutil.STATUS_ZOMBIE
    return False


def _events(record):
    return [json.loads(line) for line in record.read_text().splitlines()]


@contextmanager
def _embedded():
    """Open an embedded bench; yields it and the process of its node."""
    others = _emulators(os.getpid())
    with open_bench(PROFILE) as bench:
        (node,) = set(_emulators(os.getpid())).difference(others)
        yield bench, node


def test_the_embedded_bench_moves_as_asked_and_ends_safe():
    with open_bench(PROFILE, seed=1) as bench:
        assert bench.identity().simulated
        velocity = sampled(bench, AcquisitionSettings(1e-3, 1000, WAVE)).tacho_v * 56.2565
        # a 15 Hz loop has settled to 1e-6 after 0.2 s; 1 mV of tacho noise is 0.06 rad/s
        assert np.mean(velocity[500:]) == pytest.approx(150.0, abs=0.5)
        assert bench.safe_state().confirmed
        SimulatedOperator(bench).confirm_lock(locked=True)


@linux_only
@pytest.mark.parametrize("guarded", [True, False])
def test_killing_the_host_stops_the_motor_within_a_second(tmp_path, guarded):
    """The guard does, and where it was killed before, the node's own watchdog."""
    record = tmp_path / "node.jsonl"
    with realtime_emulator(PROFILE, record=record) as found:
        with host(found["address"], amplitude_v=WAVE.amplitude_v) as (process, _):
            if not guarded:
                for child in psutil.Process(process.pid).children():
                    child.kill()
            process.send_signal(signal.SIGKILL)
            killed_s = time.monotonic()
            process.wait()
        node = parse_address(found["address"])
        with driver(node.host, node.port) as bench:
            # half a rad/s is a 300th of the speed it ran at: it stands; the watchdog has 3 s for it
            until(lambda: bench.daq.status()["velocity_rad_s"] == pytest.approx(0.0, abs=0.5), 3.0)
            status = bench.daq.status()
    assert status["state"] == (State.STOPPED if guarded else State.TRIPPED)
    assert status["reference_v"] == 0.0
    still = next(e for e in _events(record) if e["event"] == "standstill")
    # watchdog 0.5 s, deceleration 0.2 s, and what a busy computer adds
    assert still["monotonic_s"] - killed_s < 5.0
    assert still["watchdog_trips"] == (0 if guarded else 1)


@linux_only
def test_the_embedded_node_stops_the_motor_and_leaves_when_its_host_is_killed(tmp_path):
    record = tmp_path / "node.jsonl"
    with host("embedded", record=record, amplitude_v=WAVE.amplitude_v) as (process, _):
        (node,) = _emulators(process.pid)
        process.send_signal(signal.SIGKILL)
        killed_s = time.monotonic()
        process.wait()
        until(lambda: not _alive(node), 5.0)
    last = _events(record)[-1]
    assert last["event"] == "standstill"
    assert (last["state"], last["reference_v"]) == ("stopped", 0.0)
    # the guard at once, deceleration 0.2 s, and what a busy computer adds
    assert last["monotonic_s"] - killed_s < 5.0


@linux_only
def test_ctrl_c_does_not_reach_the_embedded_node():
    with _embedded() as (bench, node):
        node.send_signal(signal.SIGINT)
        time.sleep(0.1)
        assert bench.safe_state().confirmed
    until(lambda: not _alive(node), 3.0)


def test_a_lost_node_is_a_device_error_at_once():
    with _embedded() as (bench, node):
        begin(bench, AcquisitionSettings(1e-3, 1_000_000, WAVE))
        node.kill()
        with pytest.raises(DeviceError):
            read_samples(bench, 1_000_000)


def test_an_unknown_plant_is_named_before_anything_starts():
    bench = open_bench(PROFILE, plant="no-such-plant")
    with pytest.raises(ProfileError, match="no-such-plant"), bench:
        pass


@pytest.mark.parametrize(
    "address", ["udp://127.0.0.1:5", "rtu+tcp://127.0.0.1:5", "ascii:///dev/x"]
)
def test_a_wire_that_only_polled_devices_speak_reaches_no_node(address):
    with pytest.raises(UsageError, match="a node is reached by tcp"):
        stop_bench(PROFILE, address=address)


@pytest.mark.parametrize(
    ("words", "place", "stop"),
    [
        ((), "tcp://127.0.0.1:", signal.SIGINT),
        ((), "tcp://127.0.0.1:", signal.SIGTERM),
        (("--rtu",), "rtu:///dev/", signal.SIGTERM),
    ],
)
def test_emulate_prints_its_address_and_serves_until_it_is_stopped(tmp_path, words, place, stop):
    record = tmp_path / "states.jsonl"
    words = ["emulate", "--json", "--record", record, *words]
    with hdbench_process(words, stdout=PIPE, stderr=PIPE) as process:
        try:
            told = json.loads(process.stdout.readline())
            assert told["schema"] == "hdbench/emulator/1"
            assert told["address"].startswith(place)
            with open_bench(PATIENT, address=told["address"]) as bench:
                sampled(bench, AcquisitionSettings(4e-3, 50, WAVE))
                assert bench.safe_state().confirmed
            process.send_signal(stop)
            rest, noise = process.communicate(timeout=60)
        finally:
            process.kill()
    assert (process.returncode, rest) == (0, b"")
    assert b"Traceback" not in noise
    events = [event["event"] for event in _events(record)]
    assert (events[0], events[-1]) == ("start", "standstill")


def test_a_seed_out_of_its_domain_is_wrong_usage_as_the_emulator_tells_it():
    with pytest.raises(UsageError, match="seed -1 is negative"), open_bench(PROFILE, seed=-1):
        pass
