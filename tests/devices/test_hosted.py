"""A bench made of a DAQ: demands, reference, watchdog, counts, standstill."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from daqkit import ABLE, ROLES, SETTINGS, TACHO, Clock, FakeDaq, block
from hypothesis import given
from hypothesis import settings as given_settings
from hypothesis import strategies as st
from nodekit import until
from served import begin

from hdbench.devices import AcquisitionSettings
from hdbench.devices.host.bench import HostedBench, SampleClock, Unwrap
from hdbench.devices.host.control import ControlThread, HostReference, ReferenceLog
from hdbench.errors import DeviceError, UsageError
from hdbench.profile.schema import ReferenceWave
from hdbench.profile.waves import ProgramPart, ReferenceProgram

WAVE = ReferenceWave(wave="constant", amplitude_v=2.0)
ASKED = AcquisitionSettings(1e-3, 1000, WAVE)
STILL = AcquisitionSettings(1e-3, 1000, None)


def bench(daq=None, settings=SETTINGS):
    daq = daq or FakeDaq()
    return HostedBench(daq, settings, clock=daq.clock, sleep=daq.clock.sleep)


def started(made, asked=STILL):
    """Return a bench that samples."""
    begin(made, asked)
    return made


# -- demands --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("able", "settings", "asked", "words", "key"),
    [
        ({}, {}, replace(STILL, sample_period_s=1e-4), "3 channels at 10000 Hz.*2500", "daq"),
        ({}, {}, replace(STILL, sample_period_s=2.0), "1 to 2500 Hz", "sample_period_s"),
        ({"inputs": ABLE.inputs[:1]}, {}, STILL, "no channel tacho", "channels"),
        ({"reference": False}, {}, ASKED, "no output", "driver"),
        ({"watchdog": None}, {}, ASKED, "no watchdog", "driver"),
        # one that drops no output
        ({"watchdog": replace(ABLE.watchdog, drops=())}, {}, ASKED, "no watchdog", "driver"),
        ({}, {"watchdog_s": 9.0}, ASKED, "0.1 to 5 s", "watchdog_s"),
        ({}, {"roles": ("torque",)}, ASKED, "run away", "channels"),
    ],
)
def test_what_a_device_cannot_do_is_told_before_anything_is_written(
    able, settings, asked, words, key
):
    daq = FakeDaq(replace(ABLE, **able))
    with pytest.raises(DeviceError, match=words) as caught:
        bench(daq, replace(SETTINGS, **settings)).configure(asked)
    assert key in caught.value.where
    assert caught.value.fix
    assert daq.calls == daq.written == []


def test_a_device_that_samples_at_another_period_is_refused():
    with pytest.raises(DeviceError, match=r"every 0\.001001 s; asked for 0\.001 s"):
        bench(FakeDaq(period_s=1.001e-3)).configure(STILL)


def test_a_generator_gets_the_reference_and_nothing_is_written_from_here():
    daq = FakeDaq(replace(ABLE, generator=True, reference=False))
    started(bench(daq), ASKED)
    assert daq.settings.reference is WAVE
    assert daq.written == []
    assert daq.calls == ["configure", "start"]


def test_a_reference_beyond_the_limit_is_refused_before_the_device_hears_of_it():
    daq = FakeDaq()
    wave = ReferenceWave(wave="sine", bias_v=5.0, amplitude_v=4.0, frequency_hz=5.0)
    with pytest.raises(UsageError, match="reaches 9 V; allowed 8 V"):
        bench(daq).configure(AcquisitionSettings(1e-3, 1000, wave))
    assert daq.calls == []


# -- channels -------------------------------------------------------------------------------------


def test_channels_that_are_not_sampled_are_nan_and_saturation_is_told_by_sample():
    daq = FakeDaq()
    made = started(bench(daq))
    marks = [[True, False, False], [False, False, True], [False, True, False]]
    daq.blocks = [block(0, [[1, 2, 65530], [3, 4, 4], [5, 6, 14]], saturated=marks)]
    found = made.read_block()
    np.testing.assert_array_equal(found.torque_v, [1, 3, 5])
    np.testing.assert_array_equal(found.tacho_v, [2, 4, 6])
    np.testing.assert_array_equal(found.encoder_count, [65530, 65540, 65550])
    assert np.isnan(found.motor_current_a).all()
    # a counter has no end of range
    assert found.saturated.tolist() == [True, False, True]
    assert found.time_s is None


def test_a_polled_device_tells_the_time_of_every_sample():
    daq = FakeDaq()
    made = started(bench(daq))
    taken = daq.clock.now_s + np.array([0.010, 0.021])
    daq.blocks = [block(0, [[1, 2, 3], [1, 2, 3]], time_s=taken)]
    np.testing.assert_allclose(made.read_block().time_s, [0.010, 0.021], atol=1e-12)


@given_settings(max_examples=200, deadline=None)
@given(
    steps=st.lists(st.integers(-(2**15) + 1, 2**15 - 1), min_size=1, max_size=60),
    first=st.integers(0, 2**16 - 1),
    cut=st.integers(0, 60),
)
def test_counts_are_unwrapped_at_any_place_of_any_block(steps, first, cut):
    true = first + np.concatenate(([0], np.cumsum(steps)))
    unwrap = Unwrap(2**16)
    wrapped = (true % 2**16).astype(float)
    found = np.concatenate([unwrap(wrapped[:cut]), unwrap(wrapped[cut:])])
    np.testing.assert_array_equal(found, true)


# -- time -----------------------------------------------------------------------------------------


def test_samples_are_placed_between_the_start_and_the_earliest_arrival():
    """True offset 10.003 s; arrivals are late by 2 ms to 30 ms, a device clock is 200 ppm slow."""
    random = np.random.default_rng(3)
    period, true = 1e-3, 10.003
    clock = SampleClock(period, before_s=10.0, after_s=10.006)
    for newest in range(20, 60_000, 20):
        arrived = true + newest * period * (1 + 200e-6) + random.uniform(0.002, 0.03)
        clock.seen(newest, arrived)
        taken = true + newest * period * (1 + 200e-6)
        # its own doubt, and how the earliest of 64 arrivals scatters: 28 ms / 64, a few times
        assert abs(clock.offset_s + newest * period - taken) < clock.doubt_s + 0.003
    assert clock.doubt_s <= 0.5 * (0.006 + period)


def test_the_reference_of_a_sample_is_what_stood_there_at_its_time():
    log = ReferenceLog(100.0, 0.0)
    log.add(100.010, 100.012, 1.0)
    log.add(100.020, 100.024, 2.0)
    found = log.at(np.array([100.0, 100.0109, 100.0111, 100.0219, 100.0221, 107.0]))
    np.testing.assert_array_equal(found, [0, 0, 1, 1, 2, 2])


def test_a_long_log_forgets_what_no_sample_asks_for():
    log = ReferenceLog(0.0, 0.0)
    for k in range(1, 5000):
        log.add(0.01 * k, 0.01 * k, float(k))
        assert log.at(np.array([0.01 * k + 0.001]))[0] == k
    assert len(log._time_s) < 100


# -- reference ------------------------------------------------------------------------------------


def test_the_reference_holds_each_value_for_a_period_and_ends_with_zero():
    program = ReferenceProgram((ProgramPart(10, 0.0, 1.0), ProgramPart(5, 1.0, 1.0)))
    made = HostReference(program, 0.1, 15, limit_v=2.0, slew_v_per_s=1e6)
    values = [made.value_v(0.1 * k + 0.05, 0.0, 1.0) for k in range(-1, 17)]
    # a part of ten samples goes linearly from its start: 0, 0.1, ... 0.9
    np.testing.assert_allclose(values[1:16], [*(0.1 * np.arange(10)), *5 * [1.0]], atol=1e-12)
    assert [values[0], *values[16:]] == [0.0, 0.0, 0.0]


def test_the_reference_changes_no_faster_than_its_slew():
    made = HostReference(WAVE, 1e-3, 1000, limit_v=8.0, slew_v_per_s=10.0)
    assert made.value_v(0.5, 0.0, 0.01) == pytest.approx(0.1)
    assert made.value_v(0.5, 1.95, 0.01) == 2.0
    assert made.value_v(5.0, 2.0, 0.01) == pytest.approx(1.9)


# -- the control thread, in real time -------------------------------------------------------------


class RealClock(Clock):
    def __call__(self):
        self.now_s = time.monotonic()
        return self.now_s


def moving():
    """Return a device whose motor turns, and its bench, in real time."""
    daq = FakeDaq(clock=RealClock())
    made = started(HostedBench(daq, SETTINGS), ASKED)
    until(lambda: daq.reference_v == 2.0, 3.0)
    return daq, made


def running(daq):
    log = ReferenceLog(daq.clock(), 0.0)
    reference = HostReference(WAVE, 1e-3, 100_000, limit_v=8.0, slew_v_per_s=1e6)
    control = ControlThread(daq, reference, log, update_s=0.01, watchdog_s=0.4)
    control.start(time.monotonic())
    return control, log


def test_the_watchdog_is_fed_in_time_while_the_session_takes_samples():
    daq = FakeDaq(clock=RealClock())
    control, log = running(daq)
    end_s = time.monotonic() + 0.8
    while time.monotonic() < end_s:
        control.seen()
        time.sleep(0.02)
    control.check()
    control.halt()
    fed = np.diff(daq.fed_s)
    # a quarter of 0.4 s and one turn of 10 ms; a busy computer may hold single ones up
    assert len(fed) >= 4
    assert np.median(fed) < 0.1 + 0.01 + 0.15
    assert log.at(np.array([time.monotonic()]))[0] == 2.0


def test_a_session_that_hangs_stops_the_motor_and_starves_the_watchdog():
    daq = FakeDaq(clock=RealClock())
    start_s = time.monotonic()
    control, _ = running(daq)
    assert until(lambda: daq.written and daq.written[-1][1] == 0.0, 3.0) < 0.5 + 0.2
    assert time.monotonic() - start_s >= 0.5
    fed = len(daq.fed_s)
    time.sleep(0.15)
    assert len(daq.fed_s) == fed, "not fed any more"
    with pytest.raises(DeviceError, match="nobody has taken samples"):
        control.check()
    control.halt()


def test_a_turn_that_comes_late_is_no_control():
    control, _ = running(FakeDaq(clock=RealClock()))
    assert control.halt()
    control._check_session(control._seen_s, 0.19)
    with pytest.raises(DeviceError, match=r"came 0.21 s late; allowed 0.2 s"):
        control._check_session(control._seen_s, 0.21)


def test_a_device_that_refuses_a_write_ends_the_thread_with_its_error():
    daq = FakeDaq(clock=RealClock())
    daq.refuse = "output broken"
    control, _ = running(daq)
    until(lambda: not control._thread.is_alive(), 3.0)
    with pytest.raises(DeviceError, match="output broken"):
        control.check()
    assert daq.fed_s == []


@pytest.mark.parametrize("call", ["write_output", "feed_watchdog"])
@pytest.mark.parametrize("error", [OSError(5, "Input/output error"), ZeroDivisionError("bug")])
def test_any_end_of_the_control_thread_zeroes_the_output_and_ends_the_run(call, error):
    daq, made = moving()
    works, fails = getattr(daq, call), [error]

    def fail_once(*given):
        if fails:
            raise fails.pop()
        return works(*given)

    setattr(daq, call, fail_once)
    # another value than the one that stands there is written
    made._control._last_v = 1.0
    made._control.seen()
    until(lambda: not made._control._thread.is_alive(), 3.0)
    assert daq.reference_v == 0.0
    with pytest.raises(DeviceError, match=f"{type(error).__name__}.*{error.args[-1]}") as caught:
        made.read_block()
    assert caught.value.__cause__ is error
    # an end between the last samples and the stop is told, too
    with pytest.raises(DeviceError, match=type(error).__name__):
        made.stop()
    assert not daq.enabled


def test_a_value_that_was_on_its_way_at_the_stop_is_followed_by_another_zero(monkeypatch):
    monkeypatch.setattr("hdbench.devices.host.control._JOIN_S", 0.1)
    daq, made = moving()
    works, held, hangs = daq.write_output, threading.Event(), threading.Event()

    def late(*given):
        hangs.set()
        held.wait(5.0)
        return works(*given)

    daq.write_output = late
    made._control._last_v = 1.0
    assert hangs.wait(1.0)
    threading.Timer(0.15, held.set).start()
    assert made.safe_state().confirmed
    assert daq.written[-1][1] != 0.0, "the value came after the halt"
    assert daq.calls.count("safe") == 2
    assert daq.reference_v == 0.0


# -- start, stop, safe state ----------------------------------------------------------------------


def test_a_motion_begins_with_watchdog_zero_and_enable_and_ends_the_other_way():
    daq, made = moving()
    assert daq.written[0][1] == 0.0, "zero before the drive is enabled"
    made.stop()
    assert daq.calls == ["configure", "arm", "enable", "start", "stop", "disable", "clear"]
    assert daq.reference_v == 0.0
    assert made._control is None


def test_a_limit_in_the_samples_stops_the_motor_before_the_session_asks_again():
    daq, made = moving()
    daq.blocks = [block(0, [[0.0, 401.0 / TACHO, 0]])]
    made.read_block()
    until(lambda: daq.reference_v == 0.0, 0.4)
    with pytest.raises(DeviceError, match=r"motor speed \+401 rad/s crossed"):
        made.read_block()
    assert made.safe_state().confirmed


def test_the_reference_that_was_written_stands_beside_every_sample():
    daq, made = moving()
    time.sleep(0.05)
    now_s = time.monotonic()
    n = int((now_s - made._start_s) / 1e-3)
    daq.blocks = [block(0, [[0, 0, 0]] * n, read_s=(now_s, now_s))]
    found = made.read_block().reference_v
    made.stop()
    assert found[-1] == 2.0
    assert set(found) <= {value for _, value in daq.written}
    assert np.all(np.diff(found) >= 0.0)


def test_the_safe_state_needs_the_motor_seen_standing():
    daq = FakeDaq(stuck_speed_v=0.02 / 1.0)
    safe = bench(daq).safe_state()
    assert not safe.confirmed
    assert safe.velocity_rad_s == pytest.approx(0.02 * TACHO)
    assert "turns at 1 rad/s" in safe.detail
    daq.stuck_speed_v = 0.0
    safe = bench(daq).safe_state()
    assert safe.confirmed
    assert "standing" in safe.detail


def test_a_device_that_does_not_answer_leaves_the_safe_state_unconfirmed():
    safe = bench(FakeDaq(refuse="silent")).safe_state()
    assert (safe.confirmed, safe.detail) == (False, "silent")


def test_a_device_that_drives_nothing_needs_no_standstill():
    daq = FakeDaq(replace(ABLE, reference=False), stuck_speed_v=5.0)
    assert bench(daq).safe_state().confirmed


def test_the_order_of_channels_is_that_of_the_profile():
    daq = FakeDaq()
    roles = ("encoder", "torque")
    made = started(bench(daq, replace(SETTINGS, roles=roles)))
    assert daq.settings.roles == roles
    daq.blocks = [block(0, [[7, 1.5]], roles=roles)]
    found = made.read_block()
    assert (found.encoder_count[0], found.torque_v[0]) == (7, 1.5)
    assert roles != ROLES
