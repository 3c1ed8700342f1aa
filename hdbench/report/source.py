"""What a report reads: one run folder, or one file that stands alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdbench.errors import DataError, nothing_stored
from hdbench.profile import Profile, parse_profile
from hdbench.records import Loads, Trace
from hdbench.records.jsonfile import read_json, sha256_file
from hdbench.records.recovery import resolve_input
from hdbench.records.runfolder import RunFolder
from hdbench.records.tables import is_loads_file, read_loads, read_trace
from hdbench.results import CalibrationResult, MisalignmentResult, Result, RippleResult

__all__ = ["Source", "load_source", "typed_result"]

_TYPES: dict[str, type[Result]] = {
    "calibration": CalibrationResult,
    "misalignment": MisalignmentResult,
    "ripple": RippleResult,
}
_KINDS = (*_TYPES, "diagnosis")
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
    the same typed; that of a diagnosis is a mapping.
    """

    path: Path
    kind: str
    run_id: str
    manifest: Mapping[str, Any]
    stored: Mapping[str, Any]
    result: Any
    trace: Trace | None
    loads: Loads | None
    profile: Profile | None
    doubts: tuple[str, ...]

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
    if is_loads_file(path):
        arm = None if profile is None else profile.data.arm
        loads = read_loads(path, arm)
        return Source(path, "loads", path.name, {}, {}, None, None, loads, profile, ())
    return Source(path, "trace", path.name, {}, {}, None, read_trace(path), None, profile, ())


def typed_result(kind: str, stored: Mapping[str, Any], where: str) -> Any:
    """Return a stored result as its type; one of a kind without a type as it is."""
    return _TYPES[kind].from_json(stored, where) if kind in _TYPES else stored


def _from_result(path: Path, profile: Profile | None) -> Source:
    result = read_json(path, None)
    kind = str(result.get("schema", "")).removeprefix("hdbench/").partition("/")[0]
    if kind not in _KINDS:
        raise DataError(
            f"schema is {result.get('schema')!r:.60}; needed: one of "
            + ", ".join(f"hdbench/{name}/1" for name in _KINDS),
            where=f"{path}: schema",
            fix="name a run folder or a result.json",
        )
    doubts = ("Only the result was given: figures of the data itself are left out.",)
    typed = typed_result(kind, result, str(path))
    return Source(path, kind, path.name, {}, result, typed, None, None, profile, doubts)


def _from_folder(path: Path, given: Profile | None) -> Source:
    run = RunFolder.open(path)
    kind = str(run.manifest["kind"])
    if kind not in _KINDS:
        raise DataError(
            f"a run of kind {kind!r:.40}; needed: {', '.join(_KINDS)}",
            where=f"{path / 'run.json'}: kind",
            fix="name a run of an experiment or a diagnosis",
        )
    profile = _own_profile(run, given)
    doubts = [*_status_doubts(run), *_changed_files(run)]
    result: Mapping[str, Any] = {}
    if run.result.is_file():
        result = read_json(run.result, f"hdbench/{kind}/1")
    else:
        doubts.append("There is no result: the run was not evaluated.")
    doubts.extend(_result_doubts(result))
    trace, loads = _data(run, kind, profile, doubts)
    typed = typed_result(kind, result, str(run.result)) if result else None
    return Source(
        path, kind, run.run_id, run.manifest, result, typed, trace, loads, profile, tuple(doubts)
    )


def _own_profile(run: RunFolder, given: Profile | None) -> Profile | None:
    text = run.manifest["profile"].get("text")
    if isinstance(text, str):
        return parse_profile(text, f"{run.path / 'run.json'}: profile")
    return given


def _status_doubts(run: RunFolder) -> list[str]:
    status = run.status()
    if status == "complete":
        return []
    reason = run.manifest.get("exit_reason")
    return [_STATUS[status] + (f" Reason: {reason}" if reason else "")]


def _changed_files(run: RunFolder) -> list[str]:
    doubts = []
    for name, expected in run.manifest["files"].items():
        file = run.path / Path(str(name)).name
        if not file.is_file():
            doubts.append(f"{name} is missing from the run folder.")
        elif file.name != "report.html" and sha256_file(file) != expected:
            doubts.append(f"{name} was changed after the run: its SHA-256 differs.")
    return doubts


def _result_doubts(result: Mapping[str, Any]) -> list[str]:
    doubts = [f"Doubtful data: {text}." for text in result.get("doubts", ())]
    for flag in (*result.get("flags", ()), *result.get("data_flags", ())):
        if isinstance(flag, Mapping):
            doubts.append(_flag_words(flag))
    return doubts


def _flag_words(flag: Mapping[str, Any]) -> str:
    if flag.get("detail"):
        return f"{flag.get('name')}: {flag['detail']}"
    span = ""
    if isinstance(flag.get("from_s"), int | float) and isinstance(flag.get("to_s"), int | float):
        span = f" from {flag['from_s']:.3f} s to {flag['to_s']:.3f} s"
    return f"{flag.get('name')}: {flag.get('samples', '?')} samples{span}"


def _data(
    run: RunFolder, kind: str, profile: Profile | None, doubts: list[str]
) -> tuple[Trace | None, Loads | None]:
    if kind == "diagnosis" or run.status() == "running":
        return None, None
    if (
        not any(p.exists() for p in (run.trace, run.loads, run.journal))
        and not (run.path / "trace.csv.gz").exists()
    ):
        doubts.append("The run holds no data.")
        return None, None
    file = _data_file(run, doubts)
    if file is None:
        return None, None
    if is_loads_file(file):
        return None, read_loads(file, None if profile is None else profile.data.arm)
    return read_trace(file), None


def _data_file(run: RunFolder, doubts: list[str]) -> Path | None:
    packed = run.path / "trace.csv.gz"
    if packed.is_file() and not run.trace.is_file():
        return packed
    if run.trace.is_file() or run.loads.is_file():
        return resolve_input(run.path)
    try:
        return resolve_input(run.path)
    except DataError as error:
        # a run that ended before its first sample has a journal without data: that is its report
        doubts.append(f"No data could be recovered from the journal: {error.what}.")
        return None
