"""The mean error of coarse readings against rounding by hand; what it must not be called."""

import numpy as np
import pytest

from hdbench.diagnosis import diagnose_trace
from hdbench.diagnosis.measured.record import prepare_record
from hdbench.diagnosis.noise.rounding import coarse_rounding, mean_rounding, steps_of
from hdbench.model import BenchModel
from hdbench.profile import load_profile
from hdbench.records import Trace

PROFILE = load_profile("cim-tr-97-06")


def rounded_trace(step_nm, noise_nm, zero_step_nm=0.0):
    """A speed that swells and falls, its torque read in steps; the zero may move half way."""
    n, rng = 16_000, np.random.default_rng(5)
    time = np.arange(n) * 1e-3
    rate = 2.0 * np.pi / 8.0
    speed, angle = 90.0 + 40.0 * np.sin(rate * time), 90.0 * time
    angle = angle + 40.0 / rate * (1.0 - np.cos(rate * time))
    torque = 0.8 * np.cos(2 * angle) + 0.4 * np.cos(4 * angle) + 0.9 * np.cos(angle / 100)
    torque += 1.725e-4 * 40.0 * rate * np.cos(rate * time) + noise_nm * rng.standard_normal(n)
    torque[n // 2 :] += zero_step_nm
    columns = {
        "time_s": time,
        "motor_velocity_rad_s": speed,
        "motor_angle_rad": angle,
        "torque_nm": step_nm * np.round(torque / step_nm),
    }
    return Trace(columns)


def prepared(trace):
    model = BenchModel.from_profile(PROFILE.data)
    return prepare_record(trace, PROFILE.data, model, np.zeros(len(trace.time_s), dtype=bool))


@pytest.mark.parametrize("noise", [0.05, 0.2, 0.4])
def test_mean_error_is_that_of_rounded_readings(noise):
    rng = np.random.default_rng(2)
    torque = np.linspace(-0.3, 0.3, 13)
    step, level = 0.25, 0.05
    read = torque[:, None] + noise * step * rng.standard_normal((13, 40_000))
    mean = np.mean(level + step * np.round((read - level) / step), axis=1) - torque
    # 40 000 readings, each within half a step of noise and rounding: five standard deviations
    bound = 5.0 * step * np.hypot(noise, 0.3) / 200.0
    # the saw tooth ends after 29 harmonics: where the noise leaves it steep that shows at its jump
    np.testing.assert_allclose(
        mean_rounding(torque, level, step, noise * step), mean, atol=bound + 1e-4
    )


def test_fine_steps_are_left_alone():
    record = prepared(rounded_trace(0.05, 0.05))
    fitted = record.response_nm - 0.05 * np.random.default_rng(1).standard_normal(16_000)
    assert coarse_rounding(record, fitted, steps_of(record)) is None


@pytest.mark.parametrize("moved_nm", [0.4, 3.0])
def test_a_step_of_the_zero_beside_coarse_readings_is_all_that_is_found(moved_nm):
    found = diagnose_trace(rounded_trace(0.5, 0.05, moved_nm), PROFILE, materiality=0.0)
    # beside 3 N m a rounding of 0.14 N m rms is nothing to tell, and still no line of its own
    step = found.causes[-1]
    assert {cause.name for cause in found.causes} - {"quantisation"} == {"zero-step"}
    assert found.unexplained == ()
    size = step.parameters["step_nm"]
    assert size["value"] == pytest.approx(moved_nm, abs=4.0 * size["std"])


def test_coarse_readings_make_no_lines():
    found = diagnose_trace(rounded_trace(0.5, 0.05), PROFILE)
    assert [cause.name for cause in found.causes] == ["quantisation"]
    assert found.unexplained == ()
