"""Points of a calibration, and the file that keeps their sequence for a resumed run."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from pydantic import TypeAdapter, ValidationError

from hdbench.errors import DataError
from hdbench.records.jsonfile import read_json, write_json

Role = Literal["zero-check", "shunt", "preload", "reading"]
PREPARATIONS = ("zero-check", "shunt", "preload")
"""Roles whose readings prepare the calibration and are no part of its loads."""


@dataclass(frozen=True, slots=True)
class Point:
    """One load to put on, to wait for and to read."""

    number: int
    role: Role
    experiment: str
    position_rad: float
    range: str
    direction: str
    series: str
    mass_kg: float
    torque_nm: float
    step_nm: float
    read_after_s: float
    label: str
    position_index: int = 1
    position_count: int = 1
    repeat: int = 0

    @property
    def mounting(self) -> tuple[float, str]:
        """Position and direction: what stays untouched from one point to the next."""
        return self.position_rad, self.direction

    def describe(self) -> str:
        """Return the point in words."""
        if self.role == "zero-check":
            return f"{self.label}: no weight, bridge zero and range"
        if self.role == "shunt":
            return f"{self.label}: shunt resistor on, no weight"
        return (
            f"{self.label}: {self.mass_kg:g} kg {self.direction}, expect {self.torque_nm:+.3f} N m"
        )


PLAN_NAME = "plan.json"
SCHEMA = "hdbench/calibration-plan/1"


def write_points(folder: Path, points: tuple[Point, ...], preset: str) -> None:
    """Write the sequence into a run folder."""
    listed = [asdict(point) for point in points]
    write_json(folder / PLAN_NAME, {"schema": SCHEMA, "preset": preset, "points": listed})


def read_points(folder: Path) -> tuple[Point, ...]:
    """Read the sequence of a stored run."""
    path = folder / PLAN_NAME
    if not path.is_file():
        raise DataError(
            f"no {PLAN_NAME}: the sequence of this calibration is not known",
            where=str(folder),
            fix="start the calibration anew; what was read is kept in this run",
        )
    listed = json.dumps(read_json(path, SCHEMA).get("points"))
    points: tuple[Point, ...] = ()
    problem = ""
    try:
        points = TypeAdapter(tuple[Point, ...]).validate_json(listed, strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        problem = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    if not points or [point.number for point in points] != list(range(1, len(points) + 1)):
        raise DataError(
            f"the points of the plan are damaged: {problem or 'not numbered in order'}",
            where=str(path),
            fix="restore the file from a copy, or start the calibration anew",
        )
    return points
