"""The driver on an emulated instrument."""

import os
import time
from functools import partial
from itertools import islice

import numpy as np
import pytest
from changing import REPORT
from dataqkit import ROLES, driver, opened, served, settings, table
from faults.lines import faulty_serial
from faults.mangler import Mangler, RawFraming
from nodekit import until
from served import acquired, begin, gaps, given, read_all, values

from hdbench.drivers.dataq import port as serial_port
from hdbench.drivers.dataq.port import Commands, Port
from hdbench.drivers.dataq.scans import MODELS
from hdbench.errors import BusyError, DeviceError
from hdbench.system.lines import terminal_pair


def test_every_sample_of_a_stream_arrives_in_order_at_its_rate():
    with opened(speed=4.0) as (_, daq):
        assert daq.configure(settings(4000)) == pytest.approx(1e-3)
        daq.start()
        blocks = read_all(daq)
    assert gaps(blocks, 4000) == 0
    torque = values(blocks)[:, 0]
    # white noise of 7.6 mV: one sample given twice or one mean for all would not have it
    assert np.std(torque) == pytest.approx(0.05 / 6.6, rel=0.1)
    assert len(np.unique(torque)) > 50


@pytest.mark.parametrize("model", sorted(set(MODELS) - {"DI-2008"}))
def test_every_model_streams_what_stands_at_its_terminals(model):
    roles = ("torque", "tacho", "reference")
    made = table(model, roles)
    with opened(made, 2.0) as (found, daq):
        found.call(lambda: found.instrument.write_reference(1.25))
        read = values(acquired(daq, settings(300, roles=roles)))
        assert daq.identity().model == model
    step = 2.0 * made.channels[0].range_v / (1 << MODELS[model].bits)
    assert np.allclose(read[5:, 2], 1.25, atol=step)
    # tacho at rest: 1 mV of noise
    assert abs(np.mean(read[:, 1])) < step + 1e-3


def test_a_slow_di_2008_is_slow():
    roles = ("torque", "tacho")
    with opened(table("DI-2008", roles)) as (_, daq):
        assert daq.capabilities().max_rate_hz(2) == pytest.approx(800 / 3 / 4)
        daq.configure(settings(10, 0.03, roles))
        start_s = time.monotonic()
        daq.start()
        assert sum(map(len, read_all(daq))) == 10
        assert time.monotonic() - start_s > 0.25


def test_an_average_is_one_of_the_instrument():
    with opened(table("DI-4108", average=10), 2.0) as (_, daq):
        torque = values(acquired(daq, settings(2000)))[:, 0]
    # the mean of ten samples has a third of their noise
    assert np.std(torque) == pytest.approx(0.05 / 6.6 / np.sqrt(10), rel=0.1)


def test_another_model_is_refused_before_anything_is_set():
    with served(table("DI-1110")) as found, driver(table("DI-2108"), found.address) as daq:
        with pytest.raises(DeviceError, match=r"'DATAQ' '1110' answers; needed: DATAQ 2108"):
            daq.configure(settings(10))
        assert found.device._entries == {}


def test_a_port_is_open_for_one_program_only():
    with served(table()) as found, driver(table(), found.address) as one:
        one.identity()
        other = driver(table(), found.address)
        with other as daq, pytest.raises(BusyError, match="another program"):
            daq.identity()


def test_it_drives_nothing_and_says_so():
    with opened() as (_, daq):
        able = daq.capabilities()
        assert (able.drives, able.guarded) == (False, False)
        with pytest.raises(DeviceError, match="no analog output"):
            daq.write_output("reference", 0.0)
        assert daq.safe_state().confirmed


def test_a_snapshot_reads_the_terminals_and_a_run_goes_on_after_it():
    with opened() as (found, daq):
        found.call(lambda: found.instrument.write_reference(2.0))
        assert daq.snapshot()["reference"] == pytest.approx(2.0, abs=1e-3)
        begin(daq, settings(50))
        assert daq.snapshot() == {}
        assert gaps(read_all(daq), 50) == 0
        assert daq.snapshot()["reference"] == pytest.approx(2.0, abs=1e-3)


def test_a_stream_that_a_dead_host_left_is_stopped_first():
    with served(table()) as found:
        found.device.buffer_samples = 10**9  # it goes on however long nobody reads
        with driver(table(), found.address) as first:
            begin(first, settings(100_000))
            next(given(first))
        assert found.device.scanning
        with driver(table(), found.address) as second:
            assert second.identity().model == "DI-2108"
            assert not found.device.scanning


def _lose(device, count):
    """Let the first bytes of what is sampled next vanish."""
    sampled = device._sampled

    def short():
        data = sampled()
        if data:
            device._sampled = sampled
        return data[count:]

    device._sampled = short


@pytest.mark.parametrize(
    "fault",
    [*(partial(_lose, count=count) for count in (1, 3, 26)), lambda d: setattr(d, "lines", 0x7E)],
)
def test_a_stream_out_of_step_ends_the_run_and_no_sample_is_wrong(fault):
    """Bytes that vanish, or a digital input that is not left alone."""
    with opened() as (found, daq):
        found.call(lambda: found.instrument.write_reference(3.0))
        begin(daq, settings(100_000))
        blocks = list(islice(given(daq), 5))
        found.call(lambda: fault(found.device))
        with pytest.raises(DeviceError, match="is marked 0x"):
            read_all(daq, blocks)
    assert np.allclose(values(blocks)[5:, 3], 3.0, atol=1e-3)


def test_a_host_that_does_not_read_is_told_of_the_overflow():
    with opened() as (found, daq):
        begin(daq, settings(100_000))
        tick = found.device.tick
        found.call(lambda: setattr(found.device, "tick", lambda *, blocked: tick(blocked=True)))
        with pytest.raises(DeviceError, match="buffer ran over after"):
            read_all(daq)


@pytest.mark.parametrize(
    "kind", ["mutate", "stale", "duplicate", "reorder", "truncate", "garbage", "drop"]
)
def test_spoilt_echoes_never_pass_for_a_setting(kind):
    """Every setting that is accepted stands in the instrument."""
    with served(table()) as found:
        mangler = Mangler(kind, RawFraming(), share=0.3, seed=5)
        path = found.address.removeprefix("serial://")
        with faulty_serial(path, mangler) as near:
            port, asked_s, untils_s = Port(near), [], []
            receive = port.receive
            port.receive = lambda until_s: untils_s.append(until_s) or receive(until_s)
            clock = lambda: asked_s.append(time.monotonic()) or asked_s[-1]  # noqa: E731
            commands = Commands(port, deadline_s=0.3, clock=clock)
            refused = 0
            for value in range(1000, 1015):
                asked_s.clear()
                try:
                    commands.set(f"srate {value}")
                except DeviceError:
                    refused += 1
                else:
                    assert found.device._numbers["srate"] == value
                assert max(untils_s) <= asked_s[0] + 0.3
            commands.close()
        assert mangler.changed >= 3
        assert refused < 8


def test_a_port_that_is_not_there_is_told():
    nowhere = driver(table(), "serial:///dev/hdbench-none")
    with nowhere as daq, pytest.raises(DeviceError, match="cannot be opened"):
        daq.identity()


def test_an_instrument_that_is_unplugged_ends_the_run():
    master, slave = os.openpty()
    port = Port(os.ttyname(slave))
    port.send(b"x", time.monotonic() + 60.0)
    os.close(slave)
    os.close(master)
    with pytest.raises(DeviceError, match=r"port failed|unplugged"):
        port.receive(time.monotonic() + 60.0)
    port.close()


def test_the_counter_follows_the_encoder_in_both_directions():
    roles = ("tacho", "encoder")
    with opened(table(roles=roles), 4.0) as (found, daq):
        daq.configure(settings(4000, roles=roles))
        found.call(lambda: found.instrument.write_enable(on=True))
        daq.start()
        found.call(lambda: found.instrument.write_reference(1.0))
        blocks = [daq.read_block() for _ in range(20)]
        found.call(lambda: found.instrument.write_reference(-1.5))
        blocks = [block for block in blocks if block is not None] + read_all(daq)
    read = values(blocks)
    turns = (read[:, 1] + 2**31) % 2**32 - 2**31
    speed = read[:, 0] * REPORT.tacho.gain_rad_s_per_v
    angle = np.cumsum(speed) * 1e-3 * REPORT.encoder.counts_per_turn / (2.0 * np.pi)
    assert np.max(turns) > 200 > 0 > np.min(np.diff(turns))
    # an edge is 4 counts; the sum of 4000 noisy speeds is good to 0.06 * sqrt(4000) ms = 3 counts;
    # around the reversal a few edges may have the other sign
    assert np.max(np.abs(turns - turns[0] - angle)) < 40


def test_roles_keep_their_order():
    with opened() as (found, daq):
        found.call(lambda: found.instrument.write_reference(1.0))
        read = values(acquired(daq, settings(40, roles=("reference", "torque"))))
    assert read.shape == (40, 2)
    assert np.allclose(read[5:, 0], 1.0, atol=1e-3)
    assert ROLES[0] == "torque"


def test_an_instrument_that_sends_while_nobody_reads_takes_no_memory_without_end(monkeypatch):
    most = 1 << 20
    monkeypatch.setattr(serial_port, "_MOST_WAITING", most, raising=False)
    near, far, path = terminal_pair(blocking=True)
    port, sent = Port(path), 0
    try:
        port.receive(0.0)
        until_s = time.monotonic() + 30.0
        while sent < 2 * most and time.monotonic() < until_s:
            sent += os.write(near, bytes(65536))
        until(lambda: not port._io.readable(0.0), 10.0)
        assert sent >= 2 * most
        assert sum(len(data) for data, _ in port.receive(0.0)) <= most
    finally:
        port.close()
        os.close(near)
        os.close(far)
