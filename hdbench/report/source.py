"""Source of a report: one run folder, or one file that stands alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hdbench.errors import DataError, nothing_stored
from hdbench.profile import Profile, stored_profile
from hdbench.records import Loads, Trace
from hdbench.records.jsonfile import read_json
from hdbench.records.loads import is_loads_file, read_loads
from hdbench.records.recovery import resolve_input
from hdbench.records.runfolder import RunFolder
from hdbench.records.storage import sha256_file
from hdbench.records.tracefile import read_trace
from hdbench.results import RESULT_TYPES, read_result

_STATUS = {
    "running": "The run has not ended: what is shown here is what was there when this was written.",
    "incomplete": "The run is incomplete: it ended before its plan did.",
    "aborted": "The run was aborted by the safety limits or the operator.",
}


@dataclass(frozen=True, slots=True)
class Source:
    """One run as the report needs it.

    `kind` is ``trace`` or ``loads`` for data without a result; `manifest` is the content of
    ``run.json`` and `stored` that of ``result.json``, both empty where there is none. `result` is
    the same typed.
    """

    path: Path
    kind: str
    run_id: str
    profile: Profile | None
    manifest: Mapping[str, Any] = field(default_factory=dict)
    stored: Mapping[str, Any] = field(default_factory=dict)
    result: Any = None
    trace: Trace | None = None
    loads: Loads | None = None
    doubts: tuple[str, ...] = ()

    @property
    def folder(self) -> Path:
        """Folder in which the files of the run lie."""
        return self.path if self.path.is_dir() else self.path.parent

    def detail(self, key: str) -> Any:
        """Return an entry of ``run.json``, at the top or among its details, or None."""
        value = self.manifest.get(key)
        if value is None:
            details = self.manifest.get("details")
            value = details.get(key) if isinstance(details, Mapping) else None
        return value


def load_source(path: Path, profile: Profile | None = None) -> Source:
    """Read a run folder, a result file, a trace or a loads file."""
    path = Path(path)
    if path.is_dir():
        return _from_folder(path, profile)
    if path.suffix == ".json" and path.is_file():
        return _from_result(path, profile)
    if not path.exists():
        raise nothing_stored(path)
    trace, loads = _read_data(path, profile)
    return Source(
        path, "trace" if loads is None else "loads", path.name, profile, trace=trace, loads=loads
    )


def typed_result(kind: str, stored: Mapping[str, Any], where: str) -> Any:
    """Return a stored result as its type; one of a kind without a type as it is."""
    return RESULT_TYPES[kind].from_json(stored, where) if kind in RESULT_TYPES else stored


def _from_result(path: Path, profile: Profile | None) -> Source:
    kind, stored, result = read_result(path)
    doubts = ("Only the result was given: figures of the data itself are left out.",)
    return Source(path, kind, path.name, profile, stored=stored, result=result, doubts=doubts)


def _from_folder(path: Path, profile: Profile | None) -> Source:
    run = RunFolder.open(path)
    kind = str(run.manifest["kind"])
    if kind not in RESULT_TYPES:
        raise DataError(
            f"a run of kind {kind!r:.40}; needed: {', '.join(RESULT_TYPES)}",
            where=f"{path / 'run.json'}: kind",
            fix="name a run of an experiment or a diagnosis",
        )
    profile = stored_profile(run.manifest, run.path) or profile
    doubts = list(_run_doubts(run))
    stored: Mapping[str, Any] = {}
    if run.result.is_file():
        stored = read_json(run.result, f"hdbench/{kind}/1")
    else:
        doubts.append("There is no result: the run was not evaluated.")
    doubts += _result_doubts(stored)
    file = None
    if kind != "diagnosis" and run.status() != "running":
        file = _data_file(run, doubts)
    trace, loads = (None, None) if file is None else _read_data(file, profile)
    result = typed_result(kind, stored, str(run.result)) if stored else None
    return Source(
        path, kind, run.run_id, profile, run.manifest, stored, result, trace, loads, tuple(doubts)
    )


def _run_doubts(run: RunFolder) -> Iterator[str]:
    """Say how the run ended early, and which of its files are missing or were changed."""
    status, reason = run.status(), run.manifest.get("exit_reason")
    if status != "complete":
        yield _STATUS[status] + (f" Reason: {reason}" if reason else "")
    for name, expected in run.manifest["files"].items():
        file = run.path / Path(str(name)).name
        if not file.is_file():
            yield f"{name} is missing from the run folder."
        elif file.name != "report.html" and sha256_file(file) != expected:
            yield f"{name} was changed after the run: its SHA-256 differs."


def _result_doubts(stored: Mapping[str, Any]) -> Iterator[str]:
    for text in stored.get("doubts", ()):
        yield f"Doubtful data: {text}."
    for flag in (*stored.get("flags", ()), *stored.get("data_flags", ())):
        if not isinstance(flag, Mapping):
            continue
        words, ends = flag.get("detail"), (flag.get("from_s"), flag.get("to_s"))
        if not words:
            known = all(isinstance(end, int | float) for end in ends)
            span = f" from {ends[0]:.3f} s to {ends[1]:.3f} s" if known else ""
            words = f"{flag.get('samples', '?')} samples{span}"
        yield f"{flag.get('name')}: {words}"


def _data_file(run: RunFolder, doubts: list[str]) -> Path | None:
    packed = run.path / "trace.csv.gz"
    if packed.is_file() and not run.trace.is_file():
        return packed
    if not any(file.exists() for file in (run.trace, run.loads, run.journal)):
        doubts.append("The run holds no data.")
        return None
    try:
        return resolve_input(run.path)
    except DataError as error:
        if run.trace.is_file() or run.loads.is_file():
            raise
        # a run that ended before its first sample has a journal without data: that is its report
        doubts.append(f"No data could be recovered from the journal: {error.what}.")
        return None


def _read_data(file: Path, profile: Profile | None) -> tuple[Trace | None, Loads | None]:
    if is_loads_file(file):
        return None, read_loads(file, None if profile is None else profile.data.arm)
    return read_trace(file), None
