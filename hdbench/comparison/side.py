"""One of two results to compare, and what differs in how both came about."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdbench.errors import DataError
from hdbench.profile import Profile, stored_profile
from hdbench.profile.scaling import measured_utc
from hdbench.records import Loads
from hdbench.records.loads import read_loads
from hdbench.records.runfolder import RunFolder
from hdbench.results import read_result
from hdbench.results.parts import Leaf, flatten

_ABOUT = ("hdbench_version", "versions", "device", "host", "calibration", "status")
# what a run says of one calibration and its age is told by the calibration's hash already
_LEFT_OUT = ("calibration.age_days", "calibration.age_words")


@dataclass(frozen=True, slots=True)
class Side:
    """One result and what is known of how it came about.

    Parameters
    ----------
    path : Path
        What was named.
    kind : str
        ``calibration``, ``misalignment``, ``ripple`` or ``diagnosis``.
    run_id : str
        Name of the run, or of the file.
    body : mapping
        The result as its file holds it.
    result : CalibrationResult, MisalignmentResult, RippleResult or DiagnosisResult
        The same typed.
    manifest : mapping
        Content of run.json; empty where only a result file was named.
    profile : Profile or None
        The bench as stored with the run.
    """

    path: Path
    kind: str
    run_id: str
    body: Mapping[str, Any]
    result: Any
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
        head = self.body.get("profile")
        return {
            "path": str(self.path),
            "run_id": self.run_id,
            "status": self.manifest.get("status"),
            "started_utc": self.manifest.get("started_utc"),
            "ended_utc": self.manifest.get("ended_utc"),
            "measured_utc": measured_utc(self.path) if self.manifest else None,
            "profile": dict(head) if isinstance(head, Mapping) else None,
            "doubts": [str(doubt) for doubt in self.body.get("doubts", ())],
            "flags": [
                str(flag.get("name")) if isinstance(flag, Mapping) else str(flag)
                for flag in self.body.get("flags", ())
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
    kind, body, result = read_result(file)
    manifest: Mapping[str, Any] = {}
    if file.name == "result.json" and (file.parent / "run.json").is_file():
        manifest = RunFolder.open(file.parent).manifest
    run_id = file.parent.name if manifest else file.name
    return Side(path, kind, run_id, body, result, manifest, stored_profile(manifest, file.parent))


def _differences(a: Mapping[str, Leaf], b: Mapping[str, Leaf]) -> list[dict[str, Leaf]]:
    """Return the keys that are not the same in both; `only` names the side that has one alone."""
    changes: list[dict[str, Leaf]] = []
    for key in sorted(a.keys() | b.keys()):
        only = "" if key in a and key in b else "a" if key in a else "b"
        if only or a[key] != b[key]:
            changes.append({"key": key, "a": a.get(key), "b": b.get(key), "only": only})
    return changes


def profile_changes(a: Side, b: Side) -> list[dict[str, Leaf]] | None:
    """Return the profile keys that differ, as the profiles were written."""
    if a.profile is None or b.profile is None:
        return None
    first, second = (
        # dates as text
        flatten(json.loads(json.dumps(tomllib.loads(profile.text), default=str)))
        for profile in (a.profile, b.profile)
    )
    return _differences(first, second)


def environment_changes(a: Side, b: Side) -> list[dict[str, Leaf]] | None:
    """Return what else differs: versions, device, host, calibration, evaluation."""
    if not (a.manifest and b.manifest):
        return None
    first, second = (
        flatten({name: side.manifest[name] for name in _ABOUT if name in side.manifest})
        for side in (a, b)
    )
    for key in _LEFT_OUT:
        first.pop(key, None)
        second.pop(key, None)
    return _differences(first, second)
