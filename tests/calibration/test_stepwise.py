"""Step by step in the manner of EURAMET cg-14: a published example to its last printed digit."""

import math
from dataclasses import replace
from functools import reduce
from operator import getitem

import numpy as np
import pytest
from worked_example import SERIES, worked_loads

from hdbench.calibration import evaluate_calibration
from hdbench.calibration.lever import TorqueAccount
from hdbench.calibration.readings import taken_readings
from hdbench.calibration.stepwise.evaluation import CLASSES, class_limit, classify, evaluate_group
from hdbench.calibration.stepwise.series import step_groups
from hdbench.records import LoadReading, Loads

# relative standard uncertainty of the applied torque in the example: 0.013 %
ACCOUNT = TorqueAccount("given", None, (), 9.81, "given", ((40.0, 0.013e-2),))


def evaluated(loads: Loads, resolution_v: float | None = 0.001):
    (group,) = step_groups(taken_readings(loads), "single")
    return evaluate_group(group, ACCOUNT, resolution_v)


@pytest.fixture(scope="module")
def example():
    return evaluated(worked_loads())


def column(example, *keys):
    return [reduce(getitem, keys, step.to_json()) for step in example[1]]


# every row of the published table, with half a unit of its last printed digit
TABLE = [
    (("deflection_v",), 1.0, 5e-7, [1.208000, 2.417000, 3.627667, 4.841000, 6.055667]),
    (("repeatability_v",), 1.0, 5e-7, [0.006, 0.003, 0.007, 0.006, 0.005]),
    (("repeatability_relative",), 100.0, 5e-5, [0.4967, 0.1241, 0.1930, 0.1239, 0.0826]),
    (("reproducibility_v",), 1.0, 5e-7, [0.011533, 0.020075, 0.030567, 0.038588, 0.049642]),
    (("reproducibility_relative",), 100.0, 5e-5, [0.9547, 0.8306, 0.8426, 0.7971, 0.8198]),
    (("range_relative",), 100.0, 5e-4, [1.904, 1.655, 1.682, 1.591, 1.635]),
    (("reversibility_v",), 1.0, 5e-6, [0.02050, 0.02825, 0.02725, 0.01825, 0.0]),
    (("reversibility_relative",), 100.0, 5e-5, [1.6970, 1.1688, 0.7512, 0.3770, 0.0]),
    (("deviation_linear_relative",), 100.0, 5e-5, [-0.1917, -0.1502, -0.0904, -0.0054, 0.0676]),
    (("deviation_cubic_relative",), 100.0, 5e-5, [0.0140, -0.0018, -0.0069, 0.0056, -0.0014]),
    (("deflection_up_down_v",), 1.0, 5e-7, [1.218333, 2.431167, 3.641333, 4.850167, 6.055667]),
    (("deviation_up_down_relative",), 100.0, 5e-5, [0.4845, 0.2594, 0.1110, 0.0092, -0.1071]),
    (("increasing", "expanded_relative_k2"), 100.0, 5e-5, [1.1420, 0.9634, 0.9807, 0.9245, 0.9490]),
]
# of loading and unloading together
BOTH = "increasing_decreasing"
EXPANDED = {
    "expanded_relative_k2": (100.0, [1.4919, 1.1694, 1.0683, 0.9480, 0.9490]),
    "expanded_relative_k2_with_deviation": (100.0, [1.9765, 1.4288, 1.1793, 0.9572, 1.0561]),
    "expanded_nm_k2": (1.0, [0.1581, 0.2286, 0.2830, 0.3063, 0.4224]),
}
TABLE += [((BOTH, key), scale, 5e-5, row) for key, (scale, row) in EXPANDED.items()]
# and every part of the uncertainty
PARTS = {
    "resolution": [0.0338, 0.0169, 0.0113, 0.0084, 0.0067],
    "repeatability": [0.1434, 0.0358, 0.0557, 0.0358, 0.0238],
    "reproducibility": [0.5512, 0.4795, 0.4865, 0.4602, 0.4733],
    "zero": [0.0191] * 5,
    "fit": [0.0029, 0.0004, 0.0014, 0.0012, 0.0003],
}
REVERSIBILITY = [0.4857, 0.3354, 0.2160, 0.1086, 0.0]
TABLE += [(("increasing", "parts", name), 100.0, 5e-5, row) for name, row in PARTS.items()]
TABLE += [((BOTH, "parts", "reversibility"), 100.0, 5e-5, REVERSIBILITY)]


@pytest.mark.parametrize(("keys", "scale", "digit", "printed"), TABLE)
def test_every_printed_figure_of_the_worked_example_is_reproduced(
    example, keys, scale, digit, printed
):
    # a hair above half a unit: two printed figures end in an exact five
    np.testing.assert_allclose(
        scale * np.array(column(example, *keys)), printed, rtol=0.0, atol=1.01 * digit
    )


def test_lines_zero_and_sensitivities_of_the_worked_example_are_reproduced(example):
    group = example[0].to_json()
    assert group["zero_v"] == pytest.approx(0.004, abs=1e-12)
    assert 100.0 * group["zero_relative"] == pytest.approx(0.0661, abs=5e-5)
    assert group["sensitivity_v_per_nm"] == pytest.approx(0.1513917, abs=5e-8)
    assert group["gain_nm_per_v"] == pytest.approx(6.60538, abs=5e-6)
    assert group["linear_v_per_nm"] == pytest.approx(0.15128939, abs=5e-9)
    assert group["gain_up_nm_per_v"] == pytest.approx(6.60985, abs=5e-6)
    assert group["linear_up_down_v_per_nm"] == pytest.approx(0.15155379, abs=5e-9)
    assert group["gain_up_down_nm_per_v"] == pytest.approx(6.59832, abs=5e-6)
    assert group["cubic_v"][0] == pytest.approx(0.150904, abs=5e-7)


def test_the_coverage_factor_of_three_positions_is_far_from_two(example):
    dof = column(example, "increasing", "dof")
    factors = column(example, "increasing", "coverage_factor")
    # printed: nu_eff 2.3 to 2.0, k 3.8 to 4.3; W at 40 N m is 2.02 %, not 0.95 %
    assert (max(dof), min(dof)) == pytest.approx((2.3, 2.0), abs=0.05)
    assert (min(factors), max(factors)) == pytest.approx((3.8, 4.3), abs=0.05)
    last = column(example, "increasing", "expanded_relative")[-1]
    assert 100.0 * last == pytest.approx(2.02, abs=5e-3)


def test_classes_of_the_worked_example_are_those_printed(example):
    second = {c.name: c.allowed for c in example[0].class_increasing_decreasing.criteria}
    assert second["repeatability"] == second["reproducibility"] == second["fit"] == 1.0
    assert (second["zero"], second["reversibility"]) == (0.5, 2.0)
    assert example[0].class_increasing_decreasing.value == 2.0
    assert "set by reversibility" in example[0].class_increasing_decreasing.reason
    first = {c.name: c.allowed for c in example[0].class_increasing.criteria}
    assert first["fit"] == 0.05
    assert example[0].class_increasing.value == 1.0


@pytest.mark.parametrize(
    ("criterion", "limits"),
    [
        ("repeatability", [0.025, 0.05, 0.10, 0.25, 0.50, 1.0, 2.5]),
        ("reproducibility", [0.05, 0.10, 0.20, 0.50, 1.0, 2.0, 5.0]),
        ("zero", [0.0125, 0.025, 0.050, 0.125, 0.25, 0.50, 1.25]),
        ("fit", [0.025, 0.05, 0.10, 0.25, 0.50, 1.0, 2.5]),
        ("reversibility", [0.063, 0.125, 0.25, 0.63, 1.25, 2.5, 6.25]),
        ("torque", [0.010, 0.020, 0.040, 0.10, 0.20, 0.40, 1.0]),
    ],
)
def test_class_limits_are_those_of_the_published_table(criterion, limits):
    found = [100.0 * class_limit(criterion, grade) for grade in CLASSES]
    np.testing.assert_allclose(found, limits, rtol=1e-12)


def test_a_value_on_a_limit_is_within_it_and_a_worse_one_is_in_no_class():
    on = classify({"reproducibility": 0.02}, ("reproducibility",))
    assert on.value == 2.0
    for worse in (0.0501, None, math.nan):
        assert classify({"reproducibility": worse}, ("reproducibility",)).value is None


READINGS = worked_loads().readings

OTHER_WORDS = {
    "the other direction": worked_loads("ccw").readings,
    "another order": [r for name in "4123" for r in READINGS if r.experiment == name],
    # the last reading of loading is the first of unloading
    "40 N m once": [r for r in READINGS if (r.series, r.torque_nm) != ("down", 40.0)],
}


@pytest.mark.parametrize("readings", OTHER_WORDS.values(), ids=OTHER_WORDS)
def test_the_same_readings_in_other_words_give_the_same_steps(example, readings):
    found = evaluated(Loads(tuple(readings)))
    for keys, *_ in TABLE:
        np.testing.assert_allclose(column(found, *keys), column(example, *keys), atol=1e-12)
    assert found[0].gain_nm_per_v == pytest.approx(example[0].gain_nm_per_v)
    assert found[0].class_increasing_decreasing.value == 2.0


def test_the_uncertainty_of_the_torque_is_not_divided_by_the_number_of_positions():
    wide = TorqueAccount("given", None, (), 9.81, "given", ((40.0, 0.05),))
    for names in (("1", "3"), ("1", "3", "4")):
        rows = tuple(r for r in READINGS if r.experiment in names)
        (group,) = step_groups(taken_readings(Loads(rows)), "single")
        found = evaluate_group(group, wide, None)
        assert column(found, "increasing", "parts", "torque") == [0.05] * 5
        assert min(column(found, "increasing", "relative_std")) >= 0.05


def test_a_repeated_series_is_told_by_its_column_and_by_its_place(example):
    told = tuple("1" if r.experiment == "2" else "0" for r in READINGS)
    found = evaluated(Loads(READINGS, extra_columns={"repeat": told}))
    assert column(found, "repeatability_v") == column(example, "repeatability_v")
    apart = tuple(map(str, range(len(READINGS))))
    mounted = Loads(READINGS, extra_columns={"mounting": apart})
    # every series in a mounting of its own: nothing was repeated
    assert column(evaluated(mounted), "repeatability_v") == [None] * 5


def test_one_series_without_zero_is_evaluated_and_says_what_it_lacks():
    rows = [LoadReading("a", 0.0, "full", "cw", "up", t, 0.15 * t + 0.01) for t in (8, 16, 24)]
    body = evaluate_calibration(Loads(tuple(rows)), max_consistency=0.05).to_json()
    assert body["class"] is None
    assert "no data for reproducibility" in body["class_reason"]
    assert body["groups"][0]["zero_by_line"] == ["a"]
    # the line's own intercept stands for the zero: deflection is 0.15 V per N m
    np.testing.assert_allclose([s["deflection_v"] for s in body["steps"]], [1.2, 2.4, 3.6])
    assert body["steps"][0]["increasing_decreasing"] is None


def test_a_preload_is_kept_and_not_evaluated():
    preload = replace(READINGS[5], reading_v=9.9)
    kinds = ("preload", *([""] * len(READINGS)))
    with_it = Loads((preload, *READINGS), extra_columns={"kind": kinds})
    a, b = (evaluate_calibration(x, max_consistency=0.05) for x in (worked_loads(), with_it))
    assert b.gain_nm_per_v == a.gain_nm_per_v
    assert b.to_json()["course"]["n_preloads"] == 1


def test_the_volts_of_the_example_are_read_to_a_millivolt():
    assert all(round(v, 3) == v for _, volts in SERIES.values() for v in volts)
    result = evaluate_calibration(worked_loads(), max_consistency=0.05)
    assert result.groups[0].resolution_v == pytest.approx(0.001)
