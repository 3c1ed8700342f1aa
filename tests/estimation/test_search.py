"""Lines, spectra, stretches and the order of a component."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom

from hdbench.estimation.harmonics import line_frequencies
from hdbench.estimation.search import fit_with_lines, strongest_line
from hdbench.estimation.spectrum import amplitude_spectrum, find_peaks
from hdbench.estimation.stretches import longest_steady, steady_runs, stretch_starts
from hdbench.estimation.trend import SlowMotion, choose_trend

DT = 0.001


def ramp_angle(n: int) -> np.ndarray:
    """Return the motor angle of a ramp from 20 to 150 rad/s."""
    return np.concatenate([[0.0], np.cumsum(np.linspace(20.0, 150.0, n - 1) * DT)])


def fitted(signal: np.ndarray, angle: np.ndarray, time: np.ndarray):
    """Return the fit of a constant and of the lines that the signal shows."""
    everywhere = np.ones(len(signal), dtype=bool)
    constant = np.ones((len(signal), 1))
    return fit_with_lines(
        constant, signal, everywhere, motor_angle_rad=angle, time_s=time, orders=()
    )


def test_false_alarm_probability_is_that_of_white_noise():
    rng = np.random.default_rng(1)
    n_runs, cycles = 300, np.arange(1000) * DT
    found = [strongest_line(rng.normal(size=1000), cycles, "frequency") for _ in range(n_runs)]
    below = sum(line is not None and line.false_alarm_probability < 0.1 for line in found)
    # Baluev's value bounds the probability and is sharp: 10 % at most, half of that at least;
    # false alarm 1e-3 on either side
    assert binom.ppf(0.001, n_runs, 0.05) <= below <= binom.ppf(0.999, n_runs, 0.1)


@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_an_order_and_a_tone_are_each_named_in_their_own_domain(colour):
    rng = np.random.default_rng(2)
    n = 6000
    angle, time = ramp_angle(n), np.arange(n) * DT
    noise = lfilter([1.0], [1.0, -colour], 0.05 * np.sqrt(1 - colour**2) * rng.normal(size=n))
    signal = noise + 0.06 * np.cos(3.3 * angle) + 0.05 * np.cos(2.0 * np.pi * 41.0 * time)
    found = fitted(signal, angle, time)
    places = {line.domain: line.location for line in found.lines}
    assert len(found.lines) == 2
    # a fiftieth of the resolution 1 / 81 turns and 1 / 6 s
    assert places["motor-order"] == pytest.approx(3.3, abs=5e-3)
    assert places["frequency"] == pytest.approx(41.0, abs=1e-2)
    assert all(line.equivalent is None for line in found.lines)


@pytest.mark.parametrize("order", [1.0, 3.0, 6.37])
def test_an_order_through_reversals_is_one_line_at_its_place(order):
    rng = np.random.default_rng(6)
    n = 12_000
    time = np.arange(n) * DT
    velocity = 156.0 * np.clip(8.0 * np.sin(2.0 * np.pi * time / 6.0), -1.0, 1.0)
    angle = np.concatenate([[0.0], np.cumsum(velocity[:-1] * DT)])
    signal = 0.05 * rng.normal(size=n) + 0.2 * np.cos(order * angle + 1.0)
    found = fitted(signal, angle, time)
    (line,) = found.lines
    assert line.domain == "motor-order"
    # Cramer-Rao: sqrt(24 / n) sigma / (A 2 pi span) = 3e-5 of an order for 73 turns; five of them
    assert line.location == pytest.approx(order, abs=1.5e-4)
    # sigma sqrt(2 / n) = 0.65 mN m; five of them
    assert line.component.amplitude.value == pytest.approx(0.2, abs=3.3e-3)


def test_at_constant_velocity_order_and_tone_are_said_to_be_alike():
    rng = np.random.default_rng(3)
    n = 5000
    time = np.arange(n) * DT
    angle = 80.0 * time
    signal = 0.05 * rng.normal(size=n) + 0.05 * np.cos(3.3 * angle)
    found = fitted(signal, angle, time)
    (line,) = found.lines
    assert line.domain == "motor-order"
    # far below the resolution, 1 over the length of the record
    assert line.equivalent == pytest.approx(3.3 * 80.0 / (2.0 * np.pi), abs=1e-2)


def test_line_frequencies_are_refined_between_bins():
    rng = np.random.default_rng(4)
    n = 4096
    index = np.arange(n)
    series = rng.normal(size=n) + 1.5 * np.cos(2.0 * np.pi * 0.1234567 * index)
    found = line_frequencies(series, np.ones(n, dtype=bool))
    # Cramer-Rao sqrt(6 / n^3) / (pi A): 2e-6; interpolation under a window loses up to 2; four
    np.testing.assert_allclose(found, [0.1234567], rtol=0, atol=1.6e-5)


def test_spectrum_reads_the_amplitude_and_the_noise_density():
    rng = np.random.default_rng(5)
    time = np.arange(4000) * DT
    signal = 0.4 * np.cos(2.0 * np.pi * 49.7 * time + 1.0) + 0.05 * rng.normal(size=4000)
    spectrum = amplitude_spectrum(signal, DT)
    peaks = find_peaks(spectrum, 2.0 * np.pi * 49.7 / 2.0, {"2x": 2.0})
    assert [peak.name for peak in peaks] == ["2x"]
    # scalloping of a Hann window on a grid of a quarter bin: 1 %; noise 1 mN m
    assert peaks[0].amplitude_nm == pytest.approx(0.4, rel=0.02)
    assert peaks[0].order == pytest.approx(2.0, abs=0.003)
    quiet = spectrum.frequency_hz > 100.0
    # sigma^2 dt 2; mean of 1600 independent bins: 2.5 %; four of them
    assert np.mean(spectrum.power_density[quiet]) == pytest.approx(2.0 * 0.05**2 * DT, rel=0.1)


def test_a_steady_run_per_direction_leaves_out_the_settling_time():
    velocity = np.concatenate([np.zeros(500), np.full(3000, 60.0), np.full(3000, -60.0)])
    time = np.arange(len(velocity)) * DT
    forth, back = steady_runs(time, velocity, settle_s=0.5, tolerance=0.02)
    # the smoothing of 0.1 s and the settling time of 0.5 s
    assert forth.from_s == pytest.approx(1.0, abs=0.06)
    assert forth.to_s == pytest.approx(3.5, abs=0.06)
    assert back.velocity_rad_s == pytest.approx(-60.0, rel=1e-3)


def test_the_longest_steady_stretch_is_found_between_ramps():
    ramp = np.linspace(0.0, 150.0, 1000)
    velocity = np.concatenate([ramp, np.full(700, 150.0), ramp[::-1], ramp, np.full(1500, 150.0)])
    time = np.arange(len(velocity)) * DT
    found = longest_steady(time, velocity, np.ones(len(time), dtype=bool), tolerance=0.01)
    # half of the 0.1 s smoothing, and the search step
    assert found.from_s == pytest.approx(3.7, abs=0.06)
    assert found.to_s == pytest.approx(5.2, abs=0.06)


def test_no_steady_stretch_in_a_sweep():
    velocity = np.linspace(10.0, 150.0, 3000)
    time = np.arange(3000) * DT
    assert longest_steady(time, velocity, np.ones(3000, dtype=bool), tolerance=0.001) is None


def test_a_trend_is_chosen_only_where_there_is_one():
    rng = np.random.default_rng(6)
    n = 4000
    time = np.arange(n) * DT
    motion = SlowMotion(time, np.full(n, 60.0), np.linspace(0.0, 20.0, n))
    used, nothing = np.ones(n, dtype=bool), np.zeros((n, 0))
    white = rng.normal(size=n)
    assert choose_trend(nothing, white, motion, used).degree == 0
    bent = choose_trend(nothing, white + 3.0 * (time - 2.0) ** 2, motion, used)
    assert bent.degree >= 2


def test_gaps_in_time_start_a_new_stretch():
    time = np.array([0.0, 0.001, 0.002, 0.003, 0.010, 0.011])
    assert np.flatnonzero(stretch_starts(time)).tolist() == [4]
