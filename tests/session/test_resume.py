"""A run that ended early goes on in its folder: same bench, same gains, nothing measured twice."""

import os
import signal
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from calibrationkit import Scripted
from fakes import check_filtered, quiet

from hdbench.diagnosis.planning.segments import LoadStep, MotionPlan, Segment
from hdbench.errors import BusyError, DataError, HdbenchError, Stopped, UsageError
from hdbench.profile import Profile, parse_profile
from hdbench.records import RunFolder, read_loads, read_trace
from hdbench.records.recovery import verify_run
from hdbench.session import BenchOptions, run_experiment
from hdbench.session.calibrating.conversation import Answer
from hdbench.session.experiments import resume_run

# the run itself says how it was asked for
AS_BEFORE = BenchOptions(out=Path(), realtime=None)


@pytest.fixture(scope="module")
def bench(changed_profile) -> Profile:
    """Return the report's bench with one position, both sides, and short motion."""
    one = {"positions": 1, "ranges": ["full"], "full_masses_kg": [0.0, 4.0, 8.0]}
    reference = {"ripple.reference": {"frequency_hz": 0.25}}
    text = changed_profile(calibration=one, ripple={"duration_s": 4.0}, **reference)
    return parse_profile(text, "test bench")


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return a plant whose clampings differ by 3 %: a clamping that is counted wrong shows."""
    path = tmp_path_factory.mktemp("plant") / "loose.toml"
    path.write_text('name = "loose"\n\n[fixture]\nrepeatability = 0.03\n')
    return str(path)


def stops_at(look: int, word: str = "") -> Callable[[str, float], None]:
    """Return a progress that presses Ctrl-C at this look at a step with `word` in its name."""
    looks = count(1)

    def told(what: str, _share: float) -> None:
        if word in what and next(looks) == look:
            os.kill(os.getpid(), signal.SIGINT)

    return told


def test_a_calibration_goes_on_with_the_same_bench_and_the_same_clampings(bench, plant, tmp_path):
    options = BenchOptions(out=tmp_path / "a", plant=plant, seed=3)
    whole = run_experiment("calibration", bench, options, quiet)
    talk = Scripted([("p1-ccw-full 3 of 5", Answer.QUIT)])
    broken = BenchOptions(out=tmp_path / "b", plant=plant, seed=3, talk=talk, rehearse=True)
    with pytest.raises(Stopped) as stopped:
        run_experiment("calibration", bench, broken, quiet)
    assert stopped.value.exit_code == 130
    (path,) = (tmp_path / "b").iterdir()
    assert RunFolder.open(path).status() == "incomplete"
    assert verify_run(path).ok
    # a bench that does not answer costs the run nothing
    with pytest.raises(HdbenchError):
        resume_run(path, replace(AS_BEFORE, address="tcp://127.0.0.1:9"), quiet)
    assert RunFolder.open(path).status() == "incomplete"
    resumed = resume_run(path, AS_BEFORE, quiet)
    assert resumed.folder.path == path
    assert len(resumed.folder.manifest["sessions"]) == 2
    assert RunFolder.open(path).status() == "complete"
    assert verify_run(path).ok
    once, twice = (read_loads(run.folder.loads, bench.data.arm) for run in (whole, resumed))
    assert [r.experiment for r in once.readings] == [r.experiment for r in twice.readings]
    # same clampings and the same noise; what is left is how the last weight's bounce began, which
    # decays to 1e-3 of 20 N m within the second before the average: 0.2 mV of it
    for a, b in zip(once.readings, twice.readings, strict=True):
        assert a.reading_v == pytest.approx(b.reading_v, abs=2e-4)
    gains = [line["gain_nm_per_v"] for line in resumed.result.to_json()["experiments"]]
    assert np.ptp(gains) > 0.05  # the clampings of this plant do differ


def test_motion_that_was_broken_off_is_taken_again_and_its_samples_are_kept(bench, tmp_path):
    with pytest.raises(Stopped):
        run_experiment("ripple", bench, BenchOptions(out=tmp_path, seed=4), stops_at(40))
    (path,) = tmp_path.iterdir()
    first = verify_run(path).samples_in_journal
    assert 0 < first < 4000
    outcome = resume_run(path, AS_BEFORE, quiet)
    trace = read_trace(outcome.folder.trace)
    assert len(trace) == 4000
    assert len(read_trace(path / "trace-broken-off-1.csv")) == first
    check_filtered(trace, outcome.folder.manifest["filter"])
    assert verify_run(path).ok


@pytest.mark.parametrize(
    ("status", "kind"),
    [("complete", UsageError), ("aborted", UsageError), ("running", BusyError),
     ("incomplete", DataError)],
)  # fmt: skip
def test_what_cannot_be_resumed_is_refused_and_left_as_it_is(bench, tmp_path, status, kind):
    folder = RunFolder.create(tmp_path, kind="calibration", profile=bench, details={})
    if status != "running":
        folder.finish(status, "for a test", [])
    before = (folder.path / "run.json").read_bytes()
    with pytest.raises(kind):
        resume_run(folder.path, AS_BEFORE, quiet)
    assert (folder.path / "run.json").read_bytes() == before


def test_a_run_does_not_go_on_on_another_bench(bench, tmp_path):
    folder = RunFolder.create(tmp_path, kind="ripple", profile=bench, details={})
    folder.update(device={"vendor": "hdbench", "model": "emulated node", "serial": "sim-77"})
    folder.finish("incomplete", "for a test", [])
    with pytest.raises(UsageError, match="the run began on hdbench emulated node sim-77"):
        resume_run(folder.path, AS_BEFORE, quiet)
    assert RunFolder.open(folder.path).status() == "incomplete"


def test_of_a_plan_with_loads_only_the_acquisition_that_was_broken_off_is_taken_again(
    bench, tmp_path
):
    motion = MotionPlan(
        "two stages",
        (
            LoadStep("no load", 0.0),
            Segment("ramp", 0.3, 60.0),
            Segment("hold", 0.4, 60.0),
            Segment("ramp", 0.3, 0.0),
            LoadStep("lock, 4 kg cw", 19.6, locked=True, position_rad=0.5),
            Segment("rest", 1.0),
        ),
    )
    options = BenchOptions(tmp_path, motion=motion, seed=2)
    with pytest.raises(Stopped):
        run_experiment("ripple", bench, options, stops_at(15, "no reference"))
    (path,) = tmp_path.iterdir()
    first = read_trace(path / "trace.csv")
    assert 1000 < len(first) < 2000
    resume_run(path, AS_BEFORE, quiet)
    trace = read_trace(path / "trace.csv")
    assert [int(np.sum(trace["stage"] == stage)) for stage in (0, 1)] == [1000, 1000]
    np.testing.assert_array_equal(trace["torque_v"][:1000], first["torque_v"][:1000])
    assert np.all(np.diff(trace["time_s"]) > 0.0)
    check_filtered(trace, RunFolder.open(path).manifest["filter"])
    assert len(read_trace(path / "trace-broken-off-1.csv")) == len(first) - 1000
