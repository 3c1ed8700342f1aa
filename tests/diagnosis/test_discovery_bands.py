"""Cosine transform in bands: against the definition, bridged samples, and its transpose."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfilt, sosfiltfilt

from hdbench.diagnosis.discovery.bands import LowPass, make_bands

PERIOD_S = 2e-3
both_ways = pytest.mark.parametrize(("causal", "run"), [(False, sosfiltfilt), (True, sosfilt)])


def whole(n, **more):
    """Return the bands of a record that lost no sample."""
    return make_bands(np.ones(n, dtype=bool), PERIOD_S, **more)


def cosines(size):
    """Return the matrix of the orthonormal cosine transform, by its definition."""
    k, m = np.arange(size)[:, None], np.arange(size)[None, :]
    matrix = np.sqrt(2.0 / size) * np.cos(np.pi * k * (2 * m + 1) / (2 * size))
    matrix[0] /= np.sqrt(2.0)
    return matrix


# 577 is a prime: its transform is longer than the record
@pytest.mark.parametrize("n", [600, 577])
def test_coefficients_are_those_of_the_definition(n):
    bands = whole(n)
    columns = np.random.default_rng(0).standard_normal((n, 3))
    wanted = (cosines(bands.length)[:, :n] @ (bands.fade[:, None] * columns)).T
    np.testing.assert_allclose(bands.transform(columns), wanted, atol=1e-11)


def test_without_fading_products_of_columns_stay():
    n = 577
    bands = replace(whole(n), fade=np.ones(n))
    columns = np.random.default_rng(1).standard_normal((n, 4))
    rows = bands.transform(columns)
    np.testing.assert_allclose(rows @ rows.T, columns.T @ columns, atol=1e-10)
    np.testing.assert_allclose(
        bands.gram(rows, rows[:2]).sum(axis=0), columns.T @ columns[:, :2], atol=1e-10
    )
    assert bands.power(rows[0]).sum() == pytest.approx(np.sum(columns[:, 0] ** 2))


def lossy(n):
    valid = np.ones(n, dtype=bool)
    valid[:3] = valid[100:117] = valid[118] = valid[-2:] = False
    return valid


def uneven(n):
    """Return times whose steps scatter by a fifth."""
    steps = np.exp(0.2 * np.random.default_rng(6).standard_normal(n - 1))
    return np.concatenate([[0.0], np.cumsum(steps)]) * PERIOD_S


def test_lost_samples_are_bridged_by_straight_lines():
    n, valid = 500, lossy(500)
    bands = make_bands(valid, PERIOD_S)
    column = np.random.default_rng(2).standard_normal(n)
    at = np.arange(n)
    bridged = np.interp(at, at[valid], column[valid])
    column[~valid] = 1e6
    found, wanted = bands.transform(column[:, None]), whole(n).transform(bridged[:, None])
    np.testing.assert_allclose(found, wanted, atol=1e-10)


@pytest.mark.parametrize(
    "kind",
    [
        "full", "lossy", "lossy, both ways", "lossy, with delay", "lossy, delay ahead",
        "lossy, over time", "lossy, delay over time",
    ],
)  # fmt: skip
def test_the_inverse_is_the_transpose(kind):
    n = 331
    share = 1.0 if kind == "full" else 0.5
    valid = np.ones(n, dtype=bool) if kind == "full" else lossy(n)
    bands = make_bands(valid, PERIOD_S, share, uneven(n) if "over" in kind else None)
    if "," in kind:
        channel = LowPass(0.15, causal="delay" in kind, analog="ahead" in kind)
        bands = bands.low_passed(replace(channel, over_time="over" in kind))
    # row i is the transform of the i-th unit vector
    matrix = bands.transform(np.eye(n))
    row = np.random.default_rng(3).standard_normal(bands.size)
    np.testing.assert_allclose(bands.inverse(row), matrix @ row, atol=1e-11)


@pytest.mark.parametrize("causal", [False, True])
def test_what_a_low_pass_leaves_of_a_tone_is_its_gain(causal):
    n, hertz, corner = 4000, 40.0, 0.1
    bands = whole(n)
    tone = np.cos(2.0 * np.pi * hertz * np.arange(n) * PERIOD_S)[:, None]
    channel = bands.low_passed(LowPass(corner, causal=causal))
    open_, passed = bands.transform(tone)[0], channel.transform(tone)[0]
    gain = np.sqrt(np.sum(passed**2) / np.sum(open_**2))
    # a Butterworth of second order halves the power at its corner; both ways it acts twice
    ratio = np.tan(np.pi * hertz * PERIOD_S) / np.tan(0.5 * np.pi * corner)
    once = 1.0 / np.sqrt(1.0 + ratio**4)
    # a coefficient is 1 / (2 n T) = 0.06 Hz wide
    assert gain == pytest.approx(once if causal else once**2, rel=0.02)
    already = channel.transform(tone, measured=True)[0]
    np.testing.assert_array_equal(already, open_)


@both_ways
def test_a_filter_goes_on_through_lost_samples(causal, run):
    n, corner = 3000, 0.2
    valid = np.random.default_rng(5).random(n) > 0.05
    wave = np.cos(2.0 * np.pi * 60.0 * np.arange(n) * PERIOD_S)
    stored = run(butter(2, corner, output="sos"), wave)
    bands = make_bands(valid, PERIOD_S).low_passed(LowPass(corner, causal=causal))
    lost = np.where(valid, stored, np.nan)[:, None]
    found, measured = bands.transform(wave[:, None])[0], bands.transform(lost, measured=True)[0]
    # both ends of the filters differ
    assert np.std(found - measured) < 0.01 * np.std(measured)


@both_ways
def test_a_filter_runs_over_the_times_of_uneven_samples(causal, run):
    # what a filter at 50 kHz makes of a tone at a fifth of the sampling rate, read unevenly
    n, hertz, corner_hz, rate = 3000, 100.0, 50.0, 50_000.0
    times = uneven(n)
    fine = np.arange(int(times[-1] * rate) + 2) / rate
    # the filters differ at both ends
    tone = np.cos(2.0 * np.pi * hertz * fine) * np.exp(-(((fine - 3.0) / 1.2) ** 2))
    stored = np.interp(times, fine, run(butter(2, corner_hz, fs=rate, output="sos"), tone))
    read = np.interp(times, fine, tone)[:, None]
    bands = whole(n, taken_s=times)
    corner = 2.0 * corner_hz * PERIOD_S
    left = {}
    for over_time in (False, True):
        channel = bands.low_passed(LowPass(corner, 2, causal, analog=True, over_time=over_time))
        measured = channel.transform(stored[:, None], measured=True)[0]
        error = channel.transform(read)[0] - measured
        left[over_time] = float(np.std(error) / np.std(measured))
    # over the samples the phase of the tone scatters by .2 of a step, .25 rad, and more
    assert left[False] > 0.25
    assert left[True] < 0.01


def test_the_damping_of_a_low_pass_makes_other_filters_of_it():
    wave = np.random.default_rng(7).standard_normal(4000)
    plain = LowPass(0.2, causal=True).applied(wave)
    np.testing.assert_allclose(
        plain - wave[0], sosfilt(butter(2, 0.2, output="sos"), wave - wave[0])
    )
    # two equal stages of first order, as of resistors and capacitors
    stages = np.vstack([butter(1, 0.2, output="sos")] * 2)
    damped = LowPass(0.2, causal=True, damping=np.sqrt(2.0)).applied(wave)
    np.testing.assert_allclose(damped - wave[0], sosfilt(stages, wave - wave[0]), atol=1e-7)


@both_ways
def test_a_filter_ahead_of_the_sampling_bends_no_frequencies(causal, run):
    # 200 samples/s of a torque that was filtered at 10 kHz: a tone at 0.8 of Nyquist's frequency
    fine = np.arange(200_000) * 1e-4
    wave = np.cos(2.0 * np.pi * 80.0 * fine) * np.exp(-((fine - 10.0) ** 2) / 8.0)
    stored = run(butter(2, 48.0, fs=1e4, output="sos"), wave)[::50]
    analog, sampled = (LowPass(0.48, causal=causal, analog=kind) for kind in (True, False))
    np.testing.assert_allclose(analog.applied(wave[::50]), stored, atol=2e-3)
    # one of samples has a zero at Nyquist's frequency
    assert np.abs(sampled.applied(wave[::50])).max() < 0.5 * np.abs(stored).max()


def test_bands_cover_the_coefficients_and_count_what_is_independent():
    valid = lossy(500)
    bands = make_bands(valid, PERIOD_S)
    assert bands.edges[0] == 0
    assert bands.edges[-1] == bands.length
    assert np.all(np.diff(bands.edges) > 0)
    # the fade at both ends and 23 lost samples are no information
    assert bands.counts.sum() == pytest.approx(np.sum(bands.fade[valid] ** 2))
    assert bands.frequency_hz[-1] == pytest.approx(0.5 / PERIOD_S, rel=0.05)


@both_ways
def test_a_filter_is_undone_where_it_passes_enough(causal, run):
    n, corner = 4000, 0.1
    time = np.arange(n) * PERIOD_S
    # 2 and 9 Hz against a corner of 25 Hz
    wave = np.cos(2.0 * np.pi * 2.0 * time) + 0.5 * np.sin(2.0 * np.pi * 9.0 * time)
    held = run(butter(2, corner, output="sos"), wave)
    inside = np.abs(time - time.mean()) < 3.0
    made = LowPass(corner, causal=causal).applied(wave)
    np.testing.assert_allclose(made[inside], held[inside], atol=1e-6)
    held[500] = np.nan
    found = LowPass(corner, causal=causal).undone(held)
    assert np.isnan(found[500])
    inside[490:510] = False
    # a thousandth is held back so that noise does not grow without bound
    np.testing.assert_allclose(found[inside], wave[inside], atol=5e-3)
