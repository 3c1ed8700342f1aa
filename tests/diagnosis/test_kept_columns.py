"""Columns, whitened base and normal equations that are kept give what is formed anew."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from hdbench.diagnosis.detect.exact import exact_statistic, solve_exactly
from hdbench.diagnosis.fit.jointfit import fit_jointly, linear_fit
from hdbench.diagnosis.fit.terms import Term, fresh_columns, term_columns
from hdbench.diagnosis.measured import columnstore
from hdbench.diagnosis.measured.record import prepare_record
from hdbench.diagnosis.noise.convolution import DIRECT
from hdbench.diagnosis.noise.whitened import Whitener, make_space
from hdbench.model import BenchModel, catalogue
from hdbench.profile import load_profile
from hdbench.records import Trace

PROFILE = load_profile("cim-tr-97-06").data
SAMPLES = 4000


@pytest.fixture(scope="module")
def record():
    """Ripple of order 3 beside the baseline, in noise of a pole at 0.6, with some samples lost."""
    rng = np.random.default_rng(5)
    time = np.arange(SAMPLES) * 1e-3
    speed = 90.0 + 40.0 * np.sin(2.0 * np.pi * time / 1.9)
    angle = np.concatenate([[0.0], np.cumsum(speed)[:-1] * 1e-3])
    noise = lfilter([1.0], [1.0, -0.6], 0.05 * rng.standard_normal(SAMPLES))
    columns = {
        "time_s": time,
        "motor_velocity_rad_s": speed,
        "motor_angle_rad": angle,
        "torque_nm": 0.4 * np.cos(2 * angle) + 0.1 * np.cos(3 * angle + 0.5) + noise,
    }
    masked = np.zeros(SAMPLES, dtype=bool)
    masked[500:510] = True
    return prepare_record(Trace(columns), PROFILE, BenchModel.from_profile(PROFILE), masked)


def coloured(record):
    used = record.valid.copy()
    used[1:] &= record.valid[:-1]
    used[0] = False
    return Whitener(np.array([1.0, -0.6]), 0.05, record.valid, used)


@pytest.mark.parametrize("length", [1, 5, 6, 13, 32, 33, 64, 65, 700])
@pytest.mark.parametrize("samples", [40, 701])
def test_a_whitener_of_any_length_is_a_causal_filter(length, samples):
    rng = np.random.default_rng(length)
    kernel = np.concatenate([[1.0], rng.standard_normal(length - 1) / length])[:samples]
    valid = np.ones(samples, dtype=bool)
    valid[7:9] = False
    columns = rng.standard_normal((samples, 6))
    white = Whitener(kernel, 0.5, valid, np.ones(samples, dtype=bool)).apply(columns)
    # a long kernel remembers: what is left out is bridged there, zero for a short one
    seen = columns * valid[:, None]
    if len(kernel) > DIRECT:
        at, kept = np.arange(samples), np.flatnonzero(valid)
        seen = np.column_stack([np.interp(at, kept, column[kept]) for column in columns.T])
    expected = lfilter(kernel, [1.0], seen, axis=0) / 0.5
    # sums of a few hundred values of order one in double precision
    assert np.abs(white - expected).max() < 1e-11


def test_columns_are_formed_once_and_those_not_asked_for_go(record, monkeypatch):
    record = replace(record)
    monkeypatch.setattr(columnstore, "_MEMORY", 3 * SAMPLES * 8 * 2)
    cause = catalogue()["ripple-harmonic"]
    terms = [Term(cause, {"order": order}) for order in (3.0, 3.5, 4.5, 5.5)]
    first = term_columns(terms[0], record)
    assert term_columns(terms[0], record) is first
    for term in terms[1:]:
        term_columns(term, record)
    assert term_columns(terms[3], record) is term_columns(terms[3], record)
    again = term_columns(terms[0], record)
    assert again is not first
    assert np.array_equal(again, fresh_columns(terms[0], record))
    assert record.kept.size == sum(c.nbytes for _, c in record.kept.entries.values())


def test_a_space_of_parts_is_that_of_all_columns_side_by_side(record):
    noise = coloured(record)
    fit = fit_jointly(record, [Term(catalogue()["ripple-harmonic"], {"order": 3.0})], noise)
    parts = make_space(noise, fit.parts, record.response_nm)
    whole = make_space(noise, np.hstack(fit.parts), record.response_nm)
    assert np.allclose(parts.residual, whole.residual, rtol=0.0, atol=1e-8)
    columns = term_columns(Term(catalogue()["ripple-harmonic"], {"order": 5.0}), record)
    quick, exact = exact_statistic(parts, columns), solve_exactly(whole, columns)
    assert quick[0] == pytest.approx(exact[0], rel=1e-6)
    assert quick[2] == pytest.approx(exact[2], rel=1e-6)


def test_a_linear_fit_is_plain_least_squares_on_the_whitened_design(record):
    noise = coloured(record)
    terms = [Term(catalogue()["ripple-harmonic"], {"order": order}) for order in (3.0, 5.0)]
    design = np.hstack([record.base, *(fresh_columns(term, record) for term in terms)])
    white, response = noise.apply(design), noise.apply(record.response_nm)
    expected = design @ np.linalg.lstsq(white, response, rcond=None)[0]
    # normal equations square the condition of a zero beside a short arc, about 1e4: a millionth of
    # the ripple is a ten-thousandth of its standard deviation
    assert np.abs(linear_fit(record, terms, noise) - expected).max() < 1e-6
    held = fit_jointly(record, terms, noise, refine=False)
    assert np.abs(held.fitted_nm - expected).max() < 1e-6
    left = response - white @ np.linalg.lstsq(white, response, rcond=None)[0]
    assert held.chi2 == pytest.approx(float(left @ left), rel=1e-9)
