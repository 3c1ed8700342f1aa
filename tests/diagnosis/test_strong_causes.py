"""Strong causes of another form, limits whose size is their shape, predictions without bounds."""

import numpy as np
import pytest

from hdbench.diagnosis import diagnose_trace
from hdbench.diagnosis.confirm.predicted import held_out_residuals
from hdbench.diagnosis.fit.jointfit import fit_jointly
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.measured.record import prepare_record
from hdbench.diagnosis.noise.whitened import Whitener
from hdbench.model import BenchModel, catalogue
from hdbench.profile import load_profile
from hdbench.records import Trace

PROFILE = load_profile("cim-tr-97-06")
NOISE_NM = 0.05


def loaded_trace(extra=lambda time, speed, load: 0.0, channel=lambda torque: torque):
    """Speed that reverses under a load of both signs."""
    n, seed = 16_000, 1
    rng = np.random.default_rng(seed)
    time = np.arange(n) * 1e-3
    speed = 60.0 * np.sin(2.0 * np.pi * time / 4.0)
    angle = 60.0 * 4.0 / (2.0 * np.pi) * (1.0 - np.cos(2.0 * np.pi * time / 4.0))
    load = 20.0 * np.sin(2.0 * np.pi * time / 9.7)
    accel = 60.0 * 2.0 * np.pi / 4.0 * np.cos(2.0 * np.pi * time / 4.0)
    torque = 0.4 * np.cos(2 * angle) + 0.2 * np.cos(4 * angle) + 1.725e-4 * accel + load
    torque = channel(torque + extra(time, speed, load)) + NOISE_NM * rng.standard_normal(n)
    columns = {
        "time_s": time,
        "motor_velocity_rad_s": speed,
        "motor_angle_rad": angle,
        "load_torque_nm": load,
        "torque_nm": torque,
    }
    return Trace(columns)


def test_a_strong_friction_of_another_form_is_one_cause():
    def friction(time, speed, load):
        return 0.8 * 2.0 / np.pi * np.arctan(speed / 1.3)

    found = diagnose_trace(loaded_trace(friction), PROFILE)
    assert [cause.name for cause in found.causes] == ["coulomb-friction"]
    assert found.unexplained == ()
    # what its form leaves is taken up too: the noise is all that stays
    assert found.extended["heldout_rms_nm"] == pytest.approx(NOISE_NM, rel=0.05)


def test_a_limit_is_told_by_its_own_size():
    trace = loaded_trace(channel=lambda torque: 40.0 * np.tanh(torque / 40.0))
    found = diagnose_trace(trace, PROFILE)
    (cause,) = found.causes
    assert cause.name == "saturation"
    limit = cause.parameters["limit_nm"]
    assert abs(limit["value"] - 40.0) < 4.0 * limit["std"] + 0.5


def test_a_prediction_stays_bounded_where_one_fold_alone_shows_an_effect():
    trace = loaded_trace()
    record = prepare_record(
        trace, PROFILE.data, BenchModel.from_profile(PROFILE.data), np.zeros(16_000, dtype=bool)
    )
    # only the last of the twenty blocks shows it
    step = Term(catalogue()["zero-step"], {"step_time_s": 15.2})
    white = Whitener(np.ones(1), NOISE_NM, record.valid, record.valid)
    fit = fit_jointly(record, (step,), white, refine=False)
    with_it, without = held_out_residuals(record, fit, white, [None, 0])
    assert with_it.rms_nm <= 1.01 * without.rms_nm
