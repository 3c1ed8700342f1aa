"""The driver on an emulated device: who answers, what is written, what is read, what stops."""

import struct
import time

import numpy as np
import pytest
from faults.lines import behind
from faults.mangler import Mangler, RtuFraming, TcpFraming
from modbuskit import COUPLER, KNOWN, TORQUE, driver, driving, opened, served, settings, table
from nodekit import until
from pymodbus.client import ModbusTcpClient
from served import begin, gaps, given, not_made_safe, read_all, swap_words
from stopwatch import Stopwatch

from hdbench.devices.emulator.instrument import ElectricalSamples
from hdbench.devices.emulator.modbus import ModbusDevice
from hdbench.devices.wire.rtu import crc16
from hdbench.errors import DeviceError, ProfileError, UsageError

ENCODER = {"role": "encoder", "address": 12, "type": "i32"}


@pytest.mark.parametrize("order", ["ABCD", "CDAB", "BADC", "DCBA"])
def test_a_float_is_read_in_every_order(order):
    with opened(table(channels=({**TORQUE, "order": order},))) as (found, daq):
        # the same reading stands for a millisecond; noise is 8 mV, eight of its deviations
        assert daq.snapshot()["torque"] == pytest.approx(found.torque_v(), abs=0.08)


def test_another_client_reads_what_the_map_says():
    made = table(channels=({**TORQUE, "type": "i16", "scale": 0.0005},), identify=(KNOWN,))
    with served(made) as found:
        host, port = found.address.removeprefix("tcp://").split(":")
        with ModbusTcpClient(host, port=int(port)) as client:
            assert client.read_holding_registers(1, count=1).registers == [4660]
            (word,) = client.read_holding_registers(10, count=1).registers
            volts = (word - 65536 * (word > 32767)) * 0.0005
            assert volts == pytest.approx(found.torque_v(), abs=0.08)
            assert client.read_holding_registers(11, count=1).exception_code == 2


def test_the_channels_of_one_request_are_of_one_moment():
    made = table(channels=(TORQUE, ENCODER))

    class Clockwork:
        """Gives the number of its readings, for a count as for a voltage."""

        count = 0

        def look(self):
            self.count += 1
            volts = {name: np.array([self.count]) for name in ("torque", "tacho", "current")}
            return ElectricalSamples(0, volts, np.array([self.count]))

    device = ModbusDevice(Clockwork(), made, amperes_per_v=1.0)
    for moment in (1, 2):
        torque_v, count = struct.unpack(">fi", device.read("holding", 10, 4, 0))
        assert torque_v == count == moment


def test_swapped_words_are_named():
    with opened(table(identify=({"address": 1, "type": "f32", "equals": 1.5},))) as (found, daq):
        swap_words(found.device.memory)
        with pytest.raises(DeviceError, match="words swapped: order CDAB"):
            daq.identity()


def test_a_register_that_the_device_does_not_have_is_the_profile_s_fault():
    elsewhere = table(channels=({**TORQUE, "address": 99},))
    with served(table()) as found, driver(elsewhere, found.address) as daq:
        with pytest.raises(ProfileError, match="illegal data address") as caught:
            daq.snapshot()
        assert "holding 99" in caught.value.where


def test_settings_are_written_only_where_they_differ():
    init = {"address": 70, "type": "u16", "value": 82.0}
    with opened(table(identify=(KNOWN,), init=(init,))) as (found, daq):
        daq.configure(settings(3))
        daq.configure(settings(3))
        assert [pdu.hex() for pdu in found.written] == ["0600460052"]


@pytest.mark.parametrize("wire", ["tcp", "udp", "rtu", "rtu+tcp", "ascii"])
def test_after_a_lost_connection_another_device_at_the_address_is_never_written_to(wire):
    with opened(driving(channels=(TORQUE, ENCODER)), wire) as (found, daq):
        daq.identity()
        daq.write_output("reference", 1.0)
        daq._access._link.close()
        found.call(lambda: found.device.memory.put(1, 4661))
        written = len(found.written)
        with pytest.raises(DeviceError, match="another device answers: holding 1 reads 4661"):
            daq.write_output("reference", 0.5)
        with pytest.raises(DeviceError, match="another device"):
            daq.snapshot()
        assert "another device" in not_made_safe(daq).detail
        assert len(found.written) == written
        found.call(lambda: found.device.memory.put(1, 4660))
        assert daq.safe_state().confirmed


def test_after_a_lost_connection_a_device_without_the_known_register_is_another_one():
    with opened(driving()) as (found, daq):
        daq.identity()
        daq._access._link.close()
        found.call(lambda: found.device.memory._cells.pop(("holding", 1)))
        with pytest.raises(DeviceError, match=r"another device answers .*: exception 2"):
            daq.write_output("reference", 0.5)
        assert found.written == []


def test_a_reading_comes_every_period_with_its_time():
    with opened(table()) as (_, daq):
        daq.configure(settings(12))
        start_s = time.monotonic()
        daq.start()
        blocks = read_all(daq)
    gaps(blocks, 12)
    for block in blocks:
        if len(block):
            due_s = start_s + 0.02 * block.first_index
            # half of a period, by which an index is chosen, and the time of the call before
            assert abs(block.time_s[0] - due_s) < 0.015
            assert block.read_s[0] < block.time_s[0] < block.read_s[1]


def test_a_device_that_is_silent_loses_samples_that_are_counted():
    with opened(table(), deadline_s=0.4) as (found, daq):
        begin(daq, settings(30))
        blocks = [next(given(daq))]
        pause_s = time.monotonic() + 0.1
        found.call(lambda: setattr(found.device, "hears", lambda _: time.monotonic() > pause_s))
        read_all(daq, blocks)
    assert gaps(blocks, 30) >= 4


@pytest.mark.parametrize(
    ("extra", "value"),
    [({"invalid": (32767.0,)}, 32767.0), ({"status": {"address": 20, "mask": 6, "good": 2}}, 4.0)],
)
def test_a_reading_that_the_device_calls_invalid_is_lost_not_delivered(extra, value):
    channel = {**TORQUE, "type": "i16", "scale": 0.001, **extra}
    with opened(table(channels=(channel,))) as (found, daq):
        cells = found.device.memory._cells
        cell = cells[("holding", 20 if "status" in extra else 10)]
        good, cell.on_read = cell.on_read, lambda: value
        # a busy machine may hold the reading up for half a second
        begin(daq, settings(30))
        for _ in range(40):
            assert daq.read_block() is None
            if len(found.requests) > 5:
                break
        cell.on_read = good
        blocks = read_all(daq)
    assert gaps(blocks, 30) >= 3
    assert all(abs(b.values).max() < 32.0 for b in blocks if len(b))


def test_a_sign_in_another_register_is_taken_along():
    sign = {"address": 20, "bit": 7}
    channel = {**TORQUE, "type": "u32", "scale": 1e-4, "sign": sign, "low": -10.0, "high": 10.0}
    with opened(table(channels=(channel,))) as (found, daq):
        cells = found.device.memory._cells
        cells["holding", 10].on_read = lambda: 12345.0
        for word, volts in ((128.0, -1.2345), (1.0, 1.2345)):
            cells["holding", 20].on_read = lambda word=word: word
            assert daq.snapshot()["torque"] == pytest.approx(volts)


def test_an_output_is_written_within_its_limits_and_read_back():
    with opened(driving()) as (found, daq):
        assert daq.write_output("reference", 1.2344) == pytest.approx(1.234)
        assert found.instrument.reference_v == pytest.approx(1.234)
        assert found.written[-1].hex() == "06003204d2"
        before = len(found.written)
        for value in (5.1, -5.1, float("nan")):
            with pytest.raises(UsageError, match="needed: -5 to 5 V"):
                daq.write_output("reference", value)
        assert len(found.written) == before


def test_a_write_whose_echo_is_wrong_counts_by_what_stands_there():
    with served(driving()) as found:
        mangler = Mangler("echo", TcpFraming(), seed=1)
        with behind(found.address, mangler) as near, driver(driving(), near, deadline_s=0.3) as daq:
            assert daq.write_output("reference", 2.0) == pytest.approx(2.0)
            assert mangler.changed == 1
            # sent once all the same
            assert len(found.written) == 1
            found.device.memory._cells[("holding", 50)].on_read = lambda: 700.0
            with pytest.raises(DeviceError, match=r"reads back as 0\.7 V; written: 1 V"):
                daq.write_output("reference", 1.0)


def test_the_watchdog_stops_the_motor_when_nobody_feeds_it():
    with opened(COUPLER) as (found, daq):
        daq.configure(settings(1, roles=()))
        assert daq.arm_watchdog(0.2) == pytest.approx(0.2)
        daq.write_output("reference", 1.0)
        assert daq.enable(on=True)
        for _ in range(6):
            time.sleep(0.05)
            daq.feed_watchdog()
        assert not daq.watchdog().tripped
        assert found.instrument.reference_v == pytest.approx(1.0, abs=1e-3)
        # reading its state feeds nothing
        until(lambda: daq.watchdog().tripped, 1.0)
        assert (found.instrument.reference_v, found.instrument.enabled) == (0.0, False)
        with pytest.raises(DeviceError, match="device failure"):
            daq.write_output("reference", 0.5)
        assert daq.safe_state().confirmed
        daq.arm_watchdog(0.2)
        assert daq.enable(on=True)


def test_the_safe_state_is_reached_from_motion():
    with opened(COUPLER) as (found, daq):
        daq.configure(settings(1, roles=()))
        daq.arm_watchdog(1.0)
        daq.write_output("reference", 1.0)
        daq.enable(on=True)
        watch = Stopwatch()
        safe = daq.safe_state()
        assert watch.s < 0.5
        assert (safe.confirmed, safe.reference_v) == (True, 0.0)
        assert (found.instrument.reference_v, found.instrument.enabled) == (0.0, False)


def test_the_safe_state_is_not_confirmed_when_nobody_answers():
    with opened(COUPLER, deadline_s=0.1) as (found, daq):
        daq.configure(settings(1, roles=()))
        found.call(lambda: setattr(found.device, "hears", lambda _: False))
        assert "no valid reply" in not_made_safe(daq).detail


def test_a_late_reply_on_a_serial_line_is_never_another_reading():
    """The device counts its requests; a reply that comes in the next one's time is 1 too low."""
    made = table(
        channels=({**TORQUE, "type": "u32"}, {"role": "tacho", "address": 12, "type": "u32"}),
        identify=({"address": 14, "type": "u16", "equals": 4660},),
    )
    with served(made, wire="rtu") as found:
        found.device.memory._cells["holding", 10].on_read = lambda: float(len(found.requests))
        mangler = Mangler("late", RtuFraming(crc16), share=0.0, seed=2, late_s=0.2)
        wrong = good = 0
        with behind(found.address, mangler) as near, driver(made, near, deadline_s=0.6) as daq:
            daq.identity()
            mangler.share = 0.4
            for _ in range(12):
                before = len(found.requests)
                try:
                    value = daq.snapshot()["torque"]
                except DeviceError:
                    continue
                good += 1
                wrong += not value > before
        assert mangler.changed >= 3
        assert (good > 2, wrong) == (True, 0)


def test_a_deadline_too_short_for_a_serial_line_is_refused():
    """At 9600 bit/s 8E1 a 32-bit float takes 27.5 ms: 50 ms and three of them in 0.35 of it."""
    with pytest.raises(ProfileError, match=r"0\.2 s; on this line .* within 0\.38 s"):
        driver(table(), "rtu:///dev/none?baud=9600", deadline_s=0.2)


def test_another_device_is_never_written_to_not_even_to_make_it_safe():
    what = driving(init=({"address": 70, "value": 5.0},))
    wrong = what.identify[0].model_copy(update={"equals": 7})
    with served(what) as device:
        with driver(what, device.address, identify=(wrong,)) as daq:
            with pytest.raises(DeviceError, match="reads 4660; needed: 7"):
                daq.configure(settings(3))
            assert "4660" in not_made_safe(daq).detail
        assert device.written == []
        with driver(what, device.address) as daq:
            assert daq.safe_state().reference_v == 0.0
        assert device.written != []
