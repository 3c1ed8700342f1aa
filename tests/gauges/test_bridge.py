"""The bridge against a network of resistors and against published numbers."""

import numpy as np
import pytest
from network import bridge_output

from hdbench.gauges.strain import PlacementErrors, bridge_ratio, grid_strain, torque_reading


@pytest.mark.parametrize("rosettes", [2, 4])
def test_the_bridge_equals_a_resistor_network_solved_by_its_nodes(rosettes):
    # strains to 20 %: the nonlinear terms must agree too; 1e-12 is the linear solve's rounding
    rng = np.random.default_rng(3)
    for _ in range(20):
        strain = rng.uniform(-0.1, 0.1, (rosettes, 2))
        expected = bridge_output(strain, 2.0, 10.0)
        assert 10.0 * bridge_ratio(strain, 2.0) == pytest.approx(expected, abs=1e-12)


def test_torsion_alone_gives_the_strain_times_the_gauge_factor_without_nonlinearity():
    # +e and -e in every pair: Vo/Vex = k e exactly, here at 303 microstrain and at 10 %
    for strain in (303e-6, 0.1):
        pair = np.array([[strain, -strain]] * 4)
        assert bridge_ratio(pair, 2.0) == pytest.approx(2.0 * strain, rel=1e-14)


def test_rated_torque_of_the_report_is_0_60606_mv_per_v_and_303_microstrain(report, bench):
    gauged = bench()
    assert 40.0 * gauged.field.torsion_per_nm == pytest.approx(303.03e-6, rel=1e-4)
    errors, beta = PlacementErrors.none(1, 4), np.array([0.0])
    strain = grid_strain(gauged, errors, torque_nm=40.0, wave_angle_rad=beta)
    assert bridge_ratio(strain, 2.0)[0, 0] == pytest.approx(0.60606e-3, rel=1e-4)
    assert torque_reading(strain, report.sensor)[0, 0] == pytest.approx(40.0, rel=1e-3)


def test_an_odd_number_of_rosettes_is_refused():
    with pytest.raises(ValueError, match="even number"):
        bridge_ratio(np.zeros((3, 2)), 2.0)


def test_the_pair_difference_is_the_reports_equation_2(bench):
    gauged = bench()
    beta = np.linspace(0.0, np.pi, 9)
    errors = PlacementErrors.none(1, 4)
    strain = grid_strain(gauged, errors, torque_nm=10.0, wave_angle_rad=beta)
    torsion = gauged.field.torsion_per_nm * 10.0
    first = strain[0, :, 0, 0] - strain[0, :, 0, 1]
    second = strain[0, :, 1, 0] - strain[0, :, 1, 1]
    assert first == pytest.approx(2.0 * torsion + 200e-6 * np.sin(2.0 * beta), abs=1e-15)
    assert second == pytest.approx(2.0 * torsion + 200e-6 * np.sin(2.0 * beta - np.pi), abs=1e-15)
