"""Bursts and gliding tones: found where they are, and rarely where they are not."""

import numpy as np
import pytest
from scipy.signal import lfilter

from hdbench.diagnosis.measured.record import prepare_record
from hdbench.diagnosis.naming.gliding import gliding_tones
from hdbench.diagnosis.naming.passing import bursts
from hdbench.diagnosis.noise.whitened import Whitener, make_space
from hdbench.model import BenchModel
from hdbench.profile import load_profile
from hdbench.records import Trace

PROFILE = load_profile("cim-tr-97-06")
NOISE_NM = 0.05
COUNT = 12_000


def record_with(torque, colour=0.0, seed=0):
    """Record of 12 s at a swinging speed, and the space of its residual."""
    rng = np.random.default_rng(seed)
    time = np.arange(COUNT) * 1e-3
    speed = 90.0 + 40.0 * np.sin(2.0 * np.pi * time / 9.0)
    angle = np.concatenate([[0.0], np.cumsum(speed)[:-1] * 1e-3])
    noise = lfilter([1.0], [1.0, -colour], NOISE_NM * rng.standard_normal(COUNT + 500))[500:]
    columns = {
        "time_s": time,
        "motor_velocity_rad_s": speed,
        "motor_angle_rad": angle,
        "torque_nm": 0.4 * np.cos(2.0 * angle) + noise + torque,
    }
    none = np.zeros(COUNT, dtype=bool)
    record = prepare_record(
        Trace(columns), PROFILE.data, BenchModel.from_profile(PROFILE.data), none
    )
    used = record.valid.copy()
    used[0] = False
    kernel = np.array([1.0, -colour]) if colour else np.ones(1)
    whitener = Whitener(kernel, NOISE_NM, record.valid, used)
    return record, make_space(whitener, record.base, record.response_nm)


def box(first, length, height):
    torque = np.zeros(COUNT)
    torque[first : first + length] = height
    return torque


@pytest.mark.parametrize(("colour", "height"), [(0.0, 3.0), (0.9, 6.0)])
def test_a_burst_is_found_at_its_place_with_its_height(colour, height):
    # 16 samples: 12 standard deviations in white noise; with the pole 8, most of it at both ends
    record, space = record_with(box(7000, 16, height * NOISE_NM), colour)
    found = bursts(space, record, NOISE_NM)
    assert found is not None
    assert found.extent[0] == pytest.approx(7.0, abs=0.004)
    assert found.extent[1] == pytest.approx(7.015, abs=0.004)
    assert found.p_value < 1e-9
    # what is left of 1 N m has 4 and 1.35 standard deviations of 0.05 N m: four of them
    spread = NOISE_NM / (1.35 if colour else 4.0)
    assert found.size_nm == pytest.approx(height * NOISE_NM, abs=4.0 * spread)


def test_bursts_of_clean_noise_are_rarer_than_stated():
    values = []
    for seed in range(24):
        record, space = record_with(0.0, seed=seed)
        found = bursts(space, record, NOISE_NM)
        assert found is not None
        values.append(found.p_value)
    # a bound: at most as many below p as p says; 24 records, 99.9 % of the binomial law
    assert sum(value < 0.05 for value in values) <= 6
    assert sum(value < 0.5 for value in values) <= 19
    # and no empty one: the smallest of 24 lies below 0.3 but for 1 in 5000 of sets if uniform
    assert min(values) < 0.3


def glide(amplitude, low, high):
    time = np.arange(COUNT) * 1e-3
    rate = (high - low) / (COUNT * 1e-3)
    return amplitude * np.cos(2.0 * np.pi * (low * time + 0.5 * rate * time**2))


@pytest.mark.parametrize(("low", "high"), [(40.0, 75.0), (310.0, 270.0)])
def test_a_gliding_tone_is_followed_from_end_to_end(low, high):
    # 25 sigmas over the record: amplitude sigma sqrt(2 / n) 25
    amplitude = 25.0 * NOISE_NM * (2.0 / COUNT) ** 0.5
    record, space = record_with(glide(amplitude, low, high), seed=3)
    found = gliding_tones(space, record, NOISE_NM)
    assert found is not None
    assert found.domain == "frequency"
    assert found.p_value < 1e-12
    # tiles of four seconds: a quarter of a Hz at either end
    assert found.extent == pytest.approx((min(low, high), max(low, high)), abs=0.3)
    # one standard deviation is a 25th, and up to a tenth is lost between bins
    assert found.size_nm == pytest.approx(amplitude, rel=0.15)


def test_a_weak_gliding_tone_shows_where_its_glide_is_taken_out():
    # twelve sigmas: over 48 degrees of freedom no more than one line in some millions
    amplitude = 12.0 * NOISE_NM * (2.0 / COUNT) ** 0.5
    record, space = record_with(glide(amplitude, 45.0, 75.0), seed=5)
    found = gliding_tones(space, record, NOISE_NM)
    assert found is not None
    assert found.p_value < 1e-6
    assert found.extent == pytest.approx((45.0, 75.0), abs=0.5)


def test_gliding_tones_of_clean_noise_are_rarer_than_stated():
    values = []
    for seed in range(16):
        record, space = record_with(0.0, seed=100 + seed)
        found = gliding_tones(space, record, NOISE_NM)
        assert found is not None
        values.append(found.p_value)
    # 16 records at 5 %: beyond 4 in 0.1 %
    assert sum(value < 0.05 for value in values) <= 4


def test_short_records_are_not_asked():
    record, _ = record_with(0.0)
    short = make_space(
        Whitener(np.ones(1), NOISE_NM, record.valid[:1000], record.valid[:1000]),
        record.base[:1000],
        record.response_nm[:1000],
    )
    assert bursts(short, record, NOISE_NM) is None
    assert gliding_tones(short, record, NOISE_NM) is None
