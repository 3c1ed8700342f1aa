"""Gains of experiments: positions, directions, ranges, outliers, against published examples."""

import math

import numpy as np
import pytest
from scipy import stats
from worked_example import EIGHT, FLAT

from hdbench.calibration import differences
from hdbench.calibration.budget import expanded_uncertainty
from hdbench.calibration.gains import (
    any_one_position,
    extreme_values,
    gain_outliers,
    grubbs_limit,
    mixed_fit,
    one_way,
)
from hdbench.results.calibration import ExperimentLine

WAYS = [("cw",), ("ccw",)] * 4
PLACES = [0, 0, 1, 1, 2, 2, 3, 3]


def test_analysis_of_variance_of_the_eight_gains_is_that_printed():
    found = one_way(EIGHT)
    assert found.mean_square_between == pytest.approx(0.0398333, abs=5e-8)
    assert found.mean_square_within == pytest.approx(0.001125, abs=5e-7)
    theirs = tuple(stats.f_oneway(*EIGHT))
    assert (found.f_ratio, found.probability) == pytest.approx(theirs, rel=1e-9)
    # in percent of 6.60: 0.508, 2.108, 2.168
    assert found.repeatability_nm_per_v == pytest.approx(0.03354, abs=5e-6)
    assert found.between_positions_nm_per_v == pytest.approx(0.13912, abs=5e-6)
    assert found.reproducibility_nm_per_v == pytest.approx(0.14311, abs=5e-6)
    assert found.intraclass_correlation == pytest.approx(0.945, abs=5e-4)
    assert found.mean_std_nm_per_v == pytest.approx(0.070563, abs=5e-7)


def test_expanded_uncertainties_of_the_eight_gains_are_those_printed():
    found = one_way(EIGHT)
    # in percent of 6.60: 3.402 and 1.686
    mean = expanded_uncertainty(found.mean_std_nm_per_v, 3.0)
    assert mean.expanded == pytest.approx(0.22456, abs=5e-6)
    naive = expanded_uncertainty(float(np.std(FLAT, ddof=1)) / math.sqrt(8.0), 7.0)
    assert naive.expanded == pytest.approx(0.11127, abs=5e-6)
    std, dof = any_one_position(found)
    both = math.hypot(found.mean_std_nm_per_v, found.reproducibility_nm_per_v)
    assert std == pytest.approx(both, rel=1e-12)
    assert 3.0 < dof < 4.0


def test_directions_of_the_eight_gains_differ_as_printed():
    ways = [way for (way,) in WAYS]
    found = differences.paired_difference(list(zip(PLACES, ways, FLAT, strict=True)), "cw", "ccw")
    means = found.mean_first_nm_per_v, found.mean_second_nm_per_v
    assert means == pytest.approx((6.5775, 6.6225), abs=1e-12)
    assert abs(found.difference_nm_per_v.value) == pytest.approx(0.045, abs=1e-12)
    assert 100.0 * abs(found.relative.value) == pytest.approx(0.682, abs=5e-4)
    assert abs(found.t_statistic) == pytest.approx(5.196, abs=5e-4)
    assert found.probability == pytest.approx(0.0138, abs=5e-5)
    theirs = stats.ttest_rel(*zip(*EIGHT, strict=True))
    assert found.probability == pytest.approx(theirs.pvalue, rel=1e-9)


def test_gains_with_their_own_uncertainties_have_the_printed_birge_ratio():
    found = differences.consensus(FLAT, [0.0105] * 8)
    assert found.chi_square == pytest.approx(1124.7, abs=0.05)
    assert found.birge_ratio == pytest.approx(12.68, abs=5e-3)
    assert found.between_std_nm_per_v == pytest.approx(0.13268, abs=5e-6)


def test_paule_mandel_solves_its_equation_for_unequal_uncertainties():
    rng = np.random.default_rng(3)
    own = rng.uniform(0.01, 0.3, 9)
    gains = 6.6 + rng.normal(0.0, 0.2, 9)
    found = differences.consensus(list(gains), list(own))
    off = gains - found.weighted_mean_nm_per_v.value
    total = np.sum(off**2 / (own**2 + found.between_std_nm_per_v**2))
    assert total == pytest.approx(8.0, rel=1e-9)


@pytest.mark.parametrize("dropped", [(), (7,), (0, 5), (0,)])
@pytest.mark.parametrize("effects", [False, True])
def test_the_mixed_model_agrees_with_statsmodels(dropped, effects):
    from statsmodels.regression.mixed_linear_model import MixedLM

    keep = [i for i in range(8) if i not in dropped]
    gains = [FLAT[i] for i in keep]
    places, ways = [PLACES[i] for i in keep], [WAYS[i] if effects else () for i in keep]
    found = mixed_fit(gains, places, ways)
    design = np.column_stack([np.ones(8), np.resize([-1.0, 1.0], 8)])[keep, : 1 + effects]
    fit = MixedLM(np.array(gains), design, groups=np.array(places)).fit(reml=True)
    # theirs is found by iteration, which leaves 1e-3 in the standard deviations
    assert found.gain_nm_per_v.value == pytest.approx(float(fit.fe_params[0]), rel=1e-6)
    ours = found.gain_nm_per_v.std, found.between_positions_nm_per_v, found.repeatability_nm_per_v
    theirs = fit.bse_fe[0], math.sqrt(fit.cov_re[0, 0]), math.sqrt(fit.scale)
    assert ours == pytest.approx(theirs, rel=2e-3)


def test_a_mixed_model_without_data_for_its_effects_is_refused():
    assert mixed_fit([1.0, 2.0, 3.0], [0, 0, 0], [()] * 3) is None
    assert mixed_fit([1.0, 2.0], [0, 1], [("cw",), ("ccw",)]) is None


@pytest.mark.parametrize(
    ("n", "limit"),
    [(3, 1.154), (4, 1.481), (6, 1.887), (8, 2.127), (12, 2.412), (16, 2.586), (24, 2.802)],
)
def test_grubbs_limits_are_those_of_the_table(n, limit):
    # 1.48125 and 2.58565 print as 1.481 and 2.586: half a unit and rounding
    assert grubbs_limit(n) == pytest.approx(limit, abs=5.1e-4)


def test_outliers_of_rosners_published_example_are_found():
    # NIST/SEMATECH e-Handbook, section 1.3.5.17.3: 54 values, three outliers at the 5 % level
    values = [
        -0.25, 0.68, 0.94, 1.15, 1.20, 1.26, 1.26, 1.34, 1.38, 1.43, 1.49, 1.49, 1.55, 1.56,
        1.58, 1.65, 1.69, 1.70, 1.76, 1.77, 1.81, 1.91, 1.94, 1.96, 1.99, 2.06, 2.09, 2.10,
        2.14, 2.15, 2.23, 2.24, 2.26, 2.35, 2.37, 2.40, 2.47, 2.54, 2.62, 2.64, 2.90, 2.92,
        2.92, 2.93, 3.21, 3.26, 3.30, 3.59, 3.68, 4.30, 4.64, 5.34, 5.42, 6.01,
    ]  # fmt: skip
    found = extreme_values(values)
    assert [values[o.index] for o in found] == [6.01, 5.42, 5.34]
    # statistics and critical values as printed there
    np.testing.assert_allclose([o.statistic for o in found], [3.118, 2.942, 3.179], atol=1e-3)
    np.testing.assert_allclose([o.limit for o in found], [3.158, 3.151, 3.143], atol=2e-3)


def test_two_outliers_that_hide_each_other_are_both_found():
    values = [6.60, 6.61, 6.59, 6.60, 6.62, 6.58, 6.60, 6.61, 6.59, 9.0, 9.1]
    # one at a time, the second widens the spread until the first is within its limit
    z = np.abs(np.array(values) - np.mean(values)) / np.std(values, ddof=1)
    assert float(z.max()) < grubbs_limit(len(values))
    assert sorted(o.index for o in extreme_values(values)) == [9, 10]


def outliers(gains: list[float], positions: list[int]) -> list[tuple[str, str]]:
    told = {"direction": "cw", "range": "full", "intercept_nm": 0.0, "residual_rms_nm": 0.0, "n": 9}
    lines = (
        ExperimentLine(id=str(k), position_rad=float(place), gain_nm_per_v=gain, **told)
        for k, (gain, place) in enumerate(zip(gains, positions, strict=True))
    )
    return [(o.kind, o.experiment) for o in gain_outliers(tuple(lines))]


def test_gains_are_searched_among_those_of_their_own_position():
    # two gains of one position far from the others: no single one of them is an outlier
    assert outliers([6.53, 6.53, 6.51, 6.50, 6.72, 6.72], [0, 0, 1, 1, 2, 2]) == []
    rng = np.random.default_rng(5)
    many = [6.5 + 0.01 * rng.normal() for _ in range(9)]
    assert outliers([*many, 7.5], list(range(10))) == [("gain", "9")]
    pairs = [g + d for g in [*many, 7.5] for d in (-0.001, 0.001)]
    assert outliers(pairs, [k // 2 for k in range(20)]) == [("position", "18, 19")]
    inside = outliers([6.50, 6.51, 6.505, 6.507, 6.9, 6.60, 6.61], [0, 0, 0, 0, 0, 1, 1])
    assert inside == [("gain", "4")]


def entries(levers: list[float], side: float, true: float, noise: float = 0.0, seed: int = 0):
    rng = np.random.default_rng(seed)
    out = []
    for place in range(4):
        base = 0.15 * (1.0 + 0.01 * rng.normal())
        for lever in levers:
            for way, sign in (("cw", 1.0), ("ccw", -1.0)):
                value = base + sign * (0.15 * true + side * lever) + noise * rng.normal()
                out.append(differences.DirectionEntry(place, way, value, lever))
    return out


def test_side_force_and_direction_asymmetry_are_one_group_for_one_arm():
    found = differences.direction_effects(entries([2.0], 1e-4, 2e-3))
    assert not found.separated
    assert found.group == ("side-force", "direction-asymmetry")
    assert found.crosstalk_v_per_n is None


@pytest.mark.parametrize("levers", [[2.0, 0.0], [2.0, 4.0]])
def test_a_couple_or_a_second_arm_tells_them_apart(levers):
    found = differences.direction_effects(entries(levers, 1e-4, 2e-3, noise=1e-6))
    assert found.separated
    assert found.group == ()
    # ten standard uncertainties of this noise are below these tolerances
    assert found.crosstalk_v_per_n.value == pytest.approx(1e-4, abs=1e-5)
    assert found.half_asymmetry.value == pytest.approx(2e-3, abs=2e-4)
    low, high = found.crosstalk_v_per_n.interval(0.999)
    assert low < 1e-4 < high


def test_a_second_arm_in_one_direction_alone_does_not_tell_them_apart():
    both = entries([2.0, 4.0], 1e-4, 2e-3)
    rows = [e for e in both if e.lever_per_m == 2.0 or e.direction == "cw"]
    assert not differences.direction_effects(rows).separated
    only = [e for e in rows if e.direction == "cw"]
    assert "one direction only" in differences.direction_effects(only).reason
