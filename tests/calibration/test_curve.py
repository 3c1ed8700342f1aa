"""Shape of the curve: published regressions, lack of fit, a published torque arm."""

from __future__ import annotations

import csv
import json
import math
import os
from pathlib import Path

import numpy as np
import pytest

from hdbench.calibration import evaluate_calibration
from hdbench.calibration.curve import (
    lack_of_fit,
    loading_loop,
    series_lack_of_fit,
    terminal_line,
)
from hdbench.records import LoadReading, Loads

DATA = os.environ.get("HDBENCH_DATA")
needs_data = pytest.mark.skipif(DATA is None, reason="HDBENCH_DATA is not set")

# NIST StRD, data set Pontius: deflection of a load cell under 40 loads, two runs (public domain)
PONTIUS_Y = [
    0.11019, 0.21956, 0.32949, 0.43899, 0.54803, 0.65694, 0.76562, 0.87487, 0.98292, 1.09146,
    1.20001, 1.30822, 1.41599, 1.52399, 1.63194, 1.73947, 1.84646, 1.95392, 2.06128, 2.16844,
    0.11052, 0.22018, 0.32939, 0.43886, 0.54798, 0.65739, 0.76596, 0.87474, 0.98300, 1.09150,
    1.20004, 1.30818, 1.41613, 1.52408, 1.63159, 1.73965, 1.84696, 1.95445, 2.06177, 2.16829,
]  # fmt: skip
PONTIUS_X = [150000.0 * k for k in range(1, 21)] * 2
# Montgomery and Runger, Applied Statistics and Probability for Engineers, supplement, ex. S11-1
MONTGOMERY = {
    1.0: [2.3, 1.8],
    2.0: [2.8],
    3.3: [1.8, 3.7],
    4.0: [2.6, 2.6, 2.2],
    5.0: [2.0],
    5.6: [3.5, 2.8, 2.1],
    6.0: [3.4, 3.2],
    6.5: [3.4],
    6.9: [5.0],
}
# Kessel, Kacker, Sommer, Measurement 45 (2012) 1661, table 4: pressure and indication
KESSEL_Y = [0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.0]
KESSEL_X = [0.0, 0.2039, 0.4080, 0.6120, 0.8160, 1.0201, 1.2242, 1.4283, 1.6325, 1.8367, 2.0410]
# four series of a published synthetic calibration, zero-reduced, loading, V
UP = np.array(
    [
        [1.207, 2.419, 3.630, 4.844, 6.060],
        [1.213, 2.422, 3.637, 4.850, 6.065],
        [1.197, 2.396, 3.596, 4.801, 6.004],
        [1.220, 2.436, 3.657, 4.878, 6.103],
    ]
)
STEPS = np.array([8.0, 16.0, 24.0, 32.0, 40.0])


def test_the_quadratic_of_the_load_cell_is_the_certified_one() -> None:
    found = lack_of_fit(np.array(PONTIUS_X), np.array(PONTIUS_Y), 2)
    # certified to fifteen digits; ten are what double precision promises here
    np.testing.assert_allclose(
        found.fit.coefficients,
        [0.673565789473684e-03, 0.732059160401003e-06, -0.316081871345029e-14],
        rtol=1e-10,
    )
    np.testing.assert_allclose(
        np.sqrt(np.diag(found.fit.covariance)),
        [0.107938612033077e-03, 0.157817399981659e-09, 0.486652849992036e-16],
        rtol=1e-9,
    )
    assert found.residual_std == pytest.approx(0.205177424076185e-03, rel=1e-9)
    # e-Handbook section 4.6.1.7: 0.8107
    assert found.ratio == pytest.approx(0.811, abs=5e-4)


def test_the_straight_line_of_the_load_cell_does_not_fit() -> None:
    found = lack_of_fit(np.array(PONTIUS_X), np.array(PONTIUS_Y), 1)
    np.testing.assert_allclose(found.fit.coefficients, [6.14969e-3, 7.22103e-7], rtol=1e-5)
    assert found.residual_std == pytest.approx(0.0021712726, rel=1e-7)
    # e-Handbook section 4.6.1.4 prints 214.7464, from sums rounded to its digits
    assert found.ratio == pytest.approx(214.7464, rel=5e-6)
    assert (found.lack_dof, found.pure_dof) == (18, 20)


def test_lack_of_fit_of_the_textbook_is_reproduced() -> None:
    x = np.array([at for at, ys in MONTGOMERY.items() for _ in ys])
    y = np.array([value for ys in MONTGOMERY.values() for value in ys])
    found = lack_of_fit(x, y, 1)
    assert found.fit.coefficients[0] == pytest.approx(1.697, abs=5e-4)
    assert found.fit.coefficients[1] == pytest.approx(0.259, abs=5e-4)
    total = float(found.fit.residual @ found.fit.residual)
    assert total == pytest.approx(7.3372, abs=5e-5)
    assert found.pure_error == pytest.approx(3.0367, abs=5e-5)
    assert found.ratio == pytest.approx(1.42, abs=5e-3)
    # the book prints 0.3276, which is that of the rounded 1.42
    assert found.probability == pytest.approx(0.33, abs=5e-3)


def test_regressions_agree_with_statsmodels() -> None:
    import statsmodels.api as sm

    x, y = np.array(PONTIUS_X) / 3e6, np.array(PONTIUS_Y)
    theirs = sm.OLS(y, np.column_stack([np.ones(40), x, x**2])).fit()
    found = lack_of_fit(x, y, 2)
    np.testing.assert_allclose(found.fit.coefficients, theirs.params, rtol=1e-9)
    np.testing.assert_allclose(np.sqrt(np.diag(found.fit.covariance)), theirs.bse, rtol=1e-8)


def test_the_line_through_the_ends_of_a_sensor_is_that_of_gtc() -> None:
    from GTC import get_correlation, type_b, uncertainty, ureal, value

    resolution = type_b.uniform(0.00005)
    ours = terminal_line(
        np.array(KESSEL_X), np.array(KESSEL_Y), std_x=resolution, relative_std_y=0.000115
    )
    x0, x1 = (x - ureal(0.0, resolution) for x in (KESSEL_X[0], KESSEL_X[-1]))
    y0, y1 = (ureal(y, y * 0.000115) for y in (KESSEL_Y[0], KESSEL_Y[-1]))
    slope = (y1 - y0) / (x1 - x0)
    intercept = y1 - slope * x1
    assert ours.slope == pytest.approx(value(slope), rel=1e-14)
    assert ours.slope_std == pytest.approx(uncertainty(slope), rel=1e-12)
    assert ours.intercept_std == pytest.approx(uncertainty(intercept), rel=1e-12)
    assert ours.correlation == pytest.approx(get_correlation(intercept, slope), rel=1e-9)
    # as published
    assert ours.slope == pytest.approx(9.799118079372857, rel=1e-15)
    assert ours.slope_std == pytest.approx(0.00114381754747, abs=5e-15)
    assert ours.intercept_std == pytest.approx(2.828762e-4, abs=5e-11)
    assert ours.correlation == pytest.approx(-0.1211704, abs=5e-8)
    assert float(np.max(np.abs(ours.deviation))) == pytest.approx(0.0039, abs=5e-5)


def test_curvature_hidden_by_scatter_of_gains_is_found_with_a_slope_for_each_series() -> None:
    found = series_lack_of_fit(STEPS, UP)
    assert found is not None
    # half a unit of the last printed digit; the fourth is -0.2955, printed as -0.29
    np.testing.assert_allclose(1e3 * found.curve_v, [-1.64, -3.52, -2.66, -0.29, 3.57], atol=6e-3)
    assert found.lack == pytest.approx(1.39909e-4, abs=5e-10)
    assert found.pure_error == pytest.approx(2.78e-5, abs=5e-8)
    assert found.ratio == pytest.approx(15.10, abs=5e-3)
    assert found.probability == pytest.approx(1.25e-4, abs=5e-7)
    assert found.pooled_ratio == pytest.approx(0.047, abs=5e-4)
    # 3.6 mV of 6.06 V: significant, and 0.06 %
    assert found.relative == pytest.approx(0.0006, abs=5e-5)


def test_the_loop_of_the_worked_series_has_the_printed_area_and_width() -> None:
    torque = np.array([0.0, 8.0, 16.0, 24.0, 32.0, 40.0])
    up = np.array([0.013, 1.220, 2.432, 3.643, 4.857, 6.073])
    down = np.array([0.016, 1.241, 2.460, 3.671, 4.876, 6.073])
    found = loading_loop((torque, up), (torque[::-1], down[::-1]), 40.0 / 6.060, 0.2)
    assert found is not None
    assert found.area_v_nm == pytest.approx(0.7800, abs=5e-5)
    assert 100.0 * found.area_relative == pytest.approx(0.3218, abs=5e-5)
    # 28 mV wide, 0.462 % of full scale
    assert found.largest_nm == pytest.approx(0.028 * 40.0 / 6.060, rel=1e-9)
    assert 100.0 * found.relative == pytest.approx(0.462, abs=5e-4)


def test_a_lens_and_a_constant_width_are_told_apart() -> None:
    torque = np.linspace(0.0, 40.0, 9)
    share = torque / 40.0
    up = torque / 6.6
    width = np.where(torque > 0.0, 0.3 + 0.8 * 4.0 * share * (1.0 - share), 0.0)
    found = loading_loop((torque, up), (torque, up + width / 6.6), 6.6, 0.2)
    assert found is not None
    assert found.constant_nm == pytest.approx(0.3, rel=1e-9)
    assert found.lens_nm == pytest.approx(0.8, rel=1e-9)


def test_branches_without_a_common_torque_have_no_loop() -> None:
    assert loading_loop((STEPS, STEPS), (STEPS + 100.0, STEPS), 6.6, 0.1) is None
    assert loading_loop((STEPS, STEPS), (STEPS[:0], STEPS[:0]), 6.6, 0.1) is None


@needs_data
def test_the_torque_arm_has_its_hysteresis_and_zero_return() -> None:
    readings = []
    for file, series in (("ascending", "up"), ("descending", "down")):
        path = Path(str(DATA)) / "unh_torque_arm_cal" / f"torque_arm_{file}.csv"
        with path.open(newline="") as lines:
            for row in csv.DictReader(lines):
                volts, torque = float(row["mean_volts_per_volt"]), float(row["mean_torque"])
                readings.append(LoadReading("arm", 0.0, "full", "cw", series, torque, volts))
    result = evaluate_calibration(Loads(tuple(readings)), max_consistency=0.05)
    body = json.loads(json.dumps(result.to_dict({}), allow_nan=False))
    loop = body["hysteresis"]["arm"]
    # largest down less up at equal torque, over 360 N m: 0.93 %; zero return 0.09 N m
    assert 100.0 * loop["largest_nm"] / 360.0 == pytest.approx(0.93, abs=5e-3)
    assert 100.0 * loop["relative"] == pytest.approx(0.93, abs=5e-3)
    assert loop["zero_return_nm"] == pytest.approx(0.09, abs=5e-3)
    # nine steps above zero, though the reference read another torque on the way down
    assert len(body["steps"]) == 9
    assert all(math.isfinite(step["reversibility_v"]) for step in body["steps"])
    assert body["accepted"] is None
