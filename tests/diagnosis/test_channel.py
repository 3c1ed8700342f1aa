"""Channel of the torque and the noise in it: delays, low-passes through gaps, loud stretches."""

import numpy as np
import pytest
from discovery_records import PROFILE, prepared
from scipy.signal import butter, sosfilt, sosfiltfilt
from swinging_shaft import RIPPLE, is_behind_the_filter, record, reversing, trace_of

from hdbench.diagnosis import diagnose_trace
from hdbench.diagnosis.discovery.bands import LowPass, make_bands, shifted
from hdbench.diagnosis.discovery.channel import start_fit
from hdbench.diagnosis.discovery.fit import Fit
from hdbench.diagnosis.discovery.loudness import loudness
from hdbench.diagnosis.discovery.record import SAMPLED
from hdbench.records import Trace


def dry(_angle, speed, _load):
    return 0.3 * np.tanh(speed / 0.5)


def late(samples):
    """Return a channel that is read some samples late."""
    return lambda torque: np.concatenate([np.full(samples, torque[0]), torque])[: len(torque)]


def causal(sections):
    """Return a channel that filters forward, settled at its first sample."""
    return lambda torque: torque[0] + sosfilt(sections, torque - torque[0])


def named(result):
    return {cause.name: cause for cause in (*result.causes, *result.minor)}


def test_a_shift_is_the_signal_some_samples_ago_and_keeps_its_power():
    at = np.arange(2000.0)
    wave = np.cos(0.31 * at + 0.2)
    inside = slice(100, 1900)
    moved = shifted(wave, 2.25)
    np.testing.assert_allclose(moved[inside], np.cos(0.31 * (at - 2.25) + 0.2)[inside], atol=2e-3)
    noise = np.random.default_rng(0).standard_normal(2000)
    assert np.sum(shifted(noise, 0.5) ** 2) == pytest.approx(np.sum(noise**2), rel=0.01)


def test_a_delay_is_found_beside_friction():
    found = named(diagnose_trace(reversing(dry, channel=late(2), n=8000), PROFILE))
    assert {"time-skew", "coulomb-friction"} <= set(found)
    skew = found["time-skew"].parameters["skew_s"]
    assert abs(skew.value - 0.002) < 4.0 * skew.std < 1e-4


def test_a_delay_of_more_than_half_a_turn_of_the_ripple_is_found():
    # at 150 rad/s the ripple of order 4 turns by 3.6 rad in 6 ms
    whole = record(motion=(150.0, 60.0, 5.0), ripple=RIPPLE)
    trace = whole.with_columns(torque_nm=late(6)(whole["torque_nm"]))
    result = diagnose_trace(trace, PROFILE, materiality=0.0)
    (skew,) = result.causes
    assert skew.name == "time-skew"
    value = skew.parameters["skew_s"]
    assert abs(value.value - 0.006) < 4.0 * value.std < 1e-3
    # the model with the delay explains the record
    again = diagnose_trace(trace, PROFILE, model=result.model)
    assert again.causes == ()
    assert "time-skew" in {term.name for term in again.model.causes}


@pytest.mark.campaign
def test_no_delay_is_found_where_there_is_none():
    assert "time-skew" not in named(diagnose_trace(reversing(dry), PROFILE))


def test_a_low_pass_is_found_through_gaps_of_the_stamps():
    filtered = causal(butter(2, 12.0, fs=1000.0, output="sos"))
    whole = reversing(dry, channel=filtered, noise_nm=0.01, n=9000)
    kept = np.ones(len(whole), dtype=bool)
    for first in (2500, 5000, 7300):
        kept[first : first + 25] = False
    trace = Trace({name: values[kept] for name, values in whole.columns.items()})
    result = diagnose_trace(trace, PROFILE)
    found = result.settings["torque_low_pass"]
    assert (found["delayed"], found["order"]) == (True, 2)
    assert found["corner_hz"] == pytest.approx(12.0, rel=0.05)
    assert {cause.name for cause in result.causes} <= {"coulomb-friction", "missed-samples"}
    assert result.unexplained == ()
    assert len(result.pictures.time_s) == len(trace)
    assert is_behind_the_filter(result.pictures)


@pytest.mark.parametrize("hertz", [40.0, pytest.param(15.0, marks=pytest.mark.campaign)])
def test_a_low_pass_of_another_form_is_no_cause(hertz):
    # two stages of first order: no low-pass that is tried has this form
    stages = causal(np.vstack([butter(1, hertz, fs=1000.0, output="sos")] * 2))
    result = diagnose_trace(reversing(dry, channel=stages, noise_nm=0.01, n=7000), PROFILE)
    (cause,) = result.causes
    assert "coulomb-friction" in cause.group
    assert result.unexplained == ()
    forms = {form["name"]: form["scale"] for form in result.settings["form_errors"]}
    assert forms["torque-channel"] > 0.03


def test_the_band_of_a_stored_torque_is_the_same_whatever_is_expected():
    sections = butter(2, 5.0, fs=1000.0, output="sos")
    trace = reversing(dry, noise_nm=0.02)
    stored = {name: sosfiltfilt(sections, trace[name]) for name in ("torque_nm", "load_torque_nm")}
    trace = Trace({k: v[::5] for k, v in {**trace.columns, **stored}.items()})
    fit = start_fit(prepared(trace))
    # where the load was stored behind the filter, causes act on what that was undone of
    assert fit.record.low_pass.load
    again, plain = start_fit(fit.record), start_fit(fit.record.behind(None))
    assert len(fit.bands) == len(again.bands) == len(plain.bands)
    assert fit.shapes.floor == pytest.approx(again.shapes.floor)
    assert fit.bands.frequency_hz[-1] < 50.0


@pytest.mark.parametrize("analog", [True, False])
def test_a_line_above_the_nyquist_frequency_is_filtered_ahead_of_the_sampling(analog):
    # order 4 at 10 to 200 rad/s: 6 to 127 Hz, sampled at 125 Hz
    time = np.arange(4000) * 8e-3
    speed = 105.0 + 95.0 * np.sin(0.4 * time)
    angle = 105.0 * time + 237.5 * (1.0 - np.cos(0.4 * time))
    record = prepared(trace_of(time, speed, angle, 0.1 * speed))
    low_pass = LowPass(0.5, analog=analog)
    bands = make_bands(record.valid, record.period_s).low_passed(low_pass)
    fit = Fit.laid_out(record.behind(low_pass), bands, 1e-6)
    parts = [i for i, one in enumerate(fit.parts) if one.name.startswith(SAMPLED)]
    scale = np.concatenate([fit.parts[part].scale for part in parts])
    held = {fit.parts[part].name for part in parts}
    places = [i for i, name in enumerate(record.names) if name.rpartition(":")[0] in held]
    stored = bands.transform(record.columns[:, places], measured=True)
    alike = np.allclose(fit.rows[np.isin(fit.owner, parts)] * scale[:, None], stored)
    assert alike == analog


@pytest.mark.parametrize("times", [1.0, 2.0])
def test_loudness_is_the_variance_where_an_effect_acts(times):
    n, found = 12_000, []
    bands = make_bands(np.ones(n, dtype=bool), 1e-3)
    # the effect acts in a quarter of the record, in many short stretches
    acting = (np.arange(n) // 10) % 4 == 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        effect = np.where(acting, rng.choice([-1.0, 1.0], n), 0.0)
        noise = np.where(acting, times, 1.0) * rng.standard_normal(n)
        row, left = bands.transform(np.column_stack([effect, noise]))
        left -= (row @ left) / (row @ row) * row
        found.append(loudness(bands, row, left, np.ones(len(bands))))
    # less what chance gives 192 stretches: 1 + 2 sqrt(2 / 192)
    assert np.median(found) == pytest.approx(max(1.0, times**2 / 1.204), rel=0.1)
    if times == 1.0:
        assert np.mean(np.array(found) > 1.0) < 0.2
