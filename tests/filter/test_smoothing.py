"""Order tracking: amplitude and phase over time, order spectrum, order map."""

import math

import numpy as np
import pytest
from kernel_models import THREE_ORDERS, filter_model, order_block
from numpy.testing import assert_allclose
from tuning_traces import channels, recorded, turning

from hdbench.errors import DataError
from hdbench.filter import SlowBlock
from hdbench.filter.orders import motor_angle, order_map, order_spectrum, smooth_channels

MODEL = filter_model(
    THREE_ORDERS,
    0.0025,
    angle=True,
    slow=(SlowBlock("ornstein-uhlenbeck", variance=0.25, time_constant_s=0.1),),
    order_prior_std_nm=4.0,
)


def test_amplitude_and_phase_of_every_order_lie_within_their_bands():
    found = smooth_channels(MODEL, recorded(12.0, seed=3))
    truth = {"order_2": (1.2, 0.6), "order_4": (0.6, -1.1), "order_0.01": (3.0, 0.3)}
    assert [wave.name for wave in found.waves] == list(truth)
    for wave in found.waves:
        amplitude, phase = truth[wave.name]
        for k in (0, 3000, 11_999):
            # four standard deviations: one in 16 000 by chance
            assert abs(wave.amplitude_nm[k] - amplitude) < 4.0 * wave.amplitude_std_nm[k]
            assert abs(wave.phase_rad[k] - phase) < 4.0 * wave.phase_std_rad[k]
        # a minute of noise 0.05 fixes the orders; the output order only against 0.5 N m of torque
        assert wave.amplitude_std_nm.max() < 0.5
    assert found.waves[0].amplitude_std_nm.max() < 0.01


def test_a_growing_amplitude_is_followed_through_the_whole_trace():
    t, v, angle, _ = turning(8.0)
    rng = np.random.default_rng(0)
    growth = np.linspace(0.2, 1.8, t.size)
    y = growth * np.cos(2 * angle + 1.0) + rng.normal(0, 0.05, t.size)
    one = filter_model((order_block(2.0, 1e-4),), 0.0025, angle=True, order_prior_std_nm=4.0)
    wave = smooth_channels(one, channels(t, v, y, angle)).waves[0]
    inside = slice(200, -200)
    # bands of 4 standard deviations; a ramp is what this process noise expects
    error = np.abs(wave.amplitude_nm - growth)[inside] / wave.amplitude_std_nm[inside]
    assert np.mean(error < 4.0) > 0.99
    assert np.mean(wave.amplitude_std_nm[inside]) < 0.06


def test_the_smoothed_torque_keeps_the_slow_torque():
    t, v, angle, y = turning(10.0, seed=6)
    found = smooth_channels(MODEL, channels(t, v, y, angle))
    waves = 1.2 * np.cos(2 * angle + 0.6) + 0.6 * np.cos(4 * angle - 1.1)
    waves += 3.0 * np.cos(angle / 100 + 0.3)
    error = found.torque_smoothed_nm - (y - waves)
    # the bands of three orders together, the misalignment's above all
    assert np.sqrt(np.mean(error**2)) < 2.0 * found.waves[2].amplitude_std_nm.mean()
    assert np.std(found.slow_nm) == pytest.approx(0.5, rel=0.3)
    assert (found.slow_std_nm > 0.0).all()


def test_missing_samples_are_bridged_and_stay_missing():
    t, v, angle, y = turning(4.0, seed=2)
    y[1000:1400] = np.nan
    found = smooth_channels(MODEL, channels(t, v, y, angle))
    assert np.array_equal(np.isnan(found.torque_smoothed_nm), np.isnan(y))
    assert np.isfinite(found.waves[0].amplitude_nm).all()


def test_without_an_encoder_the_velocity_is_integrated():
    t, v, angle, y = turning(3.0)
    assert_allclose(motor_angle(channels(t, v, y)), angle, atol=1e-9)
    with_holes = angle.copy()
    with_holes[500:600] = np.nan
    # the hole is carried by the same velocity that made the angle
    assert_allclose(motor_angle(channels(t, v, y, with_holes)), angle, atol=1e-9)


def test_nothing_to_smooth_is_told():
    t, v, angle, y = turning(3.0)
    with pytest.raises(DataError, match="no sample"):
        smooth_channels(MODEL, channels(t, v, np.full_like(y, np.nan), angle))


@pytest.mark.parametrize("encoder", [True, False])
def test_the_order_spectrum_shows_orders_at_their_amplitude_through_a_sweep(encoder):
    t, v, angle, y = turning(12.0, slow=0.0)
    y = y + 0.3 * np.cos(7.9 * angle)
    found = order_spectrum(channels(t, v, y, angle if encoder else None), y)
    peaks = {round(p.order, 1): p.amplitude_nm for p in found.peaks}
    for order, amplitude in ((2.0, 1.2), (4.0, 0.6), (7.9, 0.3)):
        # scalloping of the padded Hann window 1 %, spline at the fastest speed another
        assert peaks[order] == pytest.approx(amplitude, rel=0.03)
    assert found.speed_rad_s[0] < 50.0
    assert found.speed_rad_s[2] > 150.0
    assert found.order[-1] <= 12.0


def test_a_tone_of_the_clock_is_no_line_over_orders():
    t, v, angle, _ = turning(12.0)
    y = np.cos(2 * np.pi * 30.0 * t) + np.random.default_rng(0).normal(0, 0.05, t.size)
    found = order_spectrum(channels(t, v, y, angle), y)
    assert found.amplitude_nm.max() < 0.5


def test_the_order_map_shows_when_an_order_comes():
    t, v, angle, y = turning(12.0, slow=0.0)
    y = y + np.where(t > 6.0, 0.5, 0.0) * np.cos(6.0 * angle)
    found = order_map(channels(t, v, y, angle), y)
    assert found.amplitude_nm.shape == (found.time_s.size, found.order.size)
    at = np.argmin(np.abs(found.order - 6.0))
    row = found.amplitude_nm[:, at - 2 : at + 3].max(axis=1)
    # windows overlap by half: those wholly before and after
    assert row[found.time_s < 5.0].max() < 0.05
    assert row[found.time_s > 7.0].min() == pytest.approx(0.5, rel=0.1)


def test_a_reversal_splits_the_stretch_and_too_few_turns_are_refused():
    t = np.arange(6000) * 1e-3
    v = np.where(t < 4.0, 50.0, -50.0)
    angle = np.concatenate([[0.0], np.cumsum(v[:-1] * 1e-3)])
    y = np.cos(2 * angle)
    found = order_spectrum(channels(t, v, y, angle), y)
    assert found.turns == pytest.approx(4.0 * 50.0 / (2.0 * math.pi), rel=0.01)
    with pytest.raises(DataError, match="motor turns"):
        order_spectrum(channels(t[:300], v[:300], y[:300], angle[:300]), y[:300])
    with pytest.raises(DataError, match="motor turns"):
        order_spectrum(channels(t, 0.0 * v, y, 0.0 * angle), y)
