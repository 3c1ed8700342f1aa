"""What a log holds of the motion: a velocity that was smoothed, a speed that ripples."""

from dataclasses import replace

import numpy as np
import pytest
from discovery_records import PROFILE, prepared
from scipy.signal import butter, sosfiltfilt
from swinging_shaft import COUNT, INERTIA, counted, reversing, swing, trace_of

from hdbench.diagnosis import diagnose_trace
from hdbench.diagnosis.discovery.acceleration import (
    in_step,
    seen_acceleration,
    seen_velocity,
    times_by_shaft,
)
from hdbench.diagnosis.discovery.bands import LowPass, make_bands, smoothed
from hdbench.diagnosis.discovery.fit import fixed_of
from hdbench.diagnosis.discovery.record import as_followed, on_clock
from hdbench.diagnosis.dynamic import make_ready, make_task
from hdbench.model import motion_from_trace
from hdbench.records import Trace

TASK = make_task(PROFILE)
COULOMB_NM, VISCOUS = 0.8, 0.006


def reversing_log(cutoff_hz, n=12_000, seed=3):
    """Return a trace of speed ramps that reverse; the velocity comes of a counted angle."""
    rng = np.random.default_rng(seed)
    time = np.arange(n) * 1e-3
    # constant accelerations between random speeds: 20 ramps with rests
    knots = np.arange(0.0, time[-1] + 0.4, 0.4)
    speeds = rng.uniform(-80.0, 80.0, len(knots))
    speeds[::5] = 0.0
    speed = np.interp(time, knots, speeds)
    acceleration = (np.diff(speeds) / 0.4)[np.minimum((time / 0.4).astype(int), len(knots) - 2)]
    angle = np.concatenate([[0.0], np.cumsum(0.5e-3 * (speed[1:] + speed[:-1]))])
    torque = INERTIA * acceleration + COULOMB_NM * np.tanh(speed / 0.3) + VISCOUS * speed
    torque += 0.02 * rng.standard_normal(n)
    torque += 0.1 * np.cos(2.0 * angle) + 0.05 * np.cos(4.0 * angle)
    turned = angle + 1e-4 * rng.standard_normal(n)
    read = np.gradient(turned, time)
    if cutoff_hz is not None:
        read = sosfiltfilt(butter(4, cutoff_hz, fs=1000.0, output="sos"), read)
    return trace_of(time, read, turned, torque)


@pytest.mark.parametrize("cutoff_hz", [pytest.param(25.0, marks=pytest.mark.campaign), 60.0])
def test_a_smoothed_velocity_brings_no_name_but_friction(cutoff_hz):
    found = diagnose_trace(reversing_log(cutoff_hz), PROFILE)
    assert found.settings["motion_known_hz"] < 2.0 * cutoff_hz
    assert {cause.name for cause in found.causes} == {"coulomb-friction", "viscous-friction"}


def test_where_a_smoothed_velocity_parts_from_the_angle_nothing_slips():
    # seven ramps end faster than a zero-phase filter at 25 Hz follows
    assert make_ready(TASK, reversing_log(25.0)).inspected.faults == ()


def test_a_velocity_with_noise_to_the_end_limits_nothing():
    assert make_ready(TASK, reversing_log(None, n=6000)).record.motion_passed == 1.0


def test_smoothing_keeps_what_is_slow_and_takes_what_is_fast():
    time = np.arange(4000) * 1e-3
    slow, fast = np.cos(2.0 * np.pi * 10.0 * time), np.cos(2.0 * np.pi * 110.0 * time)
    left = smoothed((slow + fast)[:, None], 0.2)[:, 0]
    assert left[500:-500] == pytest.approx(slow[500:-500], abs=1e-3)


def rippling_speed(size_rad, n=12_000):
    """Return a trace of a speed that ripples at order 4, and its acceleration, in closed form."""
    rng, time = np.random.default_rng(4), np.arange(n) * 1e-3
    speed, turned, inertial = swing(time, ripple=())
    phase = 4.0 * turned + 0.7
    angle = turned + size_rad * np.sin(phase)
    more = 1.0 + 4.0 * size_rad * np.cos(phase)
    acceleration = inertial / INERTIA * more
    acceleration -= 16.0 * size_rad * speed**2 * np.sin(phase)
    torque = 0.4 * np.cos(2.0 * angle) + 0.2 * np.cos(4.0 * angle - 1.5)
    torque += INERTIA * acceleration + 0.01 * rng.standard_normal(n)
    tacho = np.round(speed * more + 0.05 * rng.standard_normal(n), 2)
    return trace_of(time, tacho, counted(angle, 2**16), torque), acceleration


@pytest.mark.parametrize("size_rad", [1.5e-3, 3e-3])
def test_the_torque_of_a_speed_that_ripples_is_expected(size_rad):
    trace, acceleration = rippling_speed(size_rad)
    inside = slice(100, -100)
    off = (prepared(trace).motion.acceleration_rad_s2 - acceleration)[inside]
    # the acceleration over 20 ms loses half of it
    assert off.std() < 0.02 * acceleration[inside].std()


@pytest.mark.campaign
@pytest.mark.parametrize("size_rad", [1.5e-3, 3e-3])
def test_a_speed_that_ripples_is_no_finding(size_rad):
    found = diagnose_trace(rippling_speed(size_rad)[0], PROFILE)
    assert found.causes == found.unexplained == ()


def test_a_motion_that_the_torque_does_not_have_is_not_expected():
    trace, acceleration = rippling_speed(1.5e-3)
    _, _, inertial = swing(trace.time_s, ripple=())
    ripple_nm = INERTIA * acceleration - inertial
    without = trace.with_columns(torque_nm=trace["torque_nm"] - ripple_nm)
    expected = as_followed(prepared(without)).motion.acceleration_rad_s2
    found, whole, missed = (
        np.abs(np.fft.rfft(np.hanning(len(one)) * one)) ** 2
        for one in (expected, acceleration, expected - acceleration)
    )
    # the window of 20 ms ends at 50 Hz; a cell of .2 s is 5 Hz wide
    hertz = np.fft.rfftfreq(len(acceleration), 1e-3)
    fast, slow = hertz > 60.0, hertz < 20.0
    assert found[fast].sum() < 1e-3 * whole[fast].sum()
    assert missed[slow].sum() < 1e-3 * whole[slow].sum()


def test_a_speed_that_answers_to_the_torque_tells_what_counting_hides():
    time = np.arange(20_000) * 1e-3
    speed, angle, inertial = swing(time, 60.0, ripple=())
    phase = 4.0 * angle + 0.3
    # the angle that 3 rad/s^2 for each N m of the ripple make, by parts: its first term is true to
    # the change of the speed within a ripple, 1/50
    acceleration = 30.0 * np.cos(phase)
    moved = angle - acceleration / (4.0 * speed) ** 2
    ripple, read = 10.0 * np.cos(phase), counted(moved)
    trace = trace_of(time, np.gradient(read, time), read, ripple)
    motion = replace(motion_from_trace(trace, PROFILE.data), acceleration_source="angle")
    smooth = inertial / INERTIA
    found, answer = seen_acceleration(motion, ripple, 1e-3)
    missed = found.acceleration_rad_s2 - smooth - acceleration
    assert missed[500:-500].std() > 0.5 * acceleration.std()
    assert (missed + answer)[500:-500].std() < 0.2 * acceleration.std()


def starting(time):
    """Return speed, angle and acceleration of 0 to 160 rad/s and back every 4 s."""
    phase = 0.5 * np.pi * time
    angle = 80.0 * (time - 2.0 / np.pi * np.sin(phase))
    return 80.0 * (1.0 - np.cos(phase)), angle, 40.0 * np.pi * np.sin(phase)


def test_the_noise_of_a_velocity_goes_and_the_motion_stays():
    time = 1e-3 * np.arange(20_000)
    speed, angle, _ = starting(time)
    noise = 0.05 * np.random.default_rng(4).standard_normal(len(time))
    trace = trace_of(time, speed + noise, angle, np.zeros(len(time)))
    found = seen_velocity(motion_from_trace(trace, PROFILE.data), 1e-3)
    # a motion of 3000 times the noise is above it up to the ninth side lobe of a Hann window, which
    # fall by 18 dB an octave: of 101 frequencies the noise of the lowest ten may stay
    assert np.std(found.velocity_rad_s - speed) < np.sqrt(10.0 / 101.0) * 0.05


def angle_log(error_rad, counts=10_000, n=20_000):
    """Return a trace by a counted angle with an error; the velocity is made of its differences."""
    time = 1e-3 * np.arange(n)
    _, angle, acceleration = starting(time)
    read = counted(angle + error_rad * np.cos(angle), counts)
    torque = 0.3 * np.cos(2.0 * angle) + INERTIA * acceleration
    torque += 0.01 * np.random.default_rng(7).standard_normal(n)
    return trace_of(time, np.gradient(read, time), read, torque)


@pytest.mark.parametrize("source", ["velocity", "angle"])
def test_an_acceleration_shows_of_an_error_of_the_angle_what_its_cells_keep(source):
    error = 0.01
    # steps so fine that both accelerations keep the same cells
    motions = [motion_from_trace(angle_log(e, 10**8), PROFILE.data) for e in (0.0, error)]
    none = np.zeros(len(motions[0]))
    true, wrong = (
        seen_acceleration(replace(one, acceleration_source=source), none, 1e-3)[0]
        for one in motions
    )
    wave = error * np.cos(motions[0].angle_rad)
    shown = wrong.shown_by_angle(wave)
    added = wrong.acceleration_rad_s2 - true.acceleration_rad_s2
    inside = slice(1000, -1000)
    assert np.std((added - shown)[inside]) < 1e-3 * np.std(added[inside])
    if source == "velocity":
        # differences hold back what is fast: .4 % at 160 rad/s
        angle = motions[0].angle_rad
        slope = motions[0].acceleration_rad_s2 * np.sin(angle)
        whole = -error * (motions[0].velocity_rad_s ** 2 * np.cos(angle) + slope)
        assert np.std((added - whole)[inside]) > 2e-3 * np.std(added[inside])


def test_an_error_of_a_counted_angle_beside_its_own_differences_is_no_other_cause():
    result = diagnose_trace(angle_log(0.01), PROFILE, materiality=0.0)
    assert [cause.name for cause in result.causes] == ["transmission-error"]
    size = result.causes[0].parameters["amplitude_motor_rad"]
    assert abs(size.value - 0.01) < 4.0 * size.std < 1e-3
    assert result.unexplained == ()


def test_an_angle_that_jumps_makes_no_velocity_late():
    trace, _ = rippling_speed(1.5e-3)
    kept = np.r_[0:5000, 5029 : len(trace)]
    columns = {name: values[kept] for name, values in trace.columns.items()}
    # the stamps hide that samples were lost
    columns["time_s"] = trace.time_s[: len(kept)]
    _, late = in_step(motion_from_trace(Trace(columns), PROFILE.data))
    assert late == 0.0


def test_an_error_of_the_angle_is_no_clock_that_jitters():
    time = 1e-3 * np.arange(20_000)
    speed, angle, _ = starting(time)
    # a ring that is mounted off its centre: steps would be off by up to 1.25 %
    wrong = angle + 0.0125 * np.cos(angle)
    motion = motion_from_trace(trace_of(time, speed, wrong, 0.0 * time), PROFILE.data)
    times, told = times_by_shaft(motion)
    assert told < 1e-3
    assert np.abs(np.diff(times) - 1e-3).max() < 1e-6


@pytest.mark.parametrize("jitter", [0.0, 0.1, 0.3])
def test_a_clock_that_jitters_beneath_even_stamps_is_told_by_the_shaft(jitter):
    rng, n = np.random.default_rng(6), 20_000
    steps = 1e-3 * np.exp(jitter * rng.standard_normal(n - 1))
    taken = np.concatenate([[0.0], np.cumsum(steps)])
    taken *= 1e-3 * (n - 1) / taken[-1]
    # a tacho and an encoder of 4000 counts
    speed, angle, acceleration = starting(taken)
    torque = INERTIA * acceleration + 0.02 * rng.standard_normal(n)
    tacho = np.round(speed + 0.05 * rng.standard_normal(n), 2)
    trace = trace_of(1e-3 * np.arange(n), tacho, counted(angle), torque)
    motion = motion_from_trace(trace, PROFILE.data)
    times, told = times_by_shaft(motion)
    assert told == pytest.approx(np.std(steps / steps.mean()), abs=0.02)
    # counting hides a step to half a count over the speed; at rest the stamps are all there is
    fast = speed[1:] > 40.0
    left = np.diff(times) - steps * 1e-3 * (n - 1) / steps.sum()
    assert left[fast].std() < 0.35 * COUNT / 40.0 + 1e-9
    record = prepared(trace, masked=~motion.valid)
    assert record.clock_jitter == pytest.approx(told, abs=0.02)
    np.testing.assert_array_equal(record.motion.time_s, trace.time_s)
    assert (record.taken_s is None) == (jitter == 0.0)
    if record.taken_s is not None:
        np.testing.assert_array_equal(record.taken_s, times)


@pytest.mark.parametrize("stamped", [pytest.param(True, marks=pytest.mark.campaign), False])
def test_a_filter_of_the_torque_runs_over_the_time_of_uneven_samples(stamped):
    # ripple up to 100 Hz behind a filter at 10 kHz with its corner at 48 Hz
    fine = 1e-4 * np.arange(80_000)
    _, angle, acceleration = starting(fine)
    ripple = 0.3 * np.cos(2.0 * angle) + 0.4 * np.cos(4.0 * angle + 1.0)
    passed = sosfiltfilt(butter(2, 48.0, fs=1e4, output="sos"), ripple + INERTIA * acceleration)
    rng = np.random.default_rng(9)
    taken = np.cumsum(1e-3 * np.exp(0.25 * rng.standard_normal(7_900)))
    taken = taken[taken < fine[-1]]
    speed, _, _ = starting(taken)
    torque = np.interp(taken, fine, passed) + 0.01 * rng.standard_normal(len(taken))
    stamps = taken if stamped else np.linspace(taken[0], taken[-1], len(taken))
    tacho = np.round(speed + 0.05 * rng.standard_normal(len(taken)), 2)
    result = diagnose_trace(
        trace_of(stamps, tacho, np.interp(taken, fine, angle), torque), PROFILE, materiality=0.0
    )
    found = result.settings["torque_low_pass"]
    assert found["over_time"]
    assert found["corner_hz"] == pytest.approx(48.0, rel=0.01)
    assert result.causes == ()
    assert result.unexplained == ()


def test_the_motion_of_lost_samples_is_interpolated_and_takes_no_part():
    trace, _ = rippling_speed(1.5e-3, n=6000)
    rng = np.random.default_rng(8)
    lost = np.flatnonzero(rng.random(6000) < 0.03)[1:-1]
    holed = trace.with_columns(
        motor_angle_rad=np.where(np.isin(np.arange(6000), lost), np.nan, trace["motor_angle_rad"])
    )
    kept = np.delete(np.arange(6000), np.arange(3000, 3004))
    gap = Trace({name: values[kept] for name, values in holed.columns.items()})
    found, masked, added = on_clock(gap, np.zeros(len(kept), dtype=bool))
    assert np.flatnonzero(added).tolist() == [3000, 3001, 3002, 3003]
    assert np.flatnonzero(masked).tolist() == sorted({*lost.tolist(), 3000, 3001, 3002, 3003})
    np.testing.assert_allclose(found.time_s, trace.time_s, atol=1e-9)
    # the ripple turns by 1.4 rad over four samples, of which a chord misses 1.5e-3 (1 - cos 0.7);
    # two steps of the encoder come to that
    assert np.abs(found["motor_angle_rad"] - trace["motor_angle_rad"]).max() < 3.5e-4 + 2e-4
    assert np.isnan(found["torque_nm"][3000:3004]).all()


def test_an_acceleration_is_by_the_angle_where_the_velocity_is_late():
    trace, acceleration = rippling_speed(1.5e-3)
    late = np.convolve(trace["motor_velocity_rad_s"], np.full(31, 1.0 / 31.0))[: len(acceleration)]
    smooth = trace.with_columns(motor_velocity_rad_s=late)
    # by scatter alone the smoothed velocity is the better one
    assert motion_from_trace(smooth, PROFILE.data).acceleration_source == "velocity"
    assert prepared(smooth).motion.acceleration_source == "angle"


@pytest.mark.parametrize("samples", [0, 12])
def test_a_late_velocity_is_put_in_step_with_the_angle(samples):
    log = reversing_log(None)
    speed = np.gradient(log["motor_angle_rad"], log.time_s)
    speed += 0.05 * np.random.default_rng(3).standard_normal(len(log))
    late = np.concatenate([np.zeros(samples), speed])[: len(log)]
    read = motion_from_trace(log.with_columns(motor_velocity_rad_s=late), PROFILE.data)
    motion, told = in_step(read)
    assert told == pytest.approx(1e-3 * samples, abs=2e-4)
    # so much of ramps of up to 400 rad/s^2, and four deviations of the noise of two readings
    assert np.abs(motion.velocity_rad_s - speed)[100:-100].max() < 400.0 * 2e-4 + 0.5
    # what was made of the angle is in step already
    by_angle, _ = in_step(replace(read, acceleration_source="angle"))
    np.testing.assert_array_equal(by_angle.acceleration_rad_s2, read.acceleration_rad_s2)


@pytest.mark.parametrize(
    ("held", "share"),
    [
        (lambda load: load, 1.0),
        (lambda load: -load, -1.0),
        (lambda load: 0.0 * load, 0.0),
        # a limit at three tenths of the load passes .376 of its wave; and friction that follows it
        (lambda load: np.clip(load, -6.0, 6.0), 1.0),
        (lambda load: 0.1 * np.abs(load), 0.0),
    ],
)
def test_a_load_is_in_the_torque_where_that_follows_it(held, share):
    trace = reversing()
    load = trace["load_torque_nm"]
    changed = trace.with_columns(torque_nm=trace["torque_nm"] - load + held(load))
    assert prepared(changed).load == share


def test_a_load_that_was_logged_behind_the_filter_stands_as_it_was_logged():
    trace, _ = rippling_speed(1.5e-3, n=4000)
    load = 5.0 * np.tanh((trace.time_s - 2.0) / 0.01)
    both = trace.with_columns(torque_nm=trace["torque_nm"] + load, load_torque_nm=load)
    masked = np.random.default_rng(2).random(4000) < 0.04
    low_pass = LowPass(0.1, causal=True, load=True)
    fixed = []
    for one in (both, trace):
        record = prepared(one, masked=masked).behind(low_pass)
        bands = make_bands(record.valid, record.period_s).low_passed(low_pass)
        fixed.append(fixed_of(record, bands))
    logged = bands.transform(load[:, None], measured=True)[0]
    np.testing.assert_allclose(fixed[0] - fixed[1], logged, atol=1e-6 * np.abs(logged).max())


@pytest.mark.parametrize("speed", [90.0, 61.3])
def test_counting_steps_are_no_motion(speed):
    time = np.arange(20_000) * 1e-3
    # at so steady a speed counting steps are lines, which stand out of their own noise
    angle = speed * time + 0.05 * np.sin(0.3 * time)
    trace = trace_of(time, np.full(20_000, speed), counted(angle), 0.0 * time)
    motion = replace(motion_from_trace(trace, PROFILE.data), acceleration_source="angle")
    # a step is even over its width, and its noise over all frequencies: 2000 rad/s^2, of which a
    # hundredth moves this load by .003 N m, a third of the least noise of the benchmark
    steps = COUNT / np.sqrt(12.0) * (np.pi / 1e-3) ** 2 / np.sqrt(5.0)
    found, answer = seen_acceleration(motion, 0.01 * np.cos(7.0 * angle), 1e-3)
    for values in (found.acceleration_rad_s2, answer):
        assert values[200:-200].std() < 0.01 * steps
