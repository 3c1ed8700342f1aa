"""However a run ends, an unconfirmed safe state is what the user hears."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path

import pytest
from fakes import FakeBench, FakeOperator

from hdbench.errors import BusyError, DataError, DeviceError, HdbenchError, UnsafeError
from hdbench.profile import load_profile
from hdbench.records.jsonfile import read_json
from hdbench.session import BenchOptions, measurement, run, run_experiment


def run_with(
    monkeypatch: pytest.MonkeyPatch, out: Path, failure: Exception, *, confirms: bool
) -> None:
    def fail(bench: FakeBench, name: str) -> None:
        if name == "read_block" and bench.calls.count(name) == 3:
            raise failure

    bench = FakeBench(hook=fail)
    bench.confirms = confirms

    @contextmanager
    def opened(*_arguments: object, **_named: object):
        yield bench

    monkeypatch.setattr(run, "open_bench", opened)
    monkeypatch.setattr(measurement, "SimulatedOperator", FakeOperator)
    run_experiment(
        "ripple", load_profile("cim-tr-97-06"), BenchOptions(out), lambda _what, _share: None
    )


@pytest.mark.parametrize(
    ("kind", "status"),
    [(DeviceError, "incomplete"), (BusyError, "aborted"), (DataError, "aborted")],
)
def test_the_safe_state_is_told_before_the_error_that_ended_the_run(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, kind: type[HdbenchError], status: str
) -> None:
    failure = kind("it failed", where="fake", fix="none")
    with pytest.raises(UnsafeError, match=r"COULD NOT BE CONFIRMED.*after: it failed"):
        run_with(monkeypatch, tmp_path, failure, confirms=False)
    (manifest,) = tmp_path.glob("*/run.json")
    assert read_json(manifest)["status"] == status


def test_with_the_bench_safe_the_error_itself_is_told_and_the_samples_are_kept(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    failure = DeviceError("it failed", where="fake", fix="none")
    with pytest.raises(DeviceError, match="it failed"):
        run_with(monkeypatch, tmp_path, failure, confirms=True)
    (manifest,) = tmp_path.glob("*/run.json")
    assert "trace.csv" in read_json(manifest)["files"]


def test_a_bug_with_a_motor_that_may_turn_is_told_as_unsafe(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with pytest.raises(UnsafeError, match=r"COULD NOT BE CONFIRMED.*after: RuntimeError: a bug"):
        run_with(monkeypatch, tmp_path, RuntimeError("a bug"), confirms=False)
    (manifest,) = tmp_path.glob("*/run.json")
    assert read_json(manifest)["status"] == "incomplete"


def test_a_bug_leaves_no_run_behind_that_says_it_still_goes_on(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def broken(bench: FakeBench, name: str) -> None:
        if name == "read_block" and bench.calls.count(name) == 3:
            raise RuntimeError("a bug")

    bench = FakeBench(hook=broken)

    @contextmanager
    def opened(*_arguments: object, **_named: object):
        yield bench

    monkeypatch.setattr(run, "open_bench", opened)
    monkeypatch.setattr(measurement, "SimulatedOperator", FakeOperator)
    with pytest.raises(RuntimeError, match="a bug"):
        run_experiment(
            "ripple", load_profile("cim-tr-97-06"), BenchOptions(tmp_path), lambda _w, _s: None
        )
    assert bench.calls[-1] == "safe_state"
    (manifest,) = tmp_path.glob("*/run.json")
    assert read_json(manifest)["status"] == "incomplete"
    assert not (manifest.parent / ".reserve").exists()
