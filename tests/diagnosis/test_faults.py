"""Faults of the acquisition: injected ones are named, sound and rough logs are left alone."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from real_records import real_cases, real_profile, real_trace
from swinging_shaft import COUNT, counted, slipped, swing, trace_of
from swinging_shaft import read_by_encoder as bench

from hdbench.diagnosis.faults.channels import inspect_channels
from hdbench.diagnosis.faults.converter import coarse_steps
from hdbench.diagnosis.faults.residual import faults_of_residual
from hdbench.diagnosis.faults.units import check_channels
from hdbench.model import BenchModel, CauseTerm, baseline_columns, motion_from_trace
from hdbench.profile import load_profile
from hdbench.records import Trace

PROFILE = load_profile("cim-tr-97-06")
MODEL = BenchModel.from_profile(PROFILE.data)
DATA = os.environ.get("HDBENCH_DATA")
CHANNELS = ("torque_nm", "motor_velocity_rad_s", "encoder_count")


def inspected(columns, profile=PROFILE, model=MODEL):
    return inspect_channels(Trace(columns), profile.data, model, alpha=0.01)


def inspected_log(time, speed, angle, torque):
    return inspected(trace_of(time, speed, angle, torque).columns)


def white(seed, n):
    """Return noise of a velocity and of a torque."""
    return np.random.default_rng(seed).standard_normal((2, n))


def value(fault, name):
    return fault.parameters[name].value


# --- angle, tacho and clock


def test_slips_are_found_to_the_sample_and_to_a_count_and_taken_out():
    columns = bench()
    found = inspected(slipped(columns, (3000, 200), (7000, -31)))
    assert [fault.name for fault in found.faults] == ["encoder-slip", "encoder-slip"]
    one, other = found.faults
    assert value(one, "slip_rad") == pytest.approx(200 * COUNT, abs=COUNT)
    assert value(other, "slip_rad") == pytest.approx(-31 * COUNT, abs=COUNT)
    assert 2.999 <= value(one, "step_time_s") <= 3.0
    assert one.evidence_nats > 8.0
    restored = found.trace["encoder_count"] - columns["encoder_count"]
    assert np.abs(restored).max() < 1.0
    # without the repair of the first, the second is still taken out
    undone = one.undone["encoder_count"] - columns["encoder_count"]
    assert undone[5000] == 200.0
    assert undone[8000] == pytest.approx(200.0, abs=1.0)


def test_a_slip_that_the_model_holds_is_not_found_again():
    columns = slipped(bench(seed=1), (4000, 150))
    (fault,) = inspected(columns).faults
    known = replace(MODEL, causes=(CauseTerm(fault.name, dict(fault.shape), ()),))
    assert inspected(columns, model=known).faults == ()


@pytest.mark.parametrize("samples", [4, 60])
def test_samples_lost_behind_even_stamps_are_told_from_a_slip_by_the_torque(samples):
    found = inspected(bench(9000, seed=9, lost=((3500, samples),)))
    (fault,) = found.faults
    assert (fault.name, fault.group) == ("missed-samples", ())
    assert value(fault, "samples") == samples
    gap = np.diff(found.trace.time_s)[3499]
    assert gap == pytest.approx((samples + 1) * 1e-3)


@pytest.mark.parametrize("first", [6560, 6600, 6640])
def test_a_jump_beside_a_standstill_may_be_a_loss_or_a_slip(first):
    # the speed comes down to zero at 6.75 s: 20 samples turn by as little as a slip, or 15, or 800
    time = np.arange(10_020) * 1e-3
    speed, angle, torque = swing(time, 40.0, 40.0)
    noise = white(5, len(time))
    kept = np.r_[0:first, first + 20 : 10_020]
    read, torque = speed + 0.02 * noise[0], torque + 0.05 * noise[1]
    (fault,) = inspected_log(time[:10_000], read[kept], angle[kept], torque[kept]).faults
    assert "missed-samples" in {fault.name, *fault.group}
    # the nearer it stands still, the less the torque tells
    assert ("encoder-slip" in fault.group) == (first == 6600)
    if first < 6640:
        # of the numbers that turn by as much, one near the least
        assert value(fault, "samples") == pytest.approx(20.0, abs=1.0)
    else:
        assert fault.name == "encoder-slip"


def test_a_loss_is_found_where_the_velocity_is_made_of_the_angle():
    time = np.arange(10_012) * 1e-3
    _, angle, torque = swing(time)
    kept = np.r_[0:4000, 4012:10_012]
    read, stamps = counted(angle[kept]), time[:10_000]
    torque = torque[kept] + 0.05 * np.random.default_rng(8).standard_normal(10_000)
    found = inspected_log(stamps, np.gradient(read, stamps), read, torque)
    (fault,) = found.faults
    assert fault.name == "missed-samples"
    assert value(fault, "samples") == 12
    assert np.diff(found.trace.time_s)[3999] == pytest.approx(0.013)


@pytest.mark.parametrize("ends", [0.029, 0.015])
def test_a_loss_while_the_speed_changes_is_told_with_how_many_may_be_lost(ends):
    # some 90 rad/s, and within the 30 ms between two samples down to some 33 rad/s
    time = np.arange(10_029) * 1e-3
    speed = np.interp(time, [4.0, 4.0 + ends], [90.0, 33.0]) + 5.0 * np.sin(2.0 * time)
    angle = np.concatenate([[0.0], np.cumsum(0.5e-3 * (speed[1:] + speed[:-1]))])
    noise = white(8, len(time))
    torque = 0.2 * np.cos(2.0 * angle) + 0.1 * np.cos(4.0 * angle) + 0.05 * noise[0]
    kept = np.r_[0:4001, 4030:10_029]
    speed += 0.05 * noise[1]
    (fault,) = inspected_log(time[:10_000], speed[kept], angle[kept], torque[kept]).faults
    assert fault.name == "missed-samples"
    number = fault.parameters["samples"]
    # neither side shows when the speed changed
    assert 3.0 < number.std < 15.0
    assert abs(number.value - 29.0) < 2.0 * number.std


@pytest.mark.parametrize("seed", [0, 5, 38])
def test_an_error_of_the_output_encoder_is_no_slip_where_samples_are_held(seed):
    # the angle is the output's times 100, with an error once per turn; the velocity is made of it
    rng, time = np.random.default_rng(seed), np.arange(12_000) * 1e-3
    _, angle, torque = swing(time, 60.0, 40.0)
    fresh = rng.random(len(time)) > 0.03
    rows = np.maximum.accumulate(np.where(fresh, np.arange(len(time)), 0))
    wrong = angle + 0.3 * np.cos(angle / 100.0 + rng.uniform(-np.pi, np.pi))
    read, noise = np.round(wrong[rows], 4), 0.05 * rng.standard_normal(len(time))
    found = inspected_log(time, np.gradient(read, time), read, (torque + noise)[rows])
    assert "encoder-slip" not in {fault.name for fault in found.faults}


def test_the_counts_of_an_encoder_are_seen_where_rows_are_held(monkeypatch):
    # what stands in for a held row lies between two counts: a jump of one of them is no slip
    seen = []
    monkeypatch.setattr(
        "hdbench.diagnosis.faults.channels.find_jumps",
        lambda shaft, *_, **__: seen.append(shaft.count_rad) or (),
    )
    time = np.arange(8000) * 1e-3
    speed, angle, torque = swing(time, 60.0, 40.0)
    rows = np.arange(len(time))
    rows[50::40] -= 1
    speed, torque = (speed, torque) + 0.05 * white(0, len(time))
    found = inspected_log(time, speed[rows], counted(angle)[rows], torque[rows])
    assert found.flags[0].name == "missed-samples"
    assert seen == [pytest.approx(COUNT)]


def test_ripple_of_the_tacho_is_measured_and_taken_out():
    found = inspected(bench(tacho=0.01))
    (fault,) = found.faults
    assert (fault.name, value(fault, "order")) == ("tacho-ripple", 22.0)
    amplitude = fault.parameters["relative_amplitude"]
    assert abs(amplitude.value - 0.01) < 4.0 * amplitude.std
    assert inspected(dict(found.trace.columns)).faults == ()


@pytest.mark.parametrize("fault", ["gain", "offset", "lag", "ripple of the shaft"])
def test_what_a_tacho_shows_or_gets_wrong_throughout_is_no_fault(fault):
    columns = bench(seed=5)
    speed = columns["motor_velocity_rad_s"]
    _, angle, _ = swing(columns["time_s"])
    uneven = angle + 0.01 / 4.0 * np.sin(4.0 * angle)
    noise = 0.05 * np.random.default_rng(1).standard_normal(len(angle))
    shown = {
        "gain": 1.02 * speed,
        "offset": speed + 1.5,
        "lag": np.r_[speed[:5], speed[:-5]],
        "ripple of the shaft": np.gradient(uneven, 1e-3) + noise,
    }
    if fault == "ripple of the shaft":
        columns["encoder_count"] = np.floor(uneven / COUNT)
    assert inspected({**columns, "motor_velocity_rad_s": shown[fault]}).faults == ()


# --- one sensor


@pytest.mark.parametrize("made", ["differences", "filtered", "integrated"])
def test_two_channels_of_one_sensor_are_told_and_accuse_nobody(made):
    columns = slipped(bench(seed=6), (5000, 300))
    if made == "integrated":
        speed = columns["motor_velocity_rad_s"]
        columns["motor_angle_rad"] = np.concatenate([[0.0], np.cumsum(speed[:-1] * 1e-3)])
        del columns["encoder_count"]
        pair = ("motor_angle_rad", "motor_velocity_rad_s")
    else:
        speed = np.gradient(columns["encoder_count"] * COUNT, 1e-3)
        kernel = np.ones(9) / 9.0 if made == "filtered" else np.ones(1)
        columns["motor_velocity_rad_s"] = np.convolve(speed, kernel, mode="same")
        # nothing moves against the ripple: the angle did not slip, it was read so
        columns["torque_nm"] = 0.05 * np.random.default_rng(2).standard_normal(10_000)
        pair = ("motor_velocity_rad_s", "encoder_count")
    found = inspected(columns)
    assert found.derived == (pair,)
    assert found.faults == ()


@pytest.mark.parametrize("bits", [None, 12])
@pytest.mark.parametrize("delay", [2, 8, 20])
def test_a_delayed_velocity_of_the_drive_makes_no_slip_where_the_speed_changes(delay, bits):
    rng = np.random.default_rng(delay)
    time = np.arange(20_000) * 1e-3
    levels = np.repeat(rng.uniform(-200, 200, 20), 1000)
    speed = np.convolve(np.pad(levels, 60, mode="edge"), np.ones(40) / 40, mode="same")[60:-60]
    angle = np.cumsum(speed) * 1e-3
    count = np.floor(angle / COUNT)
    late = np.convolve(np.gradient(count * COUNT, 1e-3), np.ones(2 * delay) / (2 * delay))
    step = 562.0 / 2**11
    read = late[:20_000] if bits is None else step * np.round(late[:20_000] / step)
    torque = 0.4 * np.cos(2 * angle) + 0.05 * rng.standard_normal(len(time))
    found = inspected(
        {"time_s": time, "torque_nm": torque, "motor_velocity_rad_s": read, "encoder_count": count}
    )
    assert (found.faults, found.reason) == ((), "")


@pytest.mark.parametrize("late", [(4000,), (2000, 5000, 8000)])
def test_a_velocity_formed_over_a_late_stamp_is_no_slip(late):
    time = np.arange(12_000) * 5e-3
    _, angle, _ = swing(time)
    stamps = time.copy()
    stamps[list(late)] += 2e-3
    velocity = np.gradient(angle, time)
    for at in late:
        for k in (at, at + 1):
            velocity[k] = (angle[k] - angle[k - 1]) / (stamps[k] - stamps[k - 1])
    noise = 0.05 * np.random.default_rng(0).standard_normal(time.size)
    torque = 0.4 * np.cos(2.0 * angle) + noise
    assert inspected_log(time, velocity, angle, torque).faults == ()


def test_a_sample_too_many_between_even_stamps_is_no_slip():
    # one more row was written than there was time for: two intervals turn by half
    time = np.sort(np.append(np.arange(3000), 1200.5)) / 30.0
    speed, angle, torque = swing(time, ripple=())
    noise = white(0, 3001)
    speed += 0.3 * noise[0]
    assert inspected_log(np.arange(3001) / 30.0, speed, angle, torque + noise[1]).faults == ()


# --- stamps


def test_gaps_of_the_stamps_are_told_and_jitter_is_none():
    columns = bench()
    kept = np.r_[0:3000, 3050:10_000]
    (fault,) = inspected({name: v[kept] for name, v in columns.items()}).faults
    assert (fault.name, value(fault, "samples")) == ("missed-samples", 50.0)
    rng = np.random.default_rng(1)
    shaken = columns["time_s"] + 0.3e-3 * rng.uniform(-1, 1, 10_000)
    assert inspected({**columns, "time_s": shaken}).faults == ()
    late = columns["time_s"] + 0.9e-3 * (rng.random(10_000) < 0.02)
    assert inspected({**columns, "time_s": late}).faults == ()


def test_stamps_that_follow_no_clock_have_no_gaps():
    rng = np.random.default_rng(3)
    # a host that polls when it can, and waits ten times as long now and then
    steps = rng.gamma(4.0, 0.25e-3, 10_000) + 9e-3 * (rng.random(10_000) < 1e-3)
    time = np.cumsum(steps)
    assert inspected_log(time, *swing(time)).faults == ()


@pytest.mark.parametrize("names", [CHANNELS, CHANNELS[:1]])
def test_torque_that_repeats_the_reading_before_is_told_and_takes_no_part(names):
    columns = bench(6000)
    held = np.flatnonzero(np.random.default_rng(3).random(6000) < 0.02)[1:]
    for name in names:
        for at in held.tolist():
            columns[name][at] = columns[name][at - 1]
    found = inspected(columns)
    assert found.faults == ()
    assert {flag.name for flag in found.flags} == {"missed-samples"}
    assert not np.delete(found.masked, held).any()
    assert dict(found.left_out)["held"] > 0.8 * len(held)


@pytest.mark.parametrize("of_angles", [False, True])
def test_rows_that_were_held_say_nothing_of_the_motion(of_angles):
    columns = bench(6000)
    at = np.arange(50, 5950, 97)
    for values in columns.values():
        if values is not columns["time_s"]:
            values[at] = values[at - 1]
    if of_angles:
        angle = columns["encoder_count"] * 2.0 * np.pi / 4000
        columns["motor_velocity_rad_s"] = np.gradient(angle, columns["time_s"])
    found = inspected(columns)
    assert np.flatnonzero(found.masked).tolist() == at.tolist()
    assert dict(found.left_out) == {"held": len(at)}
    # the shaft turned on by 30 to 85 counts: what is between two rows is known to a count or so
    off = found.trace["encoder_count"] - bench(6000)["encoder_count"]
    assert np.abs(off).max() < 2.0
    # a shaft that rests repeats its rows, too
    still = {name: np.concatenate([v, np.full(500, v[-1])]) for name, v in columns.items()}
    still["time_s"] = np.arange(6500) * 1e-3
    assert dict(inspected(still).left_out)["held"] == len(at)


# --- converter


@pytest.mark.parametrize(("held_nm", "crept_rad"), [(1.0, 0.0), (1.0, 2.0), (0.0, 0.0)])
def test_a_standstill_at_which_friction_holds_a_changing_torque_takes_no_part(held_nm, crept_rad):
    time = np.arange(8000) * 5e-3
    # it stands or creeps for 10 s while the torque rises, breaks away, and turns back
    swings = 60.0 * np.sin(2.0 * np.pi * (time - 10.0) / 12.0)
    speed = np.where(time > 10.0, swings, 0.1 * crept_rad)
    angle = np.cumsum(speed) * 5e-3
    still = time <= 10.0
    torque = np.where(still, held_nm * time / 10.0, 0.6 * np.sign(speed)) + 0.1
    noise = 0.01 * white(2, len(time))
    found = inspected_log(time, speed + noise[0], angle, torque + noise[1])
    assert [reason for reason, _ in found.left_out] == ["standstill"] * (held_nm > 0.0)
    # but for the last samples, whose window begins to move
    assert int(found.masked.sum()) == pytest.approx(still.sum() * (held_nm > 0.0), abs=20)


def test_a_velocity_whose_range_was_wrong_is_scaled_to_the_angle_and_told():
    time = np.arange(6000) * 5e-3
    speed, angle, _ = swing(time, mean=0.0, ripple=())
    noise = white(4, len(time))
    torque = 0.5 * np.sign(speed) + 0.05 * noise[1]
    found = inspected_log(time, speed / 1.658 + 0.1 * noise[0], angle, torque)
    (flag,) = found.flags
    assert (found.reason, flag.name) == ("", "velocity-scale")
    assert "1.658 times" in flag.detail
    assert np.std(found.trace["motor_velocity_rad_s"] - speed) < 0.5


def test_clipped_and_stuck_samples_take_no_part():
    columns = bench(6000, seed=10)
    columns["torque_nm"] = np.minimum(columns["torque_nm"], 0.5)
    columns["torque_nm"][2000:2100] = columns["torque_nm"][2000]
    found = inspected(columns)
    (fault,) = found.faults
    assert (fault.name, value(fault, "limit_nm")) == ("saturation", 0.5)
    assert found.masked[2000:2100].all()
    assert dict(found.left_out)["stuck"] == 100
    assert dict(found.left_out)["clipped"] == int(np.sum(columns["torque_nm"] == 0.5))


@pytest.mark.parametrize("step", [0.0317, 0.19])
def test_the_step_of_coarse_readings_is_read_from_the_values(step):
    torque = bench()["torque_nm"]
    # the last stage rounds once more, to steps of 2 mN m
    steps = coarse_steps(0.002 * np.round(step * np.round(torque / step) / 0.002))
    assert abs(steps.step - step) < 1e-4 * step + 4.0 * steps.std
    assert coarse_steps(torque) is None


def test_the_mean_error_of_coarse_readings_is_predicted():
    rng = np.random.default_rng(4)
    true = np.linspace(0.0, 3.0, 20_000)
    steps = coarse_steps(np.round(true + 0.1 * rng.standard_normal(true.size)))
    read = np.round(true[:, None] + 0.1 * rng.standard_normal((true.size, 200))).mean(axis=1)
    assert np.abs(read - true - steps.mean_error(true, 0.0, 0.1)).max() < 0.15


# --- units


def test_the_channel_that_the_ripple_disagrees_with_is_left_out_or_scaled():
    columns = bench()
    twice = inspected({**columns, "encoder_count": 4 * columns["encoder_count"]})
    assert [flag.name for flag in twice.flags] == ["encoder-scale"]
    assert "encoder_count" not in twice.trace
    rpm = columns["motor_velocity_rad_s"] * 30.0 / np.pi
    checked = check_channels(Trace({**columns, "motor_velocity_rad_s": rpm}), PROFILE.data)
    assert [flag.name for flag in checked.flags] == ["velocity-scale"]
    assert "rpm" in checked.flags[0].detail
    scaled = checked.trace["motor_velocity_rad_s"]
    assert scaled == pytest.approx(columns["motor_velocity_rad_s"], rel=1e-3)


def test_a_noisy_velocity_is_of_the_same_shaft():
    columns = bench()
    noise = 30.0 * np.random.default_rng(0).standard_normal(10_000)
    noisy = {**columns, "motor_velocity_rad_s": columns["motor_velocity_rad_s"] + noise}
    assert inspected(noisy).reason == ""


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda c: {"torque_nm": 1000.0 * c["torque_nm"]}, "times the 180 N m"),
        (
            lambda c: dict(zip(CHANNELS[:2], (c[CHANNELS[1]], c[CHANNELS[0]]), strict=True)),
            "each other's place",
        ),
        (
            lambda c: {"encoder_count": np.cumsum(np.random.default_rng(0).normal(0, 40, 10_000))},
            "not of the same shaft",
        ),
        (lambda c: dict.fromkeys(CHANNELS[1:], np.zeros(10_000)), "no motion"),
    ],
)
def test_a_record_that_says_nothing_is_refused_with_the_margin(change, says):
    columns = bench()
    found = inspected({**columns, **change(columns)})
    assert says in found.reason
    assert found.faults == ()


# --- what a model leaves


def left(columns, whitened=True):
    """Faults of what the baseline leaves; the noise is white here."""
    trace = Trace(columns)
    motion = motion_from_trace(trace, PROFILE.data)
    fixed, _, design = baseline_columns(motion, PROFILE.data)
    torque = trace["torque_nm"]
    valid = motion.valid & np.isfinite(fixed)
    solution = np.linalg.lstsq(design[valid], (torque - fixed)[valid], rcond=None)[0]
    residual = np.where(valid, torque - fixed - design @ solution, 0.0)
    white = residual / 0.05 if whitened else None
    return faults_of_residual(residual, white, motion, valid, torque, PROFILE.data, volts=False)


def test_spikes_are_counted_and_a_step_is_none():
    columns = bench(seed=11)
    at = np.array([900, 2100, 2101, 4444])
    columns["torque_nm"][at] += (1.0, -1.2, -0.9, 0.8)
    found = left(columns, whitened=False)
    (fault,) = found.faults
    assert (fault.name, fault.samples) == ("spikes", 4)
    assert np.flatnonzero(found.spikes).tolist() == at.tolist()
    columns = bench(seed=11)
    columns["torque_nm"][3000:] += 1.0
    assert left(columns).faults == ()


def test_coarse_readings_are_a_fault_where_the_steps_are_above_the_noise():
    columns = bench(seed=12)
    torque = columns["torque_nm"]
    (fault,) = left({**columns, "torque_nm": 0.25 * np.round(torque / 0.25)}).faults
    assert fault.name == "quantisation"
    assert value(fault, "step_nm") == pytest.approx(0.25, rel=1e-6)
    assert left({**columns, "torque_nm": 0.02 * np.round(torque / 0.02)}).faults == ()


def test_noise_that_grows_with_speed_is_measured_and_other_changes_are_none():
    found = left(bench(40_000, seed=6, rough=0.01))
    (fault,) = found.faults
    assert fault.name == "speed-dependent-noise"
    # 0.05 N m at rest, and as much at 100 rad/s
    noise = fault.parameters["noise_nm"]
    assert abs(noise.value - 0.05) < 4.0 * noise.std + 0.002
    assert found.noise_variance.max() > found.noise_variance.min() > 0.0
    columns = bench(40_000, seed=7)
    assert left(columns).faults == ()
    louder = 0.1 * np.linspace(0.0, 1.0, 40_000)
    noise = np.random.default_rng(8).standard_normal(40_000)
    assert left({**columns, "torque_nm": columns["torque_nm"] + louder * noise}).faults == ()
    # louder at some speeds, by no law of theirs
    louder = 0.1 * (columns["motor_velocity_rad_s"] > 65.0)
    found = left({**columns, "torque_nm": columns["torque_nm"] + louder * noise})
    assert found.faults == ()
    fast, slow = (np.median(found.noise_variance[louder == size]) for size in (0.1, 0.0))
    assert fast / slow == pytest.approx(1.0 + 0.1**2 / 0.05**2, rel=0.1)


# --- clean and real


@pytest.mark.parametrize("bits", [12, 16])
@pytest.mark.parametrize("colour", ["white", "pole", "flicker"])
def test_clean_records_have_no_fault(bits, colour):
    from scipy.signal import lfilter

    rng = np.random.default_rng(bits)
    columns = bench(6000, seed=13 + bits)
    white = rng.standard_normal(6000)
    rates = np.maximum(np.fft.rfftfreq(6000), 1.0 / 6000)
    noise = {
        "white": white,
        "pole": 0.44 * lfilter([1.0], [1.0, -0.9], white),
        "flicker": np.fft.irfft(np.fft.rfft(white) / np.sqrt(rates), 6000) / 4.0,
    }[colour]
    step_v = 20.0 / 2**bits
    torque = columns["torque_nm"] + 0.05 * noise
    tacho = columns["motor_velocity_rad_s"] / 56.2565
    found = inspected(
        {
            "time_s": columns["time_s"],
            "torque_v": step_v * np.round(torque / 6.6 / step_v),
            "tacho_v": step_v * np.round(tacho / step_v),
            "encoder_count": columns["encoder_count"],
        }
    )
    assert (found.reason, found.faults, found.flags, found.left_out) == ("", (), (), ())


@pytest.mark.parametrize(
    "case", [one for one in real_cases() if one.record != "lara8"], ids=lambda one: one.record
)
def test_logs_of_other_drives_have_no_fault_and_stay_as_they_are(case):
    trace = real_trace(case)
    found = inspected(trace.columns, real_profile(case))
    assert (found.reason, found.faults) == ("", ())
    # where a reversal is slow the shaft creeps until friction lets it go
    left_out = dict(found.left_out)
    assert left_out.keys() <= {"held", "standstill"}
    assert left_out.get("standstill", 0) < 0.1 * len(trace)
    for channel, values in trace.columns.items():
        np.testing.assert_array_equal(found.trace[channel][~found.masked], values[~found.masked])
    # all but one drive tell the velocity by the angle
    assert bool(found.derived) is not case.record.startswith("cogging")
    assert {flag.name for flag in found.flags} <= {"missed-samples"}


@pytest.mark.skipif(DATA is None, reason="HDBENCH_DATA not set")
@pytest.mark.parametrize("side", ["loadinc", "motorinc"])
def test_the_sweep_of_lara8_has_no_fault(side):
    path = Path(str(DATA)) / "lara8_dual_encoder" / "validate_joint3_sweep.csv"
    table = np.genfromtxt(path, delimiter=",", names=True)
    ratio = 101.0 if side == "loadinc" else 1.0
    columns = {
        "time_s": table["Timestamp"] - table["Timestamp"][0],
        "torque_nm": table["joint_torque_current_3"],
        "motor_velocity_rad_s": 101.0 * table["joint_velocity_3"],
        "motor_angle_rad": ratio * 2.0 * np.pi / 2**24 * table[f"encoder_{side}_3"],
    }
    found = inspected(columns)
    assert (found.reason, found.faults, found.left_out) == ("", (), ())
