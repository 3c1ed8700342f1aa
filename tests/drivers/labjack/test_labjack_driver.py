"""The driver against the emulated T7, on the wire."""

import math
import time

import numpy as np
import pytest
from labjackkit import PROFILE, claimed, driver, served, settings, turning
from nodekit import until
from served import acquired, begin, gaps, not_made_safe, read_all, swap_words, values

from hdbench.drivers.labjack.driver import labjack_rate_hz
from hdbench.drivers.labjack.emulator import streaming
from hdbench.drivers.labjack.outputs import KEY
from hdbench.drivers.labjack.registers import dac, digital_line
from hdbench.drivers.labjack.table import LabJackOutput
from hdbench.errors import BusyError, DeviceError, ProfileError, UsageError

TORQUE = PROFILE.daq.channels[0]


def _output(name, enable_line, limit_v=8.0):
    return LabJackOutput(output=name, limit_v=limit_v, enable_line=enable_line)


def test_every_sample_asked_for_comes_once_and_in_order():
    with claimed(speed=4.0) as (device, daq):
        blocks = acquired(daq, settings(1500))
        assert gaps(blocks, 1500) == 0
        assert [block.running for block in blocks] == [True] * (len(blocks) - 1) + [False]
        assert blocks[-1].depth == 0
        again = daq.read_block()
        assert (len(again), again.running, again.depth) == (0, False, 0)
        assert not device.device.stream.running, "the driver stops the stream by itself"


def test_volts_are_those_at_the_terminals_by_the_devices_own_constants():
    # the same bench read out directly: what stands at the terminals, to a step of the converter
    with served(speed=4.0, seed=5) as device:
        taken = device.noted_samples()
        with driver(device.port) as daq:
            daq.claim()
            read = values(acquired(daq, settings(400)))
        with driver(device.port, calibration="nominal") as daq:
            nominal = values(acquired(daq, settings(100)))
    for column, name in enumerate(("torque", "tacho", "current", "reference")):
        true = np.concatenate([samples.volts[name] for samples in taken])[:400]
        # half a step of 0.316 mV, and constants that travel as 32-bit floats
        assert np.max(np.abs(read[:, column] - true)) < 0.5 * 3.2e-4 + 1e-6, name
    # the constants of this device are off by up to 0.2 %: the nominal ones show it
    assert not np.isclose(np.mean(nominal[:, 0]), np.mean(read[:100, 0]), rtol=1e-4, atol=0)


def test_the_encoder_is_exact_over_32_bits_and_both_words_belong_together():
    with claimed(speed=4.0) as (device, daq):
        # a counter just below a turn of its low word, zero, and the end of its 32 bits
        for start in (65_000, -600, 2**31 - 600):
            device.call(lambda s=start: setattr(device.instrument, "_count_offset", s))
            # 1 s of this computer's time, so that the motion begins well before their end
            turning(daq, 4000, 4.0)
            blocks = read_all(daq)
            counts = values(blocks)[:, 4]
            assert counts[0] == start
            steps = (np.diff(counts) + 2**31) % 2**32 - 2**31
            # a busy machine may lose scans: each step is held against its own number of periods
            firsts = [np.arange(len(block)) + block.first_index for block in blocks]
            periods = np.diff(np.concatenate(firsts))
            # 8 V command at most 400 rad/s: 0.26 counts per ms and rad/s
            assert np.all((steps >= -1) & (steps <= 300 * periods))
            assert np.sum(steps) > 5_000
            assert daq.safe_state().confirmed


def test_a_single_reading_of_the_counter_has_its_sign():
    with claimed() as (device, daq):
        device.call(lambda: setattr(device.instrument, "_count_offset", -600))
        daq.configure(settings(10))
        time.sleep(0.02)
        assert daq.snapshot()["encoder"] == -600


def test_configuring_writes_flash_once_and_never_again():
    with claimed() as (device, daq):
        assert daq.arm_watchdog(1.0) == 1.0
        written = device.device.watchdog.flash_writes
        assert written > 0
        daq.arm_watchdog(1.0)
        daq.arm_watchdog(0.4)
        assert device.device.watchdog.flash_writes == written, "whole seconds, rounded up"
    with claimed() as (device, daq):
        daq.configure(settings(10))
        assert device.device.watchdog.flash_writes == 0, "no run without motion writes flash"


def test_the_watchdog_settings_are_those_that_a_silent_host_needs():
    with claimed() as (device, daq):
        daq.arm_watchdog(2.0)
        memory = device.device.memory
        assert [memory.value(a) for a in (61600, 61604, 61610, 61620)] == [1, 2, 1, 0]
        assert memory.value(61612) == KEY
        # line 4 is driven low, and no other line is touched
        assert [memory.value(a) for a in (61630, 61632, 61634)] == [1, 0, 1 << 4]
        assert int(memory.value(61636)) == (1 << 23) - 1 - (1 << 4)


def test_a_stream_reader_alone_does_not_keep_the_motor_alive():
    with claimed() as (device, daq):
        turning(daq, 4000, 1.0)
        for now_s, trips in ((0.5, 0), (0.99, 0), (1.01, 1)):
            device.watchdog_clock.now_s = now_s
            block = None
            for _ in range(10):
                daq.watchdog()
                block = daq.read_block() or block
            assert device.device.watchdog.trips == trips
        assert block.watchdog_tripped
        assert not device.instrument.enabled
        assert daq.watchdog().tripped
        daq.clear_watchdog()
        assert not daq.watchdog().tripped
        assert daq.safe_state().confirmed


def test_feeding_keeps_the_motor_alive_and_tells_a_trip():
    with claimed() as (device, daq):
        daq.arm_watchdog(1.0)
        daq.enable(on=True)
        for _ in range(8):
            device.watchdog_clock.now_s += 0.9
            daq.feed_watchdog()
        assert device.instrument.enabled
        assert not daq.watchdog().tripped
        device.call(lambda: device.device._set_line(4, high=False))
        daq.feed_watchdog()
        assert daq.watchdog().tripped


def test_an_output_reads_back_where_the_device_can():
    output = _output("DAC0", 4, limit_v=4.0)
    table = PROFILE.daq.model_copy(update={"output": output})
    with served(table=table) as device, driver(device.port, output=output) as daq:
        daq.claim()
        assert daq.write_output("reference", 2.5) == pytest.approx(2.5, abs=1e-6)
        assert device.instrument.reference_v == 2.5
        assert daq.capabilities().watchdog.drops == ("reference", "enable")
        for wrong in (-0.1, 4.1, math.nan, math.inf):
            with pytest.raises(UsageError, match=r"0 to 4 V"):
                daq.write_output("reference", wrong)
        assert device.instrument.reference_v == 2.5, "a refused value changes nothing"
        device.device.memory._cells["holding", dac(0).address].on_read = lambda: 1.0
        with pytest.raises(DeviceError, match="reads back as 1 V"):
            daq.write_output("reference", 2.0)


def test_a_tick_dac_gives_both_signs_and_shows_in_the_looped_back_reference():
    with claimed() as (device, daq):
        assert daq.write_output("reference", -3.25) == -3.25
        time.sleep(0.05)
        assert daq.snapshot()["reference"] == pytest.approx(-3.25, abs=2e-3)
        assert device.instrument.reference_v == -3.25


def test_single_readings_and_a_stream_exclude_each_other():
    with claimed() as (_, daq):
        assert set(daq.snapshot()) == {"torque", "tacho", "current", "reference", "encoder"}
        begin(daq, settings(5000))
        assert daq.snapshot() == {}
        daq.stop()
        assert len(daq.snapshot()) == 5


@pytest.mark.parametrize(
    ("product", "swap", "changes", "said"),
    [
        (8.0, False, {}, "a T8 answers"),
        (4.0, False, {}, "a T4 answers; the profile names a T7"),
        (7.0, True, {}, "words are swapped"),
        (7.0, False, {"serial_number": 99}, "the profile names 99"),
    ],
)
def test_nothing_is_written_to_another_device(product, swap, changes, said):
    with served() as device:
        device.device.memory.put(60000, product)
        if swap:
            swap_words(device.device.memory)
        writes = []
        device.device.memory.write = lambda *parts: writes.append(parts)
        with driver(device.port, **changes) as daq:
            with pytest.raises(DeviceError, match=said):
                daq.claim()
            with pytest.raises(DeviceError, match=said):
                daq.configure(settings(10))
            not_made_safe(daq)
        assert writes == []


def test_a_living_host_keeps_the_bench_and_a_dead_one_loses_it():
    with served() as device, driver(device.port) as first:
        first.claim()
        with driver(device.port) as second, pytest.raises(BusyError, match="alive"):
            second.claim()
        # the first host dies with its motor on and its stream running
        begin(first, settings(60_000))
        first.enable(on=True)
        first.write_output("reference", 1.0)
        first._session._ended.set()
        first._session._thread.join()
        first._session._thread = None
        with driver(device.port) as third:
            third.claim()
            assert not device.device.stream.running
            assert not device.instrument.enabled
            assert device.instrument.reference_v == 0.0


def test_another_programs_stream_is_left_alone_until_somebody_stops_it():
    with served() as device:
        with driver(device.port) as daq:
            daq.claim()
            begin(daq, settings(60_000))
        assert not device.device.stream.running, "a host that closes stops its own"
        device.call(lambda: device.device.memory.write("holding", 4990, b"\0\0\0\1"))
        with driver(device.port) as daq:
            with pytest.raises(BusyError, match="stream running"):
                daq.claim()
            assert device.device.stream.running
            assert daq.safe_state().confirmed
            daq.claim()
            daq.claim()
            assert values(acquired(daq, settings(50))).shape == (50, 5)


def test_the_devices_own_error_code_is_in_the_message(monkeypatch):
    # a device that is slower than its data sheet says
    monkeypatch.setitem(streaming._LIMIT_HZ, "T7", 50_000.0)
    with claimed() as (_, daq):
        daq.configure(settings(100, period_s=1.25e-4))
        with pytest.raises(DeviceError, match=r"STREAM_SCAN_RATE_INVALID \(2608\)") as caught:
            daq.start()
        assert "STREAM_ENABLE (4990)" in caught.value.where


def test_the_actual_period_is_the_devices_and_a_rate_it_cannot_keep_is_refused():
    with claimed() as (device, daq):
        assert daq.configure(settings(10, period_s=7e-4)) == pytest.approx(7e-4, rel=1e-7)
        # 1/3000 s is no multiple of 100 ns: 3333 or 3334 of them are within 2e-4
        assert daq.configure(settings(10, period_s=1 / 3000)) == pytest.approx(3333e-7, rel=1e-7)
        device.device.memory._cells["holding", 4002].on_read = lambda: 1001.0
        with pytest.raises(DeviceError, match="scans at 1001 Hz"):
            daq.configure(settings(10))


def test_the_safe_state_stops_a_turning_motor_and_proves_it():
    with claimed() as (device, daq):
        turning(daq, 60_000, 2.0)
        until(lambda: device.instrument.velocity_rad_s >= 100.0, 60.0)
        safe = daq.safe_state()
        assert safe.confirmed
        assert abs(safe.reference_v) < 0.01
        assert abs(safe.velocity_rad_s) < 0.5
        # true speed, a moment later: the rest of an exponential
        assert abs(device.instrument.velocity_rad_s) < 0.5
        assert not device.device.stream.running


def test_a_safe_state_that_cannot_be_seen_is_not_confirmed():
    with claimed() as (device, daq):
        # an enable line that is stuck on
        device.device.memory._cells["holding", digital_line(4).address].on_read = lambda: 1
        safe = not_made_safe(daq)
        assert "still enabled" in safe.detail
    with driver(1) as nobody:
        safe = not_made_safe(nobody)
        assert safe.reference_v is None
        assert "no connection" in safe.detail


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"model": "T8"}, "T8 is not supported"),
        ({"output": _output("TDAC0", 4)}, "the encoder has"),
        ({"output": _output("TDAC2", 1)}, "to the encoder"),
        ({"output": _output("TDAC2", 3)}, "LJTick-DAC"),
        ({"channels": PROFILE.daq.channels[4:]}, "no analog input"),
        ({"channels": (TORQUE.model_copy(update={"range_v": 5.0}),)}, "T7 has 10, 1, 0.1, 0.01 V"),
        ({"channels": (TORQUE.model_copy(update={"negative": 5}),)}, "even input against the next"),
    ],
)
def test_a_profile_that_the_device_cannot_carry_out_is_refused_before_it_is_opened(changes, said):
    with pytest.raises(ProfileError, match=said):
        driver(1, **changes)


def test_the_plan_is_told_what_the_device_sustains():
    # 100 kS/s of a T7 over nine words a scan: five channels, the lines, the core timer
    assert labjack_rate_hz(PROFILE.daq) == pytest.approx(100_000 / 9)
    t4 = PROFILE.daq.model_copy(update={"model": "T4", "channels": PROFILE.daq.channels[:1]})
    assert labjack_rate_hz(t4) == pytest.approx(50_000 / 4)


def test_only_registers_of_the_driver_are_ever_written():
    with served(speed=4.0) as device:
        writes = device.noted_writes()
        with driver(device.port) as daq:
            daq.claim()
            acquired(daq, settings(100))
            daq.arm_watchdog(1.0)
            daq.enable(on=True)
            daq.write_output("reference", 0.5)
            daq.feed_watchdog()
            daq.safe_state()
    stream = {*range(4002, 4030), *range(4100, 4356), 4990}
    watchdog = {*range(61600, 61654)}
    inputs = {*range(40000, 40500), *range(41000, 41250), *range(44000, 44200)}
    outputs = {30004, 2004}
    memory = {46100, 46102, 61810}
    assert set(writes) <= stream | watchdog | inputs | outputs | memory


def test_a_t4_measures_the_same_bench_with_its_twelve_bits():
    changes = {"model": "T4", "output": _output("TDAC6", 8)}
    table = PROFILE.daq.model_copy(update=changes)
    with served(speed=4.0, table=table) as device, driver(device.port, **changes) as daq:
        assert daq.identity().model == "T4"
        daq.claim()
        turning(daq, 4000, 2.0)
        read = values(read_all(daq))
        # 16 steps of 0.324 mV are one of the converter's
        assert np.max(read[:, 3]) == pytest.approx(2.0, abs=0.5 * 16 * 3.3e-4)
        assert np.max(read[:, 1]) == pytest.approx(2.0, abs=0.01)
        assert read[-1, 4] > read[0, 4]
        assert daq.safe_state().confirmed
        assert not device.instrument.enabled
    with pytest.raises(ProfileError, match="always goes on"):
        driver(1, auto_recover=False, **changes)


def test_after_a_lost_connection_another_labjack_at_the_address_is_never_written_to():
    with claimed() as (device, daq):
        daq.write_output("reference", 1.0)
        daq.control._link.close()
        device.device.memory.put(60028, 470_000_001)
        safe = not_made_safe(daq)
        assert "another device" in safe.detail
        assert device.instrument.reference_v == 1.0
        device.device.memory.put(60028, int(daq.identity().serial))
        assert daq.safe_state().confirmed
