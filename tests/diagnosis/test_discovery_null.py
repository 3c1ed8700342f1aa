"""False alarms on white noise: dictionary, lines and steps against simulation and exact sums."""

import numpy as np
import pytest
from discovery_records import NOISE_NM, fitted, swinging, with_noise
from scipy.stats import chi2, kstest

from hdbench.diagnosis.discovery.dictionary import make_dictionary
from hdbench.diagnosis.discovery.fit import scaled_rows
from hdbench.diagnosis.discovery.lines import plan_scans, scan_looks, scan_power, step_look
from hdbench.model import catalogue

NAMES = (
    "asymmetric-friction", "coulomb-friction", "kinematic-error", "stribeck-friction",
    "torsional-resonance", "viscous-friction", "warm-up",
)  # fmt: skip


@pytest.fixture(scope="module", name="start")
def baseline():
    record = swinging(6000)
    return record, fitted(record)


@pytest.fixture(scope="module", name="calibrated")
def dictionary(start):
    return members_of(NAMES, *start)


def members_of(names, record, fit):
    members = make_dictionary(record, [catalogue()[name] for name in names], fit)
    members.calibrate(fit, np.random.default_rng(1))
    return members


def noises(fit, count, seed):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield with_noise(fit, NOISE_NM * rng.standard_normal(len(fit.record)))


def test_the_smallest_probability_of_a_dictionary_is_even_in_white_noise(start, calibrated):
    _, fit = start
    smallest, single = [], []
    for view in noises(fit, 160, 2):
        looks = calibrated.looks(view.beside())
        smallest.append(min(look.false_alarm for look in looks))
        (viscous,) = (x for x in looks if x.term.name == "viscous-friction")
        single.append(float(chi2.sf(viscous.statistic, viscous.dof)))
    # one member has a chi^2 of its own: 160 values are this far away once in a hundred times
    limit = 1.63 / np.sqrt(160)
    assert kstest(single, "uniform").statistic < limit
    # trials are counted at 5 %: further up the law of many correlated members is another
    for level in (0.02, 0.05, 0.1):
        share = np.mean(np.array(smallest) < level)
        assert abs(share - level) < 4.0 * np.sqrt(level / 160)


def test_a_look_is_the_fall_of_the_sum_of_squares_of_plain_regression(start, calibrated):
    record, fit = start
    noise = NOISE_NM * np.random.default_rng(3).standard_normal(len(record))
    view = with_noise(fit, noise)
    weight = np.sqrt(view.bands.spread(1.0 / view.spectrum.power))

    def left(design):
        response = view.measured * weight
        return float(np.linalg.lstsq(design, response, rcond=1e-9)[1][0])

    base = (view.rows * weight).T
    without = left(base)
    for look in calibrated.looks(view.beside())[:20]:
        columns = np.where(
            record.valid[:, None], look.term.cause.columns(record.motion, look.term.shape), 0.0
        )
        if columns.shape[1] != look.dof:
            continue
        rows = scaled_rows(view.bands, columns)[0] * weight
        # rows are kept in single precision
        wanted = without - left(np.column_stack([base, rows.T]))
        assert look.statistic == pytest.approx(wanted, rel=1e-3, abs=1e-3)


@pytest.mark.parametrize("domain", ["motor-order", "frequency"])
def test_a_scan_is_the_exact_projection(start, domain):
    record, fit = start
    rng = np.random.default_rng(4)
    (scan,) = (s for s in plan_scans(record) if s.domain == domain)
    grid = scan.transform.grid
    # above what the ripple sweeps over, below half the sampling rate at the highest speed
    middle = (grid > 0.15 * grid[-1]) & (grid < 0.4 * grid[-1])
    found = []
    for at in rng.choice(np.flatnonzero(middle), 12, replace=False):
        phase = grid[at] * scan.phase_rad
        line = 0.2 * np.cos(phase + rng.uniform(0.0, 6.0))
        view = with_noise(fit, line + NOISE_NM * rng.standard_normal(len(record)))
        pair = view.bands.transform(np.column_stack([np.cos(phase), np.sin(phase)]))
        information, right = view.beside().project(pair)
        wanted = float(right @ np.linalg.solve(information, right))
        found.append(scan_power(view, scan)[0][at] / wanted)
    # cosine and sine have the same information, and none in common
    np.testing.assert_allclose(found, 1.0, atol=0.02)


def test_lines_of_white_noise_raise_no_more_alarms_than_they_say(start):
    _, fit = start
    known, scans, n = catalogue(), plan_scans(fit.record), 200
    names = ("bearing-defect", "ripple-harmonic", "structural-tone")
    causes = {name: known[name] for name in names}
    looks = [scan_looks(view, scans, causes) for view in noises(fit, n, 5)]
    # a probability each for orders and frequencies, or for known and free places of an order;
    # four standard deviations
    for other in ("ripple-harmonic", "bearing-defect"):
        chances = ([x.false_alarm for x in some if x.term.name != other] for some in looks)
        smallest = np.array([min(some, default=1.0) for some in chances])
        for level in (0.02, 0.05):
            assert np.mean(smallest < level) < 2.0 * level + 4.0 * np.sqrt(2.0 * level / n)
        assert np.mean(smallest < 0.1) > 0.05


def test_the_largest_step_of_white_noise_has_the_tail_of_james_james_and_siegmund():
    # the law is one of a step beside a constant
    fit = fitted(swinging(6000, change=("-misalignment",)))
    step, n = catalogue()["zero-step"], 250
    looks = [step_look(view, step) for view in noises(fit, n, 6)]
    chances = np.array([1.0 if look is None else look.false_alarm for look in looks])
    for level in (0.02, 0.05, 0.1):
        assert abs(np.mean(chances < level) - level) < 3.5 * np.sqrt(level / n)


def test_the_best_step_is_that_of_plain_regression(start):
    record, fit = start
    n = len(record)
    rng = np.random.default_rng(7)
    noise = 0.01 * (np.arange(n) >= 3500) + NOISE_NM * rng.standard_normal(n)
    view = with_noise(fit, noise)
    weight = np.sqrt(view.bands.spread(1.0 / view.spectrum.power))
    base, response = (view.rows * weight).T, view.measured * weight
    q = np.linalg.qr(base)[0]
    left = response - q @ (q.T @ response)
    found = step_look(view, catalogue()["zero-step"])
    at = round(found.term.shape["step_time_s"] * 1e3)
    values = {}
    for place in (at, *range(400, 5700, 200)):
        row = view.bands.transform((np.arange(n) >= place).astype(float)[:, None])[0] * weight
        row = row - q @ (q.T @ row)
        values[place] = float(row @ left) ** 2 / float(row @ row)
    assert found.statistic == pytest.approx(values[at], rel=0.05)
    assert found.statistic > 0.95 * max(values.values())


def test_steps_all_along_are_no_zero_that_jumped(start):
    _, fit = start
    rng = np.random.default_rng(5)
    n = len(fit.record)
    white = NOISE_NM * rng.standard_normal(n)

    def looked(count):
        jumps = np.zeros(n)
        places = np.sort(rng.choice(np.arange(n // 10, n - n // 10), count, replace=False))
        jumps[places] = 0.2 * (-1.0) ** np.arange(count)
        return step_look(with_noise(fit, white + np.cumsum(jumps)), catalogue()["zero-step"])

    assert looked(1).statistic > 1000.0
    # up and down as a torque that sticks and slips goes: none is out of the usual
    crowd = looked(40)
    assert crowd is None or crowd.false_alarm > 0.01


def test_a_member_that_the_baseline_explains_asks_no_trials(start):
    # two are one wave per output turn, which the baseline holds
    members = members_of(("viscous-friction", "load-gravity", "misalignment"), *start)
    assert set(members.family_trials) == {"viscous-friction"}
    assert members.all_trials < 2.0
