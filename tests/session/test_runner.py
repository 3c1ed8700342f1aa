"""The runner makes the bench safe on every way out, keeps what came, and tells what is not safe."""

import signal
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from fakes import WHOLE, FakeBench, FakeOperator, opened, quiet, task_in

from hdbench.errors import BusyError, DataError, DeviceError, UnsafeError
from hdbench.profile.schema import ReferenceWave
from hdbench.records.counted import survey_samples
from hdbench.records.journal import read_journal
from hdbench.records.jsonfile import read_json
from hdbench.session import BenchOptions, run, run_experiment
from hdbench.session.plans import Acquire, Lock, Plan
from hdbench.session.runner import Runner
from hdbench.session.stop import Aborted, StopRequested, StopSignals

WAVE = ReferenceWave(wave="constant", bias_v=1.0)
MOTION = Plan("ripple", (Lock(locked=False), Acquire(WAVE, 0.001, 0.2)), 0.2)


def runner(tmp_path: Path, bench: FakeBench, *, operator=None, stop=None) -> Runner:
    journal, content = opened(tmp_path)
    task = task_in(tmp_path, MOTION, stop=stop, content=content)
    return Runner(task, bench, operator or FakeOperator(bench), journal, person=False)


def test_a_motion_run_ends_with_the_safe_state_and_every_sample(tmp_path):
    bench = FakeBench()
    run = runner(tmp_path, bench)
    run.run()
    assert bench.calls[-1] == "safe_state"
    assert run.safe is not None
    assert run.safe.confirmed
    trace = survey_samples(tmp_path / "journal.hdj").trace("here")
    assert len(trace) == 200
    np.testing.assert_array_equal(trace["time_s"], np.arange(200) * 0.001)


@pytest.mark.parametrize(
    ("call", "after", "blocks"),
    [
        ("configure", 0, 0),
        ("start", 0, 0),
        ("read_block", 0, 0),
        ("read_block", 6, 6),
        ("stop", 0, 10),
    ],
)
def test_whichever_call_fails_the_bench_is_made_safe_and_the_journal_can_be_read_back(
    tmp_path, call, after, blocks
):
    bench = FakeBench(fail_at=call, after=after)
    run = runner(tmp_path, bench)
    with pytest.raises(DeviceError, match=f"{call} failed"):
        run.run()
    assert bench.calls[-1] == "safe_state"
    assert not bench.moving
    run.recorder.journal.close()
    content = read_journal(tmp_path / "journal.hdj")
    assert sum(block.kind == "samples" for block in content.blocks) == blocks
    assert content.torn_bytes == 0


@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("phase", ["configure", "start", "read_block", "stop"])
def test_a_signal_in_any_call_ends_the_run_safely(tmp_path, signum, phase):
    stop = StopSignals()

    def ask(_bench: FakeBench, name: str) -> None:
        if name == phase:
            stop.note(signum, None)

    bench = FakeBench(hook=ask)
    run = runner(tmp_path, bench, stop=stop)
    if phase == "stop":
        # nothing is left to interrupt after the last step; the caller asks the signals once more
        run.run()
        with pytest.raises(StopRequested):
            stop.check()
    else:
        with pytest.raises(StopRequested) as request:
            run.run()
        assert request.value.signum == signum
    assert bench.calls[-1] == "safe_state"
    assert not bench.moving


def test_lost_samples_become_marked_rows_and_are_counted(tmp_path):
    bench = FakeBench()
    bench.lose_at = 60
    run = runner(tmp_path, bench)
    run.run()
    trace = survey_samples(tmp_path / "journal.hdj").trace("here")
    assert run.recorder.counts["lost"] == 5
    assert len(trace) == 200
    assert int(np.count_nonzero(np.isnan(trace["torque_v"]))) == 5
    assert np.all(np.isfinite(trace["time_s"]))


def test_speed_beyond_the_limit_aborts_and_names_the_sample(tmp_path):
    bench = FakeBench()
    bench.velocity_v = 8.0  # 450 rad/s, limit 400
    with pytest.raises(Aborted, match=r"motor speed \+450.* crossed the limit 400") as error:
        runner(tmp_path, bench).run()
    assert error.value.where == "sample 0"
    assert bench.calls[-1] == "safe_state"


@pytest.mark.parametrize("refused", ["release", "motion"])
def test_an_operator_who_declines_ends_the_run_before_anything_moves(tmp_path, refused):
    bench = FakeBench()
    with pytest.raises(Aborted, match="not confirmed"):
        runner(tmp_path, bench, operator=FakeOperator(bench, refuse=refused)).run()
    assert bench.calls == ["safe_state"]


def test_an_acquisition_that_is_done_is_not_taken_again(tmp_path):
    first = runner(tmp_path, FakeBench())
    first.run()
    first.recorder.journal.close()
    bench = FakeBench()
    run = runner(tmp_path, bench)
    run.run()
    assert bench.calls == ["safe_state"]
    assert len(run.records()) == 200


# what happens while the motor turns, whether the bench is safe afterwards; then what is told, and
# the status of the run
ENDS = [
    (DeviceError, False, UnsafeError, "COULD NOT BE CONFIRMED.*after: it failed", "incomplete"),
    (BusyError, False, UnsafeError, "COULD NOT BE CONFIRMED.*after: it failed", "aborted"),
    (DataError, False, UnsafeError, "COULD NOT BE CONFIRMED.*after: it failed", "aborted"),
    (DeviceError, True, DeviceError, "it failed", "incomplete"),
    (RuntimeError, False, UnsafeError, "CONFIRMED.*after: RuntimeError: a bug", "incomplete"),
    (RuntimeError, True, RuntimeError, "a bug", "incomplete"),
]


@pytest.mark.parametrize(("failure", "safe", "told", "words", "status"), ENDS)
def test_an_unsafe_bench_is_told_before_the_error_and_what_came_is_kept(
    monkeypatch, tmp_path, failure, safe, told, words, status
):
    bug = RuntimeError("a bug")
    error = bug if failure is RuntimeError else failure("it failed", where="fake", fix="none")

    def fail(bench: FakeBench, name: str) -> None:
        if name == "read_block" and bench.calls.count(name) == 3:
            raise error

    bench = FakeBench(hook=fail)
    bench.confirms = safe

    monkeypatch.setattr(run, "open_bench", lambda *_, **__: nullcontext(bench))
    monkeypatch.setattr(run, "SimulatedOperator", FakeOperator)
    with pytest.raises(told, match=words):
        run_experiment("ripple", WHOLE, BenchOptions(tmp_path), quiet)
    assert bench.calls[-1] == "safe_state"
    (file,) = tmp_path.glob("*/run.json")
    manifest = read_json(file)
    assert manifest["status"] == status
    # after a bug the journal alone is sure
    assert "trace.csv" in manifest["files"] or failure is RuntimeError
    assert not (file.parent / ".reserve").exists()
