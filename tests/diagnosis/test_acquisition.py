"""Faults of the acquisition are found, named and taken out; clean records raise nothing."""

import numpy as np
import pytest

from hdbench.diagnosis import diagnose_trace
from hdbench.diagnosis.acquisition.acquire import inspect_channels
from hdbench.diagnosis.acquisition.channels import shaft_of
from hdbench.diagnosis.acquisition.coarse import comb_matters
from hdbench.diagnosis.acquisition.codes import Comb, find_comb, stuck_samples
from hdbench.diagnosis.acquisition.masked import masked_causes
from hdbench.diagnosis.acquisition.slips import find_jumps, velocity_spikes
from hdbench.diagnosis.acquisition.stamps import gap_steps, repeated_rows
from hdbench.diagnosis.acquisition.tacho import find_tacho_ripple
from hdbench.diagnosis.acquisition.task import cleaned, task_of
from hdbench.diagnosis.acquisition.units import check_channels
from hdbench.diagnosis.acquisition.variance import find_speed_noise
from hdbench.diagnosis.measured.preflight import inspect_trace
from hdbench.model import load_model, save_model
from hdbench.profile import load_profile
from hdbench.records import Trace

PROFILE = load_profile("cim-tr-97-06")
COUNT = 2.0 * np.pi / 4000
PERIOD = 9.0
SWING = 40.0


def course(time):
    """Speed, angle and acceleration of 90 + 40 sin rad/s, in closed form."""
    rate = 2.0 * np.pi / PERIOD
    speed = 90.0 + SWING * np.sin(rate * time)
    angle = 90.0 * time + SWING / rate * (1.0 - np.cos(rate * time))
    return speed, angle, SWING * rate * np.cos(rate * time)


def bench(n=10_000, seed=0, lost=(), extra=lambda t, a, w: 0.0, tacho=0.0):
    """Columns of a record; `lost`: (first sample, how many) that no stamp tells of."""
    rng = np.random.default_rng(seed)
    total = n + sum(count for _, count in lost)
    time = np.arange(total) * 1e-3
    speed, angle, drive = course(time)
    torque = 0.4 * np.cos(2 * angle + 0.6) + 0.2 * np.cos(4 * angle - 1.1)
    torque += 0.5 * np.cos(angle / 100 + 0.3) + 1.725e-4 * drive + extra(time, angle, speed)
    torque += 0.05 * rng.standard_normal(total)
    read = speed * (1.0 + tacho * np.cos(22 * angle + 0.5)) + 0.056 * rng.standard_normal(total)
    kept = np.ones(total, dtype=bool)
    for first, count in lost:
        kept[first : first + count] = False
    return {
        "time_s": np.arange(n) * 1e-3,
        "torque_nm": torque[kept],
        "motor_velocity_rad_s": read[kept],
        "encoder_count": np.floor(angle[kept] / COUNT),
    }


def changed(columns, **new):
    return Trace({**columns, **new})


def slipped(columns, first, counts):
    moved = columns["encoder_count"].copy()
    moved[first:] += counts
    return changed(columns, encoder_count=moved)


def without_encoder(columns):
    return Trace({k: v for k, v in columns.items() if k != "encoder_count"})


def every(result):
    return {c.name: c for c in (*result.minor, *result.causes)}


# --- stamps


def test_a_gap_stands_out_of_the_jitter_of_the_stamps():
    rng = np.random.default_rng(1)
    # a host's stamps: 30 % of jitter makes steps beyond 1.5 periods without any loss
    time = (np.arange(5000) + 0.3 * rng.uniform(-1, 1, 5000)) * 1e-3
    assert float(np.diff(time).max()) > 1.5e-3
    assert len(gap_steps(time)) == 0
    time[3000:] += 0.02
    assert gap_steps(time).tolist() == [2999]


def test_a_row_that_repeats_the_one_before_while_the_shaft_turns_is_a_missed_sample():
    columns = bench(2000)
    held = {name: v.copy() for name, v in columns.items()}
    for name in ("torque_nm", "motor_velocity_rad_s", "encoder_count"):
        held[name][700:703] = held[name][699]
    assert np.flatnonzero(repeated_rows(Trace(held))).tolist() == [700, 701, 702]
    assert not repeated_rows(Trace(columns)).any()
    # a load that goes on changing was measured anew
    loaded = {**held, "load_torque_nm": np.arange(len(held["time_s"])) * 1e-3}
    assert not repeated_rows(Trace(loaded)).any()
    flags = inspect_trace(Trace(held), PROFILE.data).flags
    assert [(f.name, f.samples) for f in flags] == [("missed-samples", 3)]


def test_equal_readings_at_rest_are_no_missed_samples():
    rest = {name: np.full(500, 3.0) for name in ("torque_nm", "motor_velocity_rad_s")}
    rest |= {"time_s": np.arange(500) * 1e-3, "encoder_count": np.full(500, 17.0)}
    rest["encoder_count"][400:] = 18.0
    assert not repeated_rows(Trace(rest)).any()


# --- converter


@pytest.mark.parametrize("step", [0.0317, 0.19])
def test_the_step_of_a_comb_is_read_from_the_values(step):
    torque = bench()["torque_nm"]
    # the last stage rounds once more, to steps of 2 mN m
    comb = find_comb(0.002 * np.round(step * np.round(torque / step) / 0.002))
    assert comb is not None
    assert abs(comb.step_nm - step) < 1e-4 * step + 4.0 * comb.std_nm


def test_values_without_a_grid_have_no_comb():
    assert find_comb(bench()["torque_nm"]) is None


def test_a_stuck_bit_shows_as_the_step_it_stands_for():
    codes = np.round(bench(seed=3)["torque_nm"] / 0.01).astype(np.int64)
    comb = find_comb(0.01 * (codes & ~8))
    assert comb is not None
    assert comb.step_nm == pytest.approx(0.08, rel=1e-6)


def test_a_coarse_channel_at_rest_is_not_stuck():
    rng = np.random.default_rng(2)
    # noise of a third of a step at rest: runs of equal values come by themselves
    torque = 0.03 * np.round(rng.standard_normal(5000) / 3.0)
    assert not stuck_samples(torque).any()
    live = rng.standard_normal(5000)
    live[1000:1030] = live[1000]
    assert np.flatnonzero(stuck_samples(live)).tolist() == list(range(1000, 1030))


@pytest.mark.parametrize(
    ("step", "scatter", "fault"),
    [
        (0.0020, 0.001, False),  # the profile's own converter, 16 bits over 132 N m
        (132.0 / 2**12, 0.05, False),  # 12 bits below the noise
        (132.0 / 2**12, 0.02, True),  # 12 bits above it
        (132.0 / 2**11, 0.2, True),  # no converter of a bench has 11 bits
        (0.01, 0.05, False),  # numbers with two decimals
        (0.0317, 0.05, True),  # none of these
    ],
)
def test_steps_are_a_fault_where_they_matter_or_no_converter_makes_them(step, scatter, fault):
    assert comb_matters(Comb(step, 0.0, 100), PROFILE.data, scatter) is fault


# --- angle and tacho


def test_slips_of_the_encoder_are_found_to_the_sample_and_to_a_count():
    columns = bench()
    moved = columns["encoder_count"].copy()
    moved[3000:] += 200
    moved[7000:] -= 31
    jumps = find_jumps(shaft_of(changed(columns, encoder_count=moved), PROFILE.data))
    assert [j.first for j in jumps] == [3000, 7000]
    assert jumps[0].angle_rad == pytest.approx(200 * COUNT, abs=COUNT)
    assert jumps[1].angle_rad == pytest.approx(-31 * COUNT, abs=COUNT)


@pytest.mark.parametrize("fault", ["gain", "offset", "lag"])
def test_what_a_tacho_gets_wrong_throughout_is_no_jump(fault):
    columns = bench(seed=5)
    speed = columns["motor_velocity_rad_s"]
    wrong = {"gain": 1.02 * speed, "offset": speed + 1.5, "lag": np.r_[speed[:5], speed[:-5]]}
    trace = changed(columns, motor_velocity_rad_s=wrong[fault])
    assert find_jumps(shaft_of(trace, PROFILE.data)) == []


def test_isolated_samples_of_the_velocity_are_told_from_its_corners():
    speed = np.concatenate([np.linspace(0.0, 100.0, 500), np.full(500, 100.0), np.zeros(500)])
    assert not velocity_spikes(speed).any()
    speed[700] = 20.0
    assert np.flatnonzero(velocity_spikes(speed)).tolist() == [700]


def test_ripple_of_the_tacho_is_measured_and_true_speed_ripple_is_not_taken_for_it():
    (line,) = find_tacho_ripple(shaft_of(Trace(bench(tacho=0.01)), PROFILE.data))
    assert line.order == 22.0
    assert abs(line.amplitude - 0.01) < 4.0 * line.std
    # the encoder lies half a count behind on average: 22 times that
    assert abs(line.phase_rad - 0.5 - 11 * COUNT) < 4.0 * line.phase_std_rad
    assert find_tacho_ripple(shaft_of(Trace(bench()), PROFILE.data)) == ()
    time = np.arange(10_000) * 1e-3
    # a shaft that really turns unevenly: order 4 of 1 % in speed and angle alike
    _, angle, _ = course(time)
    uneven = angle + 0.01 / 4.0 * np.sin(4.0 * angle)
    speed = np.gradient(uneven, 1e-3)
    columns = {"time_s": time, "motor_velocity_rad_s": speed, "motor_angle_rad": uneven}
    assert find_tacho_ripple(shaft_of(Trace(columns), PROFILE.data)) == ()


# --- units


def test_channels_in_order_are_left_as_they_are():
    trace = Trace(bench())
    checked = check_channels(trace, PROFILE.data)
    assert (checked.flags, checked.reason) == ((), "")
    assert checked.trace is trace


def test_the_channel_that_the_ripple_disagrees_with_is_left_out_or_scaled():
    columns = bench()
    twice = check_channels(
        changed(columns, encoder_count=4 * columns["encoder_count"]), PROFILE.data
    )
    assert [f.name for f in twice.flags] == ["encoder-scale"]
    assert "encoder_count" not in twice.trace
    rpm = columns["motor_velocity_rad_s"] * 30.0 / np.pi
    checked = check_channels(changed(columns, motor_velocity_rad_s=rpm), PROFILE.data)
    assert [f.name for f in checked.flags] == ["velocity-scale"]
    scaled = checked.trace["motor_velocity_rad_s"]
    assert scaled == pytest.approx(columns["motor_velocity_rad_s"], rel=1e-3)
    assert "rpm" in checked.flags[0].detail


def test_an_angle_that_counts_backwards_is_told_by_the_expected_torque():
    time = np.arange(10_000) * 1e-3
    # a drive of 0.3 N m, ten times in 10 s, tells the sign of the acceleration
    rate = 2.0 * np.pi
    speed = 100.0 + 1800.0 / rate * np.sin(rate * time)
    angle = 100.0 * time + 1800.0 / rate**2 * (1.0 - np.cos(rate * time))
    rng = np.random.default_rng(4)
    torque = 1.725e-4 * 1800.0 * np.cos(rate * time) + 0.4 * np.cos(2.0 * angle)
    columns = {
        "time_s": time,
        "torque_nm": torque + 0.05 * rng.standard_normal(len(time)),
        "motor_velocity_rad_s": speed,
        "motor_angle_rad": -angle,
    }
    (flag,) = check_channels(Trace(columns), PROFILE.data).flags
    assert flag.name == "encoder-scale"
    assert "motor_angle_rad" not in check_channels(Trace(columns), PROFILE.data).trace


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda c: {"torque_nm": 1000.0 * c["torque_nm"]}, "N m at most"),
        (
            lambda c: {
                "torque_nm": c["motor_velocity_rad_s"],
                "motor_velocity_rad_s": c["torque_nm"],
            },
            "each other's place",
        ),
        (
            lambda c: {"encoder_count": np.cumsum(np.random.default_rng(0).normal(0, 40, 10_000))},
            "not of the same shaft",
        ),
    ],
)
def test_channels_that_make_no_sense_are_bad_data_with_a_reason(change, says):
    columns = bench()
    result = diagnose_trace(changed(columns, **change(columns)), PROFILE)
    assert result.verdict == "data-bad"
    assert says in result.reason
    assert [flag.name for flag in result.data_flags] == ["wrong-channel"]
    assert result.causes == ()


# --- variance


def test_noise_that_grows_with_speed_is_measured():
    rng = np.random.default_rng(6)
    speed = course(np.arange(40_000) * 1e-3)[0]
    white = np.sqrt(1.0 + (speed / 100.0) ** 2) * rng.standard_normal(len(speed))
    used = np.ones(len(speed), dtype=bool)
    law = find_speed_noise(white, used, speed, 1e-4)
    assert law is not None
    # variance over its mean: slope 1e-4 over the mean of 1 + (w / 100)^2
    mean = 1.0 + float(np.mean(speed**2)) * 1e-4
    assert abs(law.slope - 1e-4 / mean) < 4.0 * law.slope_std


@pytest.mark.parametrize("kind", ["even", "louder with time", "quieter with speed"])
def test_other_variances_are_not_named_after_the_speed(kind):
    rng = np.random.default_rng(7)
    speed = course(np.arange(40_000) * 1e-3)[0]
    size = {
        "even": 1.0,
        "louder with time": np.linspace(1.0, 3.0, len(speed)),
        "quieter with speed": 100.0 / speed,
    }[kind]
    white = size * rng.standard_normal(len(speed))
    assert find_speed_noise(white, np.ones(len(speed), dtype=bool), speed, 1e-4) is None


# --- whole diagnosis


def test_a_slip_is_named_modelled_and_an_effect_beside_it_is_still_found(tmp_path):
    columns = bench(6000, seed=8, extra=lambda t, a, w: 0.08 * np.cos(6 * a))
    trace = slipped(columns, 3000, 150)
    result = diagnose_trace(trace, PROFILE)
    assert [c.name for c in result.causes] == ["encoder-slip", "ripple-harmonic"]
    slip, ripple = result.causes
    parameters = slip.parameters
    assert parameters["slip_rad"]["value"] == pytest.approx(150 * COUNT, abs=COUNT)
    assert 2.999 <= parameters["step_time_s"]["value"] <= 3.0
    assert ripple.parameters["order"]["value"] == pytest.approx(6.0, abs=0.01)
    assert ripple.parameters["amplitude_nm"]["value"] == pytest.approx(0.08, abs=0.004)
    # without the slip the residual is that of ripple and noise
    wanted = float(np.hypot(0.05, 0.08 / np.sqrt(2.0)))
    assert slip.gain.heldout_rms_after_nm == pytest.approx(wanted, rel=0.03)
    assert slip.gain.interval[0] > 0.0
    assert "encoder-slip" in {flag.name for flag in result.data_flags}
    save_model(tmp_path / "model.json", result.model, profile=PROFILE, provenance={})
    again = diagnose_trace(trace, PROFILE, model=load_model(tmp_path / "model.json"))
    assert again.verdict == "nothing-found"


def test_samples_lost_behind_even_stamps_are_named_with_and_without_an_encoder():
    columns = bench(7000, seed=9, lost=((3500, 4),))
    for trace in (Trace(columns), without_encoder(columns)):
        found = every(diagnose_trace(trace, PROFILE))
        assert set(found) == {"missed-samples"}
        parameters = found["missed-samples"].parameters
        assert parameters["samples"]["value"] == 4.0
        # the ripple's phase places it within some samples, the encoder to the very one
        assert parameters["step_time_s"]["value"] == pytest.approx(3.5, abs=0.05)
    assert found["missed-samples"].gain.explained_fraction > 0.1


def test_clipping_is_a_saturation_and_its_samples_take_no_part():
    columns = bench(6000, seed=10, extra=lambda t, a, w: 0.05 * np.cos(5 * a))
    trace = changed(columns, torque_nm=np.minimum(columns["torque_nm"], 0.5))
    result = diagnose_trace(trace, PROFILE)
    names = [c.name for c in result.causes]
    assert names == ["saturation", "ripple-harmonic"]
    assert result.causes[0].parameters["limit_nm"]["value"] == 0.5
    assert result.causes[0].gain.heldout_rms_after_nm < result.causes[0].gain.heldout_rms_before_nm


def test_spikes_and_gaps_are_named_with_what_they_cost():
    columns = bench(6000, seed=11)
    torque = columns["torque_nm"].copy()
    at = np.array([900, 2100, 2101, 4444])
    torque[at] += (1.0, -1.2, -0.9, 0.8)
    kept = np.r_[0:3000, 3050:6000]
    trace = Trace({k: v[kept] for k, v in (columns | {"torque_nm": torque}).items()})
    result = diagnose_trace(trace, PROFILE)
    assert [c.name for c in result.causes] == ["spikes"]
    (spikes,) = result.causes
    assert spikes.parameters["samples"]["value"] == 4.0
    # 3.89 (N m)^2 of spikes over the noise of 5950 samples
    share = 3.89 / (3.89 + 5950 * 0.05**2)
    assert spikes.share_of_variance == pytest.approx(share, abs=0.03)
    gap = every(result)["missed-samples"]
    assert (gap.parameters["samples"]["value"], gap.share_of_variance) == (50.0, 0.0)
    assert {f.name: f.samples for f in result.data_flags} == {"spikes": 4, "missed-samples": 50}


def test_coarse_steps_are_named_and_their_mean_reading_is_predicted():
    columns = bench(6000, seed=12)
    rough = 0.25 * np.round(columns["torque_nm"] / 0.25)
    result = diagnose_trace(changed(columns, torque_nm=rough), PROFILE)
    cause = every(result)["quantisation"]
    assert cause.parameters["step_nm"]["value"] == pytest.approx(0.25, rel=1e-6)
    # q^2 / 12 beside the noise
    share = 0.25**2 / 12.0 / (0.25**2 / 12.0 + 0.05**2)
    assert cause.share_of_variance == pytest.approx(share, abs=0.05)
    assert cause.gain.interval[0] > 0.0
    assert cause in result.causes


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
    trace = Trace(
        {
            "time_s": columns["time_s"],
            "torque_v": step_v * np.round(torque / 6.6 / step_v),
            "tacho_v": step_v * np.round(tacho / step_v),
            "encoder_count": columns["encoder_count"],
        }
    )
    task = task_of(PROFILE, None, (), 0.01)
    inspected = inspect_channels(
        trace, PROFILE.data, task.given, task.prepare, lambda what, share: None
    )
    assert (inspected.reason, inspected.faults, inspected.preflight.flags) == ("", (), ())
    clean = cleaned(task, inspected, {})
    assert masked_causes(task, clean, np.random.default_rng(0)) == []


def test_progress_rises_to_one_and_names_the_step():
    seen = []
    diagnose_trace(
        Trace(bench(4000)), PROFILE, progress=lambda what, share: seen.append((what, share))
    )
    shares = [share for _, share in seen]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert len({what for what, _ in seen}) >= 6
