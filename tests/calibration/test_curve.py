"""Shape of the curve: published regressions, lack of fit, a published torque arm."""

import json
import math

import numpy as np
import pytest
from publicdata import needs_data
from worked_example import SERIES, TORQUES, torque_arm

from hdbench.calibration import evaluate_calibration
from hdbench.calibration.lines import loading_loop, series_lack_of_fit

# series of the worked example, zero-reduced, loading, V
UP = np.array([np.subtract(volts[1:6], volts[0]) for _, volts in SERIES.values()])
STEPS = np.array(TORQUES[1:6])


def test_curvature_hidden_by_scatter_of_gains_is_found_with_a_slope_for_each_series():
    found = series_lack_of_fit(STEPS, UP)
    # half a unit of the last printed digit; the fourth is -0.2955, printed as -0.29
    np.testing.assert_allclose(
        1e3 * np.array(found.curve_v), [-1.64, -3.52, -2.66, -0.29, 3.57], atol=6e-3
    )
    assert found.dof == (4, 12)
    assert found.f_ratio == pytest.approx(15.10, abs=5e-3)
    assert found.probability == pytest.approx(1.25e-4, abs=5e-7)
    assert found.pooled_f_ratio == pytest.approx(0.047, abs=5e-4)
    # 3.6 mV of 6.06 V: significant, and 0.06 %
    assert found.relative == pytest.approx(0.0006, abs=5e-5)


def test_the_loop_of_the_worked_series_has_the_printed_area_and_width():
    torque, volts = np.array(TORQUES), np.array(SERIES["1"][1])
    branches = (torque[:6], volts[:6]), (torque[5:], volts[5:])
    found = loading_loop(*branches, 40.0 / 6.060, 0.2)
    assert found.area_v_nm == pytest.approx(0.7800, abs=5e-5)
    assert 100.0 * found.area_relative == pytest.approx(0.3218, abs=5e-5)
    # 28 mV wide, 0.462 % of full scale
    assert found.largest_nm == pytest.approx(0.028 * 40.0 / 6.060, rel=1e-9)
    assert 100.0 * found.relative == pytest.approx(0.462, abs=5e-4)


def test_a_lens_and_a_constant_width_are_told_apart():
    torque = np.linspace(0.0, 40.0, 9)
    share = torque / 40.0
    up = torque / 6.6
    width = np.where(torque > 0.0, 0.3 + 0.8 * 4.0 * share * (1.0 - share), 0.0)
    found = loading_loop((torque, up), (torque, up + width / 6.6), 6.6, 0.2)
    assert (found.constant_nm, found.lens_nm) == pytest.approx((0.3, 0.8), rel=1e-9)


def test_branches_without_a_common_torque_have_no_loop():
    assert loading_loop((STEPS, STEPS), (STEPS + 100.0, STEPS), 6.6, 0.1) is None
    assert loading_loop((STEPS, STEPS), (STEPS[:0], STEPS[:0]), 6.6, 0.1) is None


@needs_data
def test_the_torque_arm_has_its_hysteresis_and_zero_return():
    result = evaluate_calibration(torque_arm("ascending", "descending"), max_consistency=0.05)
    body = json.loads(json.dumps(result.to_json(), allow_nan=False))
    loop = body["hysteresis"]["arm"]
    # largest down less up at equal torque, over 360 N m: 0.93 %; zero return 0.09 N m
    assert 100.0 * loop["largest_nm"] / 360.0 == pytest.approx(0.93, abs=5e-3)
    assert 100.0 * loop["relative"] == pytest.approx(0.93, abs=5e-3)
    assert loop["zero_return_nm"] == pytest.approx(0.09, abs=5e-3)
    # nine steps above zero, though the reference read another torque on the way down
    assert len(body["steps"]) == 9
    assert all(math.isfinite(step["reversibility_v"]) for step in body["steps"])
    assert body["accepted"] is None
