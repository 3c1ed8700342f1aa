"""The node behind its registers and its driver in front of it, over real sockets."""

import math
import struct
import time
from contextlib import closing
from types import SimpleNamespace

import numpy as np
import pytest
from daqkit import Clock
from faults.lines import emulated
from nodekit import PROFILE, TinyBench, codes_of, driver, served, through, until
from pymodbus.client import ModbusTcpClient
from served import CHANNELS, acquired, begin, gaps, not_made_safe, read_all, read_samples

from hdbench.devices import AcquisitionSettings, SimulatedOperator
from hdbench.devices.daq import clean_text
from hdbench.devices.emulator.machine import NodeMachine
from hdbench.devices.emulator.node import (
    NodeCore,
    build_core,
    identity_values,
    limit_values,
)
from hdbench.devices.emulator.server import ModbusRefusedError
from hdbench.devices.node.driver import open_node
from hdbench.devices.node.registers import Refusal, State, register
from hdbench.errors import BusyError, DeviceError, UsageError
from hdbench.profile.schema import ReferenceWave

WAVE = ReferenceWave(wave="constant", bias_v=0.5, amplitude_v=1.5)


def _turn(n_samples):
    return AcquisitionSettings(1e-3, n_samples, WAVE)


def _check_values(blocks):
    """Every sample is the one that the tiny bench made for its index."""
    volt, ampere = PROFILE.daq.range_v / 32768, PROFILE.servo.max_current_a / 32768
    for block in blocks:
        made = codes_of(block.first_index + np.arange(len(block)))
        for name, codes, step in zip(CHANNELS, made, (volt, volt, ampere, volt, 1), strict=True):
            np.testing.assert_array_equal(getattr(block, name), codes * step)


# -- acquisition ----------------------------------------------------------------------------------


def test_every_sample_arrives_once_with_its_value_and_wraps_are_undone():
    # 40 000 samples of -70 001 counts pass -2**31 once
    with served() as node, driver(node.host, node.port) as bench:
        blocks = acquired(bench, _turn(40_000))
    assert gaps(blocks, 40_000) == 0
    _check_values(blocks)
    assert blocks[-1].encoder_count[-1] < -(2**31)
    assert not any(block.watchdog_tripped for block in blocks)


def test_the_parameter_block_reaches_the_bench_as_written():
    tiny = TinyBench()
    wave = ReferenceWave(
        wave="trapezoid", amplitude_v=2.773, frequency_hz=1 / 6, duty=0.8, rise=0.1, fall=0.1
    )
    with served(tiny) as node, driver(node.host, node.port) as bench:
        begin(bench, AcquisitionSettings(2e-3, 500, wave))
        bench.stop()
        assert gaps(acquired(bench, AcquisitionSettings(1e-2, 7, None)), 7) == 0
    (period_s, got, duration_s), (_, none, _) = tiny.begun
    assert (period_s, duration_s) == (pytest.approx(2e-3), pytest.approx(1.0))
    assert got.wave == "trapezoid"
    for name in ("bias_v", "amplitude_v", "frequency_hz", "duty", "rise", "fall"):
        # 32-bit floats: half a unit in the last place, 2**-24
        assert getattr(got, name) == pytest.approx(getattr(wave, name), rel=6e-8)
    assert none is None, "without a reference the drive stays disabled"


def test_real_time_delivers_every_sample_at_the_rate_asked_for():
    with served(pace="realtime") as node, driver(node.host, node.port) as bench:
        bench.configure(_turn(1500))
        start_s = time.monotonic()
        bench.start()
        blocks = read_all(bench)
        # never early by more than the tick
        assert time.monotonic() - start_s > 1.45
    assert gaps(blocks, 1500) == 0
    _check_values(blocks)


def test_an_unacknowledged_block_is_sent_again_bit_by_bit():
    seen = []

    def mangle(number, reply):
        if reply[7] == 23:
            seen.append(reply[7:])
            if len(seen) in (3, 5):
                return None
        return reply

    with through(mangle, deadline_s=0.3) as (bench, _, _):
        blocks = acquired(bench, _turn(190))
    # all but the echo of the exchange and the checksum over it: bytes 0-1 and 20-23 of the window
    blocks_seen = [reply[4:22] + reply[26:] for reply in seen]
    assert blocks_seen[2] == blocks_seen[3]
    assert blocks_seen[4] == blocks_seen[5]
    assert len(set(blocks_seen)) == len(seen) - 2
    assert gaps(blocks, 190) == 0
    _check_values(blocks)


def test_overflow_is_counted_exactly_and_never_closed_up():
    with served(pace="realtime") as node, driver(node.host, node.port, watchdog_s=2.0) as bench:
        begin(bench, AcquisitionSettings(1e-4, 12_000, None))
        blocks = read_samples(bench, 1)
        # at 10 kHz the buffer of 4096 is full after 0.41 s
        time.sleep(0.7)
        blocks += read_all(bench)
        status = bench.daq.status()
    for block in blocks:
        # every scan is the one of its index, on either side of the gap
        torque = codes_of(block.first_index + np.arange(len(block)))[0]
        np.testing.assert_array_equal(block.torque_v, torque * (PROFILE.daq.range_v / 32768))
    assert gaps(blocks, 12_000) == status["samples_lost"] > 0
    assert status["status_flags"] & 1


def test_losses_at_the_very_end_are_told_before_an_empty_block():
    with served(pace="realtime") as node, driver(node.host, node.port) as bench:
        # at 10 kHz the buffer of 4096 fills after 0.41 s, the acquisition ends after 0.5 s
        begin(bench, AcquisitionSettings(1e-4, 5000, None))
        until(lambda: bench.daq.status()["state"] in (State.TRIPPED, State.FINISHED), 3.0)
        blocks = read_all(bench)
    assert gaps(blocks, 5000) == 5000 - 4096
    assert len(blocks[-1]) == 0
    assert blocks[-1].lost_before == 5000 - 4096


# -- refusals -------------------------------------------------------------------------------------


def _client(node):
    return ModbusTcpClient(node.host, port=node.port, retries=0, timeout=2)


@pytest.mark.parametrize(
    ("name", "value"),
    [("converter_bits", 0), ("converter_bits", 24), ("range_v", 0.0), ("range_v", math.nan),
     ("current_range_a", -1.0), ("limit_velocity_rad_s", math.inf)],
)  # fmt: skip
def test_a_scale_that_no_node_can_have_is_an_error_with_its_register(name, value):
    machine = NodeMachine(TinyBench(), pace="fast", clock=lambda: 0.0, record=lambda _: None)
    limits = {**limit_values(PROFILE), name: value}
    core = NodeCore(machine, identity=identity_values(0), limits=limits, clock=lambda: 0.0)
    with (
        emulated(core) as address,
        closing(open_node(PROFILE, PROFILE.daq.model_copy(update={"address": address}))) as daq,
        pytest.raises(DeviceError, match=name) as told,
    ):
        daq.capabilities()
    assert f"register {name}" in told.value.where


@pytest.mark.parametrize(
    ("wave", "reason"),
    [
        (ReferenceWave(wave="constant", amplitude_v=8.5), "reference limit"),
        (ReferenceWave(wave="sine", bias_v=4.0, amplitude_v=3.5, frequency_hz=1.0), "velocity"),
    ],
)
def test_the_node_itself_refuses_what_is_beyond_its_limits(wave, reason):
    with served() as node, driver(node.host, node.port) as bench:
        with pytest.raises(DeviceError, match=f"exception 3 .*{reason}") as caught:
            bench.configure(AcquisitionSettings(1e-3, 100, wave))
        assert "amplitude_v" in caught.value.where
        assert bench.daq.status()["reference_v"] == 0.0


@pytest.mark.parametrize(
    ("field", "period_s", "n_samples", "watchdog_s"),
    [("n_samples", 1e-3, 0, 0.5), ("sample_period_s", 5e-5, 10, 0.5), ("watchdog_s", 1e-3, 10, 9)],
)
def test_values_outside_the_nodes_limits_block_are_named_before_anything_is_sent(
    field, period_s, n_samples, watchdog_s
):
    with (
        served() as node,
        driver(node.host, node.port, watchdog_s=watchdog_s) as bench,
        pytest.raises(DeviceError, match=field),
    ):
        bench.configure(AcquisitionSettings(period_s, n_samples, WAVE))


@pytest.mark.parametrize(
    ("address", "values", "exception", "reason"),
    [
        (0x0100, [1], 2, Refusal.ADDRESS),
        (0x2000, [1], 2, Refusal.ADDRESS),
        (0x1011, [1], 2, Refusal.ADDRESS),
        (0x1040, [9], 3, Refusal.VALUE),
        (0x1018, [99], 3, None),
        (0x1010, [0x7FC0, 0], 3, None),
    ],
)
def test_another_modbus_client_is_refused_with_the_documented_exception(
    address, values, exception, reason
):
    """Independent of our client: pymodbus alone, and what it decodes."""
    with served() as node, _client(node) as client:
        reply = client.write_registers(address, values)
        assert (reply.isError(), reply.exception_code) == (True, exception)
        told = client.read_holding_registers(register("refusal").address, count=1)
        assert reason is None or told.registers == [reason]


def test_a_nan_reference_is_refused():
    core = build_core(TinyBench(), PROFILE, 0, pace="fast")
    _configure(core, n_samples=100)
    with pytest.raises(ModbusRefusedError) as caught:
        core.write("holding", register("amplitude_v").address, struct.pack(">f", math.nan), 1)
    assert caught.value.exception == 3
    assert caught.value.reason == Refusal.REFERENCE_LIMIT


# -- watchdog, safe state, session ----------------------------------------------------------------


@pytest.mark.parametrize("pace", ["fast", "realtime"])
def test_a_silent_host_trips_the_watchdog_which_stops_the_motor_and_stays_tripped(pace):
    with served(pace=pace) as node, driver(node.host, node.port, watchdog_s=0.2) as bench:
        begin(bench, _turn(100_000))
        while node.core.machine.bench.velocity_rad_s < 50.0:
            bench.read_block()
        start_s = time.monotonic()
        # watchdog 0.2 s, lag 20 ms times ln(1e5) = 0.23 s
        assert until(lambda: node.core.machine.bench.velocity_rad_s == 0.0, 2.0) < 1.0
        assert time.monotonic() - start_s > 0.15
        status = bench.daq.status()
        assert (status["state"], status["reference_v"]) == (State.TRIPPED, 0.0)
        assert status["watchdog_trips"] == 1
        with pytest.raises(DeviceError, match=r"exception 4 .*tripped"):
            bench.start()
        # writing the parameter block again, watchdog time included, re-arms it
        assert gaps(acquired(bench, _turn(19)), 19) == 0


def test_the_trip_shows_in_the_next_block():
    with served() as node, driver(node.host, node.port, watchdog_s=0.05) as bench:
        begin(bench, _turn(100_000))
        bench.read_block()
        until(lambda: bench.daq.status()["state"] == State.TRIPPED, 2.0)
        tripped = [block for block in read_all(bench) if block.watchdog_tripped]
    assert not tripped[-1].running


def test_reading_alone_does_not_feed_the_watchdog():
    with served() as node, driver(node.host, node.port, watchdog_s=0.1) as bench:
        begin(bench, _turn(100_000))
        with _client(node) as client:
            until_s = time.monotonic() + 0.5
            while time.monotonic() < until_s:
                client.read_holding_registers(0, count=120)
        assert bench.daq.status()["state"] == State.TRIPPED


def test_a_heartbeat_that_does_not_change_does_not_feed_the_watchdog():
    clock = Clock()
    core = build_core(TinyBench(), PROFILE, 0, pace="fast", clock=clock)
    _start(core, n_samples=10_000)
    heartbeat = register("heartbeat").address
    # the watchdog time is 2 s
    for beat, state in ((1, State.RUNNING), (2, State.RUNNING), (2, State.TRIPPED)):
        clock.now_s += 1.5
        core.tick()
        core.write("holding", heartbeat, struct.pack(">H", beat), 1)
        clock.now_s += 0.4 if state == State.RUNNING else 0.6
        core.tick()
        assert _status(core, "state") == state


def test_the_watchdog_rests_while_nothing_runs():
    with served() as node, driver(node.host, node.port, watchdog_s=0.05) as bench:
        bench.configure(_turn(19))
        time.sleep(0.2)
        assert bench.daq.status()["watchdog_trips"] == 0


@pytest.mark.parametrize("state", ["idle", "configured", "running", "finished", "tripped", "safe"])
def test_the_safe_state_is_reached_and_confirmed_from_any_state(state):
    with served() as node, driver(node.host, node.port, watchdog_s=0.1) as bench:
        if state != "idle":
            # so many that a block that is asked for twice does not end the run
            bench.configure(_turn(4000))
        if state in ("running", "finished", "tripped"):
            bench.start()
            bench.read_block()
        if state == "finished":
            read_all(bench)
        if state == "tripped":
            until(lambda: bench.daq.status()["state"] == State.TRIPPED, 2.0)
        if state == "safe":
            bench.safe_state()
        safe = bench.safe_state()
        assert safe.confirmed, safe.detail
        assert safe.reference_v == 0.0
        assert abs(safe.velocity_rad_s) < 0.5
        tiny = node.core.machine.bench
        assert (tiny.reference_v, tiny.enabled) == (0.0, False)
        assert bench.safe_state().confirmed


def test_a_motor_that_keeps_turning_is_not_called_safe():
    class Runaway(TinyBench):
        def halt(self) -> None:
            return None

    clock = Clock()
    with served(Runaway()) as node, driver(node.host, node.port, clock=clock) as bench:
        begin(bench, _turn(100_000))
        bench.read_block()
        safe = bench.safe_state()
    assert not safe.confirmed
    assert safe.reference_v == 2.0
    assert "reference is 2 V" in safe.detail


def test_a_node_that_is_gone_is_not_called_safe_and_nothing_is_raised():
    clock = Clock()
    with served() as node, driver(node.host, node.port, clock=clock) as bench:
        bench.identity()
    start_s = clock.now_s
    safe = bench.safe_state()
    assert (safe.confirmed, safe.reference_v, safe.velocity_rad_s) == (False, None, None)
    assert "Connection refused" in safe.detail
    # 2.5 s for the motor to stop, in steps of 20 ms
    assert 2.5 <= clock.now_s - start_s < 2.55


def test_a_start_whose_reply_is_lost_is_read_back_and_sent_once():
    starts = []

    def mangle(number, reply):
        if reply[7:] == b"\6\x10\x40\0\1":
            starts.append(number)
            return None
        return reply

    with through(mangle, deadline_s=0.2) as (bench, node, _):
        assert gaps(acquired(bench, _turn(190)), 190) == 0
    assert len(starts) == 1
    assert node.core.machine.starts == 1


def test_a_second_host_cannot_write_but_can_read_and_stop():
    with served() as node, driver(node.host, node.port) as first:
        first.claim()
        begin(first, _turn(100_000))
        first.read_block()
        with driver(node.host, node.port) as second:
            with pytest.raises(BusyError, match="session held"):
                second.claim()
            with pytest.raises(BusyError):
                second.configure(_turn(10))
            assert second.daq.status()["session_state"] == 2
            assert second.daq.status()["state"] == State.RUNNING
            assert second.safe_state().confirmed
        assert first.daq.status()["session_state"] == 1


def test_a_session_outlives_a_lost_connection_and_ends_with_its_host():
    clock = Clock()
    core = build_core(TinyBench(), PROFILE, 0, pace="fast", clock=clock)

    def claim(token, connection):
        core.write("holding", register("session").address, struct.pack(">I", token), connection)

    claim(7, 1)
    core.left(1)
    with pytest.raises(ModbusRefusedError):
        claim(8, 2)
    claim(7, 3)
    core.left(3)
    clock.now_s += 2.1
    core.tick()
    claim(8, 4)


def test_a_reconnecting_driver_keeps_its_session():
    with through(lambda n, reply: reply if n != 10 else None, deadline_s=0.4) as (bench, *_):
        bench.claim()
        assert gaps(acquired(bench, _turn(380)), 380) == 0
        assert bench.daq.status()["session_state"] == 1
        assert bench.daq.repeats == 1


# -- operator -------------------------------------------------------------------------------------


def test_a_real_bench_has_no_simulated_operator():
    with pytest.raises(UsageError, match="person"):
        SimulatedOperator(SimpleNamespace(simulation=None))


def test_another_device_is_recognised_before_anything_is_written():
    def swapped(_number, reply):
        return reply.replace(b"\x00\x11\x22\x33", b"\x22\x33\x00\x11")

    with (
        through(swapped, deadline_s=1.0) as (bench, _, frames),
        pytest.raises(DeviceError, match="word order"),
    ):
        bench.claim()
    assert {frame[7] for frame in frames} == {3}


def test_control_characters_of_the_device_are_not_passed_on():
    assert clean_text(b"T\x1b[31m7\x07\xff\r\n\x00junk") == "T[31m7"
    assert clean_text("nödë\N{RIGHT-TO-LEFT OVERRIDE}".encode()) == "nödë"


def test_a_restarted_node_is_noticed():
    with served() as node, driver(node.host, node.port, watchdog_s=2.0) as bench:
        begin(bench, _turn(100_000))
        bench.read_block()
        # power lost and back: everything as after switching on
        fresh = build_core(TinyBench(), PROFILE, 0, pace="fast")
        node.core.__dict__.update(fresh.__dict__)
        with pytest.raises(DeviceError, match="restarted"):
            bench.read_block()


# -- helpers on the core --------------------------------------------------------------------------


def _configure(core, *, n_samples):
    raw = struct.pack(">fIIfHfffffH", 0.0, 1_000_000, n_samples, 1.0, 1, 0, 0, 0, 0, 0, 2000)
    core.write("holding", register("bias_v").address, raw, 1)


def _start(core, *, n_samples):
    _configure(core, n_samples=n_samples)
    core.write("holding", register("command").address, b"\0\1", 1)


def _status(core, name):
    entry = register(name)
    return int.from_bytes(core.read("holding", entry.address, entry.size, 1), "big")


def test_after_a_lost_connection_another_node_at_the_address_is_never_written_to():
    """Two adapters that change places: the stranger stands still, and would confirm it."""
    strange = []

    def mangle(number, reply):
        # the identity's reply: its serial number changes once the first connection is gone
        if strange and reply[7:9] == b"\x03\x48":
            return reply.replace(b"sim-0", b"sim-9")
        return reply

    with through(mangle, deadline_s=1.0) as (bench, node, frames):
        bench.identity()
        bench.daq.node._link.close()
        strange.append(True)
        asked = len(frames)
        safe = not_made_safe(bench)
        assert "another device" in safe.detail
        # nothing but reads was sent to it
        assert {frame[7] for frame in frames[asked:]} <= {3}
    assert node.core.machine.starts == 0
