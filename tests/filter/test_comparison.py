"""Filters side by side: what each takes, keeps and costs; the low-pass beside them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from kernel_models import THREE_ORDERS
from numpy.testing import assert_allclose
from tuning_traces import channels, tuned_like, turning

from hdbench.errors import DataError
from hdbench.filter import SlowBlock, butterworth_lowpass, preset, transfer_at_steady_speed
from hdbench.filter.comparison import compare_filters

SWAY = SlowBlock("resonance", variance=2.0, time_constant_s=0.3, frequency_hz=1.5)
TUNED = replace(tuned_like(), blocks=THREE_ORDERS, slow=(tuned_like().slow[0], SWAY))


LOWPASS = (20.0, 2)


@pytest.fixture(scope="module")
def samples():
    """Return time, velocity, angle, torque without slow torque, and the slow torque to add."""
    t, v, angle, y = turning(16.0, slow=0.0, seed=8)
    return t, v, angle, y, 2.0 * np.sin(2 * np.pi * 1.5 * t)


def compared(bench, samples, truth_nm):
    t, v, angle, y, slow = samples
    record = channels(t, v, y + slow, angle)
    report = {"report": preset("report-6", bench)}
    return compare_filters(record, report, TUNED, truth_nm=truth_nm, lowpass=LOWPASS)


def test_the_table_tells_what_each_filter_takes_keeps_and_costs(bench, samples):
    found = compared(bench, samples, truth_nm=samples[-1])
    rows = {row.name: row for row in found.contenders}
    assert list(rows) == ["raw", "lowpass", "report", "tuned", "smoothed"]
    assert found.reference == "truth"
    assert rows["raw"].suppression_db == {"2x": 0.0, "4x": 0.0, "0.01x": 0.0}
    assert rows["raw"].noise_nm == pytest.approx(0.05, rel=0.15)  # ripple adds to it
    # report-6 replaces most of the torque; the tuned filter keeps it
    assert rows["report"].torque_kept < 0.6
    assert rows["tuned"].torque_kept == pytest.approx(1.0, abs=0.02)
    assert min(rows["tuned"].suppression_db.values()) > 20.0
    assert rows["smoothed"].error_rms_nm <= rows["tuned"].error_rms_nm < 0.2
    assert rows["report"].error_rms_nm > 5.0 * rows["tuned"].error_rms_nm
    # group delay of a second-order Butterworth of 20 Hz at low frequency: sqrt 2 / (2 pi 20)
    assert rows["lowpass"].delay_s == pytest.approx(math.sqrt(2.0) / (40.0 * math.pi), rel=0.1)
    assert abs(rows["tuned"].delay_s) < 1e-3
    assert rows["lowpass"].noise_nm < 0.2 * rows["raw"].noise_nm


def test_without_truth_the_smoothed_torque_is_the_reference(bench, samples):
    found = compared(bench, samples, truth_nm=None)
    rows = {row.name: row for row in found.contenders}
    assert found.reference == "smoothed"
    assert rows["smoothed"].error_rms_nm == 0.0
    assert set(rows["smoothed"].suppression_db.values()) == {None}
    assert rows["tuned"].torque_kept == pytest.approx(1.0, abs=0.05)
    assert found.to_dict()["rows"][0]["name"] == "raw"


def test_torque_that_does_not_vary_shows_neither_share_nor_delay(samples):
    t, v, angle, y, _ = samples
    still = channels(t, v, y, angle)
    found = compare_filters(still, {}, TUNED, truth_nm=np.zeros(t.size), lowpass=LOWPASS)
    assert all(row.torque_kept is None and row.delay_s is None for row in found.contenders)


def test_a_record_too_short_to_judge_is_refused():
    t, v, angle, y = turning(1.0)
    for torque, words in ((y, "left to judge"), (np.full_like(y, np.nan), "no sample")):
        record = channels(t, v, torque, angle)
        with pytest.raises(DataError, match=words):
            compare_filters(record, {}, TUNED, truth_nm=None, lowpass=LOWPASS)


def test_the_transfer_keeps_the_shape_of_the_frequencies(bench):
    model = preset("report-a1", bench)
    assert transfer_at_steady_speed(model, 50.0, 1e-3, 3.0).shape == ()
    assert transfer_at_steady_speed(model, 50.0, 1e-3, [[1.0, 2.0]]).shape == (1, 2)


def test_the_lowpass_has_three_decibels_at_its_cut_off():
    t = np.arange(20_000) * 1e-3
    for order in (1, 2, 5):
        y = np.sin(2.0 * math.pi * 20.0 * t)
        low = butterworth_lowpass(y, sample_period_s=1e-3, cutoff_hz=20.0, order=order)
        # a bilinear Butterworth has exactly -3.01 dB at the prewarped cut-off
        assert np.sqrt(2.0 * np.mean(low[10_000:] ** 2)) == pytest.approx(math.sqrt(0.5), rel=1e-4)


def test_the_lowpass_keeps_a_constant_from_its_first_sample_on_and_is_causal():
    y = np.full(300, 3.0)
    y[200:] = 5.0
    low = butterworth_lowpass(y, sample_period_s=1e-3, cutoff_hz=20.0, order=2)
    # steady-state start: rounding of a few products
    assert_allclose(low[:200], 3.0, rtol=1e-12)
    assert low[200] > 3.0
    assert butterworth_lowpass([], sample_period_s=1e-3, cutoff_hz=20.0, order=2).size == 0


@pytest.mark.parametrize(
    ("period", "cutoff", "order"),
    [(1e-3, 500.0, 2), (1e-3, math.nan, 2), (0.0, 20.0, 2), (1e-3, 20.0, 0), (1e-3, 20.0, 9)],
)
def test_a_lowpass_out_of_its_domain_is_refused(period, cutoff, order):
    with pytest.raises(DataError):
        butterworth_lowpass([0.0], sample_period_s=period, cutoff_hz=cutoff, order=order)
