"""The driver when wire or device misbehave: nothing wrong is delivered, deadlines hold."""

import time
from contextlib import closing, nullcontext

import numpy as np
import pytest
from faults.lines import behind
from faults.mangler import Mangler, TcpFraming
from labjackkit import claimed, driver, served, settings, streaming
from nodekit import until
from served import acquired, begin, disturb, gaps, lost, read_all, values

from hdbench.devices.wire.address import parse_address
from hdbench.devices.wire.link import connect
from hdbench.drivers.labjack.control import Control
from hdbench.drivers.labjack.driver import STREAM_OFFSET
from hdbench.drivers.labjack.registers import SESSION
from hdbench.errors import DeviceError


@pytest.mark.parametrize("kind", ["echo", "function", "drop", "truncate", "transaction"])
def test_a_write_without_its_echo_fails_and_is_sent_once(kind):
    register = SESSION[0]
    with served() as device:
        writes = device.noted_writes()
        mangler = Mangler(kind, TcpFraming(), seed=2)
        with behind(f"tcp://{device.host}:{device.port}", mangler) as near:
            control = Control(connect(parse_address(near)), deadline_s=0.1)
            with closing(control), pytest.raises(DeviceError):
                control.write((register,), (7,))
        assert writes == [register.address]


# what becomes of the fifth and the sixth packet of a stream
SPOILT = {
    "drop": lambda fifth, sixth: [],
    "duplicate": lambda fifth, sixth: [fifth, fifth, sixth, sixth],
    "reorder": lambda fifth, sixth: [sixth, fifth],
    "truncate": lambda fifth, sixth: [fifth[:-6], sixth],
    "number": lambda fifth, sixth: [bytes((fifth[0] ^ 4,)) + fifth[1:], sixth],
    "header": lambda fifth, sixth: [fifth[:7] + b"\3" + fifth[8:], sixth],
    "status": lambda fifth, sixth: [fifth[:12] + b"\x12\x34" + fifth[14:], sixth],
    "garbage": lambda fifth, sixth: [b"\xde\xad\xbe" + fifth, sixth],
}
# samples that are lost in those that are told as such; the others end the stream
COUNTED = {"drop": 40, "duplicate": 0}


@pytest.mark.parametrize("name", SPOILT)
def test_what_a_broken_stream_delivers_is_right_and_the_rest_is_told(name):
    passed = []

    def spoilt(packet: bytes) -> list[bytes]:
        passed.append(packet)
        if len(passed) == 6:
            return SPOILT[name](*passed[4:])
        return [] if len(passed) == 5 else [packet]

    with claimed(speed=4.0) as (device, daq):
        tick = device.device.stream.tick
        device.device.stream.tick = lambda *, blocked: [
            changed for packet in tick(blocked=blocked) for changed in spoilt(packet)
        ]
        taken, blocks = device.noted_samples(), []
        begin(daq, settings(400))
        with nullcontext() if name in COUNTED else pytest.raises(DeviceError):
            read_all(daq, blocks)
        true = np.concatenate([samples.volts["torque"] for samples in taken])
        for block in blocks:
            there = true[block.first_index : block.first_index + len(block)]
            assert np.max(np.abs(block.values[:, 0] - there), initial=0.0) < 2e-4
        if name in COUNTED:
            assert gaps(blocks, 400) == COUNTED[name]
        else:
            assert sum(map(len, blocks)) + lost(blocks) < 400


def _be_away(device, until) -> None:
    """Let the network be away from now on until `until` of the stream says that it is back."""
    stream, back = device.device.stream, []
    tick = stream.tick

    def away(*, blocked):
        if until(stream):
            back.append(True)
        return tick(blocked=blocked or not back)

    device.call(lambda: setattr(stream, "tick", away))


@pytest.mark.parametrize("count_joint", [False, True])
def test_a_network_that_was_away_leaves_one_gap_that_is_exact(count_joint):
    with streaming(4000, speed=10.0, auto_recover=True) as (device, daq):
        device.device.stream.count_joint = count_joint
        blocks = [block for _ in range(5) if (block := daq.read_block()) is not None]
        _be_away(device, lambda stream: (stream._skipped or 0) >= 200)
        blocks += read_all(daq)
        (gap,) = [block.lost_before for block in blocks if block.lost_before]
        assert 100 < gap < 2000
        assert gaps(blocks, 4000) == gap


def test_without_recovery_a_full_buffer_ends_the_run_with_its_name():
    with streaming(6000, speed=10.0, auto_recover=False) as (device, daq):
        _be_away(device, lambda stream: stream._status)
        blocks = []
        with pytest.raises(DeviceError, match=r"STREAM_BUFFER_FULL \(2945\)"):
            read_all(daq, blocks)
        # everything that was sampled until then was delivered: the whole buffer, of whole packets
        assert sum(len(block) for block in blocks) >= 1800


def test_what_a_stopped_stream_has_sent_is_read_before_the_run_is_given_up():
    with streaming(6000, speed=10.0, auto_recover=False) as (device, daq):
        stream, read, ended = device.device.stream, daq.control.read, []
        # the network is away until the driver asks whether the device streams
        _be_away(device, lambda stream: ended)

        def answered_late(*registers):
            until(lambda: stream._status, 5.0)
            ended.append(True)
            until(lambda: not stream.running, 5.0)
            return read(*registers)

        daq.control.read = answered_late
        with pytest.raises(DeviceError, match=r"STREAM_BUFFER_FULL \(2945\)"):
            read_all(daq)


@pytest.mark.parametrize(
    ("status", "name"),
    [(2942, "SCAN_OVERLAP"), (2943, "AUTO_RECOVER_END_OVERFLOW"), (2944, "BURST_COMPLETE")],
)
def test_a_stream_that_the_device_ends_is_named(status, name):
    with streaming(4000, speed=4.0) as (device, daq):
        blocks = [block for _ in range(8) if (block := daq.read_block()) is not None]
        device.call(lambda: setattr(device.device.stream, "_status", status))
        with pytest.raises(DeviceError, match=rf"STREAM_{name} \({status}\)"):
            read_all(daq, blocks)
        assert lost(blocks) == 0


def test_an_index_jump_that_the_device_does_not_tell_is_found():
    with streaming(2000, speed=4.0) as (device, daq):
        daq.read_block()
        device.call(lambda: [device.instrument.take(1) for _ in range(3)])
        with pytest.raises(DeviceError, match="core timer"):
            read_all(daq)


def test_a_device_that_restarts_is_told_and_its_motor_stands():
    with streaming(20_000) as (device, daq):
        daq.enable(on=True)
        daq.write_output("reference", 1.0)
        time.sleep(0.2)
        device.call(device.device.reboot)
        with pytest.raises(DeviceError, match=r"stream (broke|)|no longer streams"):
            read_all(daq)
        assert not device.instrument.enabled
        assert daq.safe_state().confirmed


def test_stuck_and_saturated_inputs_reach_the_host_as_they_are():
    with claimed(speed=4.0) as (device, daq):
        device.call(lambda: disturb(device.instrument, torque=1e3, tacho=-1e3))
        blocks = acquired(daq, settings(100))
        saturated = np.concatenate([block.saturated for block in blocks])
        assert np.all(saturated[:, :2])
        assert not np.any(saturated[:, 2:])
        device.call(lambda: disturb(device.instrument, torque=0.5))
        read = values(acquired(daq, settings(100)))
        assert np.ptp(read[:, 0]) == 0.0
        assert np.ptp(read[:, 1]) > 0.0


def test_the_stream_port_stands_200_above_the_other():
    assert STREAM_OFFSET == 702 - 502
    with served() as device, driver(device.port, stream_port=device.port + 1) as daq:
        daq.claim()
        daq.configure(settings(10))
        with pytest.raises(DeviceError, match=f":{device.port + 1}"):
            daq.start()
