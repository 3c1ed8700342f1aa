"""One of two results to compare: a run folder, or a result file on its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdbench.errors import DataError
from hdbench.profile import Profile, parse_profile
from hdbench.profile.scaling import measured_utc
from hdbench.records import Loads, Quantity
from hdbench.records.jsonfile import read_json
from hdbench.records.runfolder import RunFolder
from hdbench.records.tables import read_loads

__all__ = ["KINDS", "Side", "load_side", "number", "quantity"]

KINDS = ("calibration", "misalignment", "ripple", "diagnosis")


@dataclass(frozen=True, slots=True)
class Side:
    """One result and what is known of how it came about.

    Parameters
    ----------
    path : Path
        What was named.
    kind : str
        One of `KINDS`.
    run_id : str
        Name of the run, or of the file.
    result : mapping
        The result.
    manifest : mapping
        Content of run.json; empty where only a result file was named.
    profile : Profile or None
        The bench as stored with the run.
    """

    path: Path
    kind: str
    run_id: str
    result: Mapping[str, Any]
    manifest: Mapping[str, Any]
    profile: Profile | None

    @property
    def where(self) -> str:
        """The result file, for messages."""
        return str(self.path / "result.json" if self.path.is_dir() else self.path)

    def loads(self) -> Loads | None:
        """Return the readings beside the result, or None where there are none."""
        folder = self.path if self.path.is_dir() else self.path.parent
        for name in ("loads.csv", "loads.csv.gz"):
            if self.manifest and (folder / name).is_file():
                return read_loads(
                    folder / name, None if self.profile is None else self.profile.data.arm
                )
        return None

    def identity(self) -> dict[str, Any]:
        """Return what tells this side from the other."""
        head = self.result.get("profile")
        return {
            "path": str(self.path),
            "run_id": self.run_id,
            "status": self.manifest.get("status"),
            "started_utc": self.manifest.get("started_utc"),
            "ended_utc": self.manifest.get("ended_utc"),
            "measured_utc": measured_utc(self.path) if self.manifest else None,
            "profile": dict(head) if isinstance(head, Mapping) else None,
            "doubts": [str(doubt) for doubt in self.result.get("doubts", ())],
            "flags": [
                str(flag.get("name")) if isinstance(flag, Mapping) else str(flag)
                for flag in self.result.get("flags", ())
            ],
        }


def load_side(path: Path) -> Side:
    """Read a run folder or a result file."""
    path = Path(path)
    file = path / "result.json" if path.is_dir() else path
    if path.is_dir() and not file.is_file():
        raise DataError(
            "the run has no result.json; needed: an evaluated run",
            where=str(path),
            fix="evaluate it with --from, or name another run",
        )
    result = read_json(file)
    kind = str(result.get("schema", "")).removeprefix("hdbench/").partition("/")[0]
    if kind not in KINDS:
        raise DataError(
            f"schema is {result.get('schema')!r:.60}; needed: one of "
            + ", ".join(f"hdbench/{name}/1" for name in KINDS),
            where=f"{file}: schema",
            fix="name a run folder, or the result.json of one",
        )
    manifest: Mapping[str, Any] = {}
    if file.name == "result.json" and (file.parent / "run.json").is_file():
        manifest = RunFolder.open(file.parent).manifest
    run_id = file.parent.name if manifest else file.name
    return Side(path, kind, run_id, result, manifest, _profile(manifest, file))


def _profile(manifest: Mapping[str, Any], file: Path) -> Profile | None:
    text = manifest.get("profile", {}).get("text") if manifest else None
    if not isinstance(text, str):
        return None
    return parse_profile(text, f"{file.parent / 'run.json'}: profile")


def number(body: Any) -> float | None:
    """Return a plain number, or None where it is none."""
    if isinstance(body, bool) or not isinstance(body, int | float):
        return None
    return float(body)


def quantity(body: Any, where: str) -> Quantity | None:
    """Return a number with its uncertainty, or None where there is none."""
    if body is None:
        return None
    if isinstance(body, Mapping):
        value, std, dof = (number(body.get(key)) for key in ("value", "std", "dof"))
        if value is not None and std is not None:
            try:
                return Quantity(value, std, dof)
            except ValueError as error:
                raise _damaged(str(error), where) from error
    raise _damaged(f"found {body!r:.60}; needed: an object with value, std and dof", where)


def _damaged(what: str, where: str) -> DataError:
    return DataError(what, where=where, fix="evaluate the run again with --from")
