"""Whitening, sums at any place, scans and joint fits against closed forms and plain loops."""

import numpy as np
import pytest
from scipy.signal import lfilter

from hdbench.diagnosis.detect.scan import null_scans, scan_line, upcrossing_rate
from hdbench.diagnosis.detect.scanplan import plan_scans
from hdbench.diagnosis.detect.transform import plan_transform
from hdbench.diagnosis.fit.jointfit import fit_jointly
from hdbench.diagnosis.fit.settle import settle  # noqa: F401 - the room imports as one
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.measured.record import prepare_record
from hdbench.diagnosis.noise.whitened import Whitener, make_space
from hdbench.model import BenchModel, catalogue
from hdbench.profile import load_profile
from hdbench.records import Trace

PROFILE = load_profile("cim-tr-97-06")
NOISE_NM = 0.05


def bench_record(n=20_000, order=None, amplitude=0.0, colour=0.0, seed=0):
    rng = np.random.default_rng(seed)
    time = np.arange(n) * 1e-3
    speed = 90.0 + 40.0 * np.sin(2.0 * np.pi * time / 9.0)
    angle = np.concatenate([[0.0], np.cumsum(speed)[:-1] * 1e-3])
    noise = lfilter([1.0], [1.0, -colour], NOISE_NM * rng.standard_normal(n))
    torque = 0.4 * np.cos(2 * angle) + 0.2 * np.cos(4 * angle) + 0.9 * np.cos(angle / 100) + noise
    if order:
        torque = torque + amplitude * np.cos(order * angle + 0.5)
    columns = {
        "time_s": time,
        "motor_velocity_rad_s": speed,
        "motor_angle_rad": angle,
        "torque_nm": torque,
    }
    trace = Trace(columns)
    model = BenchModel.from_profile(PROFILE.data)
    return prepare_record(trace, PROFILE.data, model, np.zeros(n, dtype=bool))


def whitener(record, colour=0.0):
    used = record.valid.copy()
    if colour:
        used[0] = False
    kernel = np.array([1.0, -colour]) if colour else np.ones(1)
    return Whitener(kernel, NOISE_NM, record.valid, used)


def space_of(record, colour=0.0):
    return make_space(whitener(record, colour), record.base, record.response_nm)


def direct_statistic(record, space, columns):
    """Projection by plain least squares on the explicitly whitened design."""
    design = np.hstack([record.base, columns])
    white = space.whitener.apply(design)[space.whitener.used]
    response = space.whitener.apply(record.response_nm)[space.whitener.used]
    k = record.base.shape[1]

    def chi2(part):
        left = response - part @ np.linalg.lstsq(part, response, rcond=None)[0]
        return left @ left

    return chi2(white[:, :k]) - chi2(white)


def test_transform_equals_the_plain_sum_at_any_places():
    rng = np.random.default_rng(4)
    places = np.sort(rng.uniform(-3.0, 40.0, 500))
    weights = rng.standard_normal((500, 2))
    plan = plan_transform(places, 1.0 / (4.0 * np.ptp(places)), 0.3, 9.0)
    plain = weights.T @ np.exp(-2j * np.pi * np.multiply.outer(places, plan.grid))
    # kernel error exp(-pi 8 sqrt(1/3)) = 5e-7 of the sum of magnitudes, rounding to 24 bits below
    for column, sums in zip(weights.T, plain, strict=True):
        np.testing.assert_allclose(plan(column), sums, rtol=0, atol=1e-6 * np.abs(column).sum())


def test_whitener_matches_a_recursive_filter_and_its_adjoint_is_one():
    rng = np.random.default_rng(1)
    valid = np.ones(400, dtype=bool)
    kernel = np.array([1.0, -0.7, 0.2])
    operator = Whitener(kernel, 0.5, valid, valid)
    x, y = rng.standard_normal((2, 400))
    # rounding of a three-term sum
    np.testing.assert_allclose(operator.apply(x), lfilter(kernel, [0.5], x), rtol=0, atol=1e-12)
    assert operator.apply(x) @ y == pytest.approx(x @ operator.adjoint(y), abs=1e-9)


@pytest.mark.parametrize("colour", [0.0, 0.8])
def test_scan_statistic_is_the_fall_of_the_sum_of_squares(colour):
    record = bench_record(colour=colour)
    space = space_of(record, colour)
    rng = np.random.default_rng(2)
    for scan in plan_scans(record):
        result = scan_line(space, scan)
        for k in rng.integers(0, len(scan.single.grid), 4):
            phase = 2.0 * np.pi * scan.single.grid[k] * scan.positions
            columns = np.column_stack([np.cos(phase), np.sin(phase)])
            exact = direct_statistic(record, space, columns)
            # the whitener acts on a line by its response at 32 classes of speed: 1 % of the size
            assert result.statistic[k] == pytest.approx(exact, rel=0.02, abs=0.02)


def test_upcrossing_rate_agrees_with_the_law_for_white_noise():
    record = bench_record(n=10_000)
    space = space_of(record)
    nulls = space.null_pulls(24, np.random.default_rng(5))
    (scan,) = [s for s in plan_scans(record) if s.domain == "frequency"]
    rate = upcrossing_rate(null_scans(space, scan, nulls))
    # Baluev 2008: FAP = W exp(-z) sqrt(z), W = bandwidth sqrt(4 pi var t), z = T / 2
    width = np.ptp(scan.single.grid)
    law = width * np.sqrt(4.0 * np.pi * np.var(scan.positions))
    # a grid of four points per cell misses some 6 % of the crossings of the continuous field
    assert 0.88 * law < rate < 1.02 * law


def test_joint_fit_reaches_the_bound_of_an_unknown_order():
    order, amplitude, turns = 3.37, 0.05, []
    estimates, stds = [], []
    for seed in range(12):
        record = bench_record(n=10_000, order=order, amplitude=amplitude, seed=seed)
        term = Term(catalogue()["ripple-harmonic"], {"order": order + 0.002})
        fit = fit_jointly(record, (term,), whitener(record))
        estimates.append(fit.terms[0].shape["order"])
        stds.append(np.sqrt(fit.covariances[0][-1, -1]))
        turns.append(record.motion.angle_rad)
    # Cramer-Rao: var(order) = 2 sigma^2 / (A^2 n var(theta)) for a phase that is fitted too
    bound = np.sqrt(2.0) * NOISE_NM / (amplitude * np.sqrt(10_000) * np.std(turns[0]))
    # the line is not orthogonal to baseline orders and its own double: per cent
    np.testing.assert_allclose(stds, bound, rtol=0.05)
    pulls = (np.array(estimates) - order) / np.array(stds)
    # chi^2 with 12 dof lies in (1.9, 34) with 99.9 %
    assert 1.9 < np.sum(pulls**2) < 34.0
