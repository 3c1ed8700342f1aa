"""What the filter does to torque at a steady speed, by algebra and by injection."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hdbench.errors import DataError
from hdbench.filter import (
    OnlineFilter,
    butterworth_lowpass,
    preset,
    transfer_at_steady_speed,
)

# |H(0)| from measured to filtered torque: the acceptance's figures, three digits
AT_ZERO = [
    ("report-a1", 50.0, 0.141),
    ("report-a1", 156.0, 0.531),
    ("report-a2", 50.0, 0.061),
    ("report-a2", 156.0, 0.206),
    ("report-6", 50.0, 0.088),
    ("report-6", 156.0, 0.331),
]
PERIOD = 1e-3


def injected(model, velocity, frequency_hz):
    """Return |H| of the running filter: least squares of sine and cosine on its settled output."""
    # slowest mode: 0.02 s, or with the output order 2.4 s at 50 rad/s and less at higher speed
    n = 4_000 if model.name == "report-a1" else int(40_000 * 50.0 / abs(velocity))
    t = np.arange(n) * PERIOD
    phase = 2.0 * math.pi * frequency_hz * t
    y = np.cos(phase) if frequency_hz else np.ones(n)
    block = OnlineFilter(model).process(t, np.full(n, velocity), y)
    settled = slice(9 * n // 10, n)
    basis = np.stack([np.cos(phase), np.sin(phase)], axis=1)[settled]
    basis = basis if frequency_hz else basis[:, :1]
    fit = np.linalg.lstsq(basis, block.torque_filtered_nm[settled], rcond=None)[0]
    return float(np.hypot(*fit) if frequency_hz else abs(fit[0]))


@pytest.mark.parametrize(("name", "velocity", "wanted"), AT_ZERO)
def test_the_presets_pass_this_share_of_a_constant_torque_by_algebra(bench, name, velocity, wanted):
    # three printed digits, the last one to half a unit and a little
    h = transfer_at_steady_speed(preset(name, bench), velocity, PERIOD, 0.0)
    assert abs(h) == pytest.approx(wanted, abs=6e-4)


@pytest.mark.parametrize(("name", "velocity", "wanted"), AT_ZERO)
def test_the_presets_pass_this_share_of_a_constant_torque_by_injection(
    bench, name, velocity, wanted
):
    # three printed digits, the last one to half a unit and a little
    assert injected(preset(name, bench), velocity, 0.0) == pytest.approx(wanted, abs=6e-4)


@pytest.mark.parametrize("velocity", [100.0, -156.0])
@pytest.mark.parametrize("name", ["report-a1", "report-a2", "report-6"])
def test_every_block_is_a_zero_by_algebra_and_by_injection(bench, name, velocity):
    model = preset(name, bench)
    for block in model.blocks:
        hz = abs(block.order * velocity) / (2.0 * math.pi)
        # a pole of the open loop: only rounding is left, divided by the loop's conditioning
        assert abs(transfer_at_steady_speed(model, velocity, PERIOD, hz)) < 1e-9
        # the slowest mode has decayed by exp(-18 / 1.2) = 3e-7
        assert injected(model, velocity, hz) < 1e-6


def test_injection_agrees_with_algebra_at_other_frequencies(bench):
    model = preset("report-6", bench)
    for hz in (3.0, 31.0, 77.7, 210.0):
        wanted = abs(transfer_at_steady_speed(model, 156.0, PERIOD, hz))
        # settled to rounding; the fit is exact for one line
        assert injected(model, 156.0, hz) == pytest.approx(wanted, abs=1e-6)


def test_the_transfer_keeps_the_shape_of_the_frequencies(bench):
    model = preset("report-a1", bench)
    assert transfer_at_steady_speed(model, 50.0, PERIOD, 3.0).shape == ()
    assert transfer_at_steady_speed(model, 50.0, PERIOD, [[1.0, 2.0]]).shape == (1, 2)


@pytest.mark.parametrize("velocity", [0.0, math.nan, math.inf])
def test_no_transfer_where_there_is_no_steady_gain(bench, velocity):
    with pytest.raises(DataError, match="steady gain"):
        transfer_at_steady_speed(preset("report-a1", bench), velocity, PERIOD, 0.0)


def test_the_lowpass_has_three_decibels_at_its_cut_off():
    t = np.arange(20_000) * PERIOD
    for order in (1, 2, 5):
        y = np.sin(2.0 * math.pi * 20.0 * t)
        low = butterworth_lowpass(y, sample_period_s=PERIOD, cutoff_hz=20.0, order=order)
        # a bilinear Butterworth has exactly -3.01 dB at the prewarped cut-off
        assert np.sqrt(2.0 * np.mean(low[10_000:] ** 2)) == pytest.approx(math.sqrt(0.5), rel=1e-4)


def test_the_lowpass_keeps_a_constant_from_its_first_sample_on_and_is_causal():
    y = np.full(300, 3.0)
    y[200:] = 5.0
    low = butterworth_lowpass(y, sample_period_s=PERIOD, cutoff_hz=20.0, order=2)
    # steady-state start: rounding of a few products
    assert_allclose(low[:200], 3.0, rtol=1e-12)
    assert low[200] > 3.0
    assert butterworth_lowpass([], sample_period_s=PERIOD, cutoff_hz=20.0, order=2).size == 0


@pytest.mark.parametrize(
    ("period", "cutoff", "order"),
    [(1e-3, 500.0, 2), (1e-3, math.nan, 2), (0.0, 20.0, 2), (1e-3, 20.0, 0), (1e-3, 20.0, 9)],
)
def test_a_lowpass_out_of_its_domain_is_refused(period, cutoff, order):
    with pytest.raises(DataError):
        butterworth_lowpass([0.0], sample_period_s=period, cutoff_hz=cutoff, order=order)
