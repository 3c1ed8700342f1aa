"""Records that others measured: read, converted, diagnosed; what is known of them beside.

The folder is that of `HDBENCH_DATA`; without it there is no such part.
"""

from __future__ import annotations

import csv
import gzip
import json
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "blind"))

from injector.build import Case  # noqa: E402

from hdbench.profile import Profile, parse_profile  # noqa: E402
from hdbench.records import Trace  # noqa: E402

__all__ = ["profile_text", "profile_with", "real_cases", "real_profile", "real_trace", "real_truth"]

_LARA = "lara8_dual_encoder/validate_joint3_sweep.csv"
_LARA_RATIO = 101.0
# from here on the joint turns at the speed of the sweep, rad/s of the joint
_LARA_SPEED_RAD_S = 0.86
# the base profile of every record: what stands in the truth's `profile` is set in it
_BASE = "cim-tr-97-06"
_LARA_PROFILE = {
    "drive.gear_ratio": _LARA_RATIO,
    "drive.rated_torque_nm": 150.0,
    "limits.torque_nm": 300.0,
    "limits.velocity_rad_s": 1000.0,
}


def _folder() -> Path | None:
    data = os.environ.get("HDBENCH_DATA")
    return Path(data) if data and (Path(data) / "real" / "truth.json").exists() else None


def _known() -> dict[str, dict[str, Any]]:
    folder = _folder()
    return {} if folder is None else json.loads((folder / "real" / "truth.json").read_text())


def real_cases() -> list[Case]:
    """Return one case for each record that is known, none without the data."""
    return [Case(f"R-{name}", "R", name) for name in _known()]


def real_truth(case: Case) -> dict[str, Any]:
    """Return what is known of the record, in the form of the other truths."""
    return {
        "key": case.key, "part": "R", "record": case.record, "noise": "", "hidden": [],
        "fault": "", "note": "", "known": _known()[case.record],
    }  # fmt: skip


def real_profile(case: Case) -> Profile:
    """Return the base profile with the values that are known of this drive."""
    known = _known()
    values: Mapping[str, Any] | str = known[case.record].get("profile", {})
    if isinstance(values, str):
        values = known[values]["profile"]
    if case.record == "lara8":
        values = _LARA_PROFILE
    return profile_with(values)


def profile_text(values: Mapping[str, Any]) -> str:
    """Return the text of the base profile with some keys set."""
    lines, section = [], ""
    for line in (ROOT / "profiles" / f"{_BASE}.toml").read_text().splitlines():
        section = line.strip("[] ") if line.startswith("[") else section
        name = f"{section}.{line.partition('=')[0].strip()}"
        lines.append(f"{line.partition('=')[0]}= {values[name]}" if name in values else line)
    return "\n".join(lines) + "\n"


def profile_with(values: Mapping[str, Any]) -> Profile:
    """Return the base profile with some keys set."""
    return parse_profile(profile_text(values), "the base profile with other keys")


def real_trace(case: Case) -> Trace:
    """Return the record in the columns of the contract."""
    folder = _folder()
    if folder is None:
        raise SystemExit("HDBENCH_DATA: no folder with real/truth.json; set it to read the records")
    if case.record == "lara8":
        return Trace(_lara(folder / _LARA), source="real")
    with gzip.open(folder / "real" / f"{case.record}.csv.gz", "rt") as file:
        rows = list(csv.reader(file))
    table = np.array([[float(cell or "nan") for cell in row] for row in rows[1:]])
    columns = {name: np.ascontiguousarray(table[:, k]) for k, name in enumerate(rows[0])}
    return Trace(columns, source="real")


def _lara(path: Path) -> dict[str, Any]:
    """Joint 3 at its speed: the motor's encoder of 24 bit, the torque of the motor current."""
    with path.open() as file:
        rows = list(csv.DictReader(file))

    def column(name: str) -> Any:
        return np.array([float(row[name]) for row in rows])

    turn = 2.0 * np.pi / 2.0**24
    speed = column("joint_velocity_3")
    pick = np.flatnonzero(np.abs(speed) > _LARA_SPEED_RAD_S)
    pick = np.arange(pick[0], pick[-1] + 1)
    time, angle = column("Timestamp")[pick], turn * column("encoder_motorinc_3")[pick]
    output = turn * column("encoder_loadinc_3")[pick]
    keep = np.concatenate([[True], np.diff(time) > 0.0])
    torque = column("joint_torque_current_3")[pick]
    return {
        "time_s": (time - time[0])[keep],
        "motor_velocity_rad_s": (_LARA_RATIO * speed[pick])[keep],
        "motor_angle_rad": np.unwrap(angle - angle[0])[keep],
        "output_angle_rad": np.unwrap(output - output[0])[keep],
        "torque_nm": torque[keep],
    }
