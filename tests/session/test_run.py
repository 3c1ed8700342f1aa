"""However a run ends, an unconfirmed safe state is what the user hears."""

from contextlib import contextmanager

import pytest
from fakes import FakeBench, FakeOperator, quiet

from hdbench.errors import BusyError, DataError, DeviceError, UnsafeError
from hdbench.profile import load_profile
from hdbench.records.jsonfile import read_json
from hdbench.session import BenchOptions, run, run_experiment

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

    @contextmanager
    def opened(*_arguments: object, **_named: object):
        yield bench

    monkeypatch.setattr(run, "open_bench", opened)
    monkeypatch.setattr(run, "SimulatedOperator", FakeOperator)
    with pytest.raises(told, match=words):
        run_experiment("ripple", load_profile("cim-tr-97-06"), BenchOptions(tmp_path), quiet)
    assert bench.calls[-1] == "safe_state"
    (file,) = tmp_path.glob("*/run.json")
    manifest = read_json(file)
    assert manifest["status"] == status
    # after a bug the journal alone is sure
    assert "trace.csv" in manifest["files"] or failure is RuntimeError
    assert not (file.parent / ".reserve").exists()
