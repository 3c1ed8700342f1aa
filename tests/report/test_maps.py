"""The report draws where the residual sits, for runs in motion and for calibration loads."""

import numpy as np
from bench_runs import table

from hdbench.report.diagnosis.figures import folder_pictures


def test_every_map_of_a_run_is_one_row_of_one_figure_and_codes_are_their_own(tmp_path):
    x = np.linspace(-100.0, 100.0, 48)
    curves = ("measured_nm", "simulated_nm", "extended_nm")
    curves += ("residual_before_nm", "residual_after_nm")
    table(tmp_path / "residual.csv", time_s=x + 100.0, **dict.fromkeys(curves, 0 * x))
    assert len(folder_pictures(tmp_path, "run-1")) == 2
    level = {"before_nm": 0.003 * x, "before_std_nm": 0.01 + 0 * x}
    level |= {"after_nm": 0 * x, "after_std_nm": 0.01 + 0 * x}
    table(tmp_path / "map_velocity.csv", motor_velocity_rad_s=x, samples=100 + 0 * x, **level)
    table(tmp_path / "map_time.csv", time_s=x + 100.0, samples=100 + 0 * x, **level)
    codes = np.arange(32.0)
    samples = np.where(codes % 2 == 0, 200.0, 0.0)
    table(tmp_path / "map_code.csv", code_modulo_32=codes, samples=samples, share=samples / 3200.0)
    *_, maps, histogram = folder_pictures(tmp_path, "run-1")
    assert "motor velocity (rad/s)" in maps.svg
    assert "time (s)" in maps.svg
    # the largest residual of the table is 0.3 N m
    assert "0.3 newton metres over motor velocity" in maps.svg
    assert "16 of 32 never came" in histogram.caption


def test_readings_of_a_calibration_are_drawn_with_their_rms_before_and_after(tmp_path):
    torque = np.array([0.0, 10.0, 20.0, 10.0, 0.0])
    before = np.array([0.0, -0.2, 0.0, 0.2, 0.0])
    residual = {"residual_before_nm": before, "residual_after_nm": 0.1 * before}
    flags = {"falling": np.array([0, 0, 0, 1, 1]), "used": np.array([1, 1, 1, 1, 0])}
    table(tmp_path / "residual.csv", torque_nm=torque, **flags, **residual)
    (picture,) = folder_pictures(tmp_path, "run-1")
    # root mean square of 0, -0.2, 0, 0.2: 0.141
    assert "0.141 N·m rms" in picture.caption
    assert "0.0141 N·m rms" in picture.caption
    assert "Crosses: not used" in picture.caption
