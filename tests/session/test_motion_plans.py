"""A plan file becomes one run: one program between load steps, loads asked for and recorded."""

from pathlib import Path

import numpy as np
import pytest
from fakes import WHOLE, FakeBench, FakeOperator, opened, quiet, task_in

from hdbench.diagnosis.planning.blocks import full_protocol
from hdbench.diagnosis.planning.segments import LoadStep, MotionPlan, Segment
from hdbench.errors import UsageError
from hdbench.profile.waves import ReferenceProgram, program_voltage
from hdbench.records.counted import survey_samples
from hdbench.records.tracefile import read_trace
from hdbench.session import BenchOptions, run_experiment
from hdbench.session.plans import Acquire, Lock, Place, Put, check_plan, motion_plan
from hdbench.session.runner import Runner
from hdbench.session.stop import Aborted

PROFILE = WHOLE.data
FREE = (Segment("ramp", 0.1, 50.0), Segment("hold", 0.2, 50.0), Segment("ramp", 0.1, 0.0))
LOADED = MotionPlan(
    "loaded",
    (
        *FREE,
        LoadStep("hang 2 kg cw", 9.8),
        *FREE,
        LoadStep("lock at 90 degrees, 1 kg ccw", -4.9, locked=True, position_rad=1.571),
        Segment("rest", 0.1),
        LoadStep("take all off", 0.0),
    ),
)


def test_motion_without_loads_is_one_program_in_one_acquisition():
    asked = full_protocol(PROFILE, loads=False)
    plan = motion_plan("ripple", asked, PROFILE)
    lock, acquire = plan.steps
    assert lock == Lock(locked=False)
    assert isinstance(acquire, Acquire)
    assert isinstance(acquire.wave, ReferenceProgram)
    assert acquire.n_samples == round(asked.duration_s / 0.001)
    speed = program_voltage(acquire.wave, 0.001) * PROFILE.servo.velocity_gain_rad_s_per_v
    assert np.abs(speed).max() == pytest.approx(380.0, rel=1e-3)
    # a reference without jumps: the steepest of it is a quarter of the servo's acceleration
    assert np.abs(np.diff(speed)).max() <= 0.26 * PROFILE.servo.max_acceleration_rad_s2 * 0.001
    check_plan(plan, PROFILE)
    assert plan.to_dict()["motion"]["schema"] == "hdbench/plan/1"


def test_a_plan_beyond_the_limits_is_refused_with_every_problem():
    asked = MotionPlan("fast", (Segment("ramp", 0.1, 500.0), Segment("ramp", 0.1, 0.0)))
    with pytest.raises(UsageError) as error:
        motion_plan("ripple", asked, PROFILE)
    what = " ".join(problem.what for problem in error.value.problems)
    assert "motor speed 500 rad/s is above 400" in what
    assert "reference 8.88786 V is above 8 V" in what
    assert "acceleration 5000 rad/s^2 is above 2500" in what


def test_loads_stand_between_acquisitions_with_lock_and_place():
    steps = motion_plan("ripple", LOADED, PROFILE).steps
    kinds = [type(step) for step in steps]
    assert kinds == [Lock, Acquire, Put, Acquire, Lock, Place, Put, Acquire, Lock, Put]
    assert [step.direction for step in steps if isinstance(step, Put)] == ["cw", "ccw", "cw"]
    # 9.8 N m over 0.5 m and 9.8065 m/s^2
    assert steps[2].mass_kg == pytest.approx(9.8 / (0.5 * 9.8065), rel=1e-12)
    assert steps[7].wave is None


def runner_of(tmp_path: Path, bench: FakeBench, operator: FakeOperator) -> Runner:
    task = task_in(tmp_path, motion_plan("ripple", LOADED, PROFILE))
    return Runner(task, bench, operator, opened(tmp_path)[0], person=False)


def test_the_trace_of_a_plan_with_loads_says_what_hung_when(tmp_path):
    bench = FakeBench()
    operator = FakeOperator(bench)
    runner_of(tmp_path, bench, operator).run()
    trace = survey_samples(tmp_path / "journal.hdj").trace("here")
    assert operator.asked == [
        "release", "motion", "hang", "motion", "lock", "position", "hang", "motion", "release",
        "hang",
    ]  # fmt: skip
    assert len(trace) == 400 + 400 + 100
    assert np.all(np.diff(trace.time_s) > 0.0)
    pauses = np.flatnonzero(np.diff(trace.time_s) > 0.0015) + 1
    np.testing.assert_array_equal(pauses, [400, 800])
    np.testing.assert_array_equal(np.flatnonzero(np.diff(trace["stage"])) + 1, [400, 800])
    for rows, torque in ((slice(0, 400), 0.0), (slice(400, 800), 9.8), (slice(800, 900), -4.9)):
        np.testing.assert_array_equal(trace["load_torque_nm"][rows], torque)
    np.testing.assert_array_equal(trace["output_angle_rad"][800:], 1.571)
    assert bench.calls[-1] == "safe_state"


def test_an_operator_who_declines_a_load_ends_the_run_safely(tmp_path):
    bench = FakeBench()
    with pytest.raises(Aborted, match="not confirmed: operator: hang 2 kg cw"):
        runner_of(tmp_path, bench, FakeOperator(bench, refuse="hang")).run()
    assert bench.calls[-1] == "safe_state"


def test_a_plan_runs_on_the_embedded_bench_as_any_other_motion(tmp_path):
    turn = (Segment("ramp", 0.5, 150.0), Segment("hold", 3.0, 150.0), Segment("ramp", 0.5, 0.0))
    asked = MotionPlan("short", (Segment("rest", 0.3), *turn))
    outcome = run_experiment("ripple", WHOLE, BenchOptions(tmp_path, motion=asked), quiet)
    trace = read_trace(outcome.folder.trace)
    assert len(trace) == 4300
    assert "load_torque_nm" not in trace
    # every sample follows its predecessor, and the speed is the one that was asked for
    np.testing.assert_allclose(np.diff(trace.time_s), 0.001, rtol=1e-6)
    assert trace["motor_velocity_rad_s"][2000:3500].mean() == pytest.approx(150.0, rel=2e-3)
    assert outcome.folder.manifest["details"]["plan"]["motion"]["name"] == "short"


def test_a_simulated_bench_refuses_a_load_that_it_cannot_hold_in_motion(tmp_path):
    asked = MotionPlan("loaded", (LoadStep("hang it", 5.0), *FREE, LoadStep("off", 0.0)))
    with pytest.raises(UsageError, match="loads only while it is locked"):
        run_experiment("ripple", WHOLE, BenchOptions(tmp_path, motion=asked), quiet)
