"""Points of a calibration, and the file that keeps their sequence for a resumed run."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Literal

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


def _damaged(what: str, where: str) -> DataError:
    fix = "restore the file from a copy, or start the calibration anew"
    return DataError(what, where=where, fix=fix)


def point_from_dict(body: object, where: str) -> Point:
    """Return a point of a plan file."""
    if not isinstance(body, dict):
        raise _damaged("a point of the plan is damaged: no table", where)
    needed = {"float": (int, float), "int": (int,), "str": (str,), "Role": (str,)}
    values = {field.name: body.get(field.name) for field in fields(Point)}
    wrong = [
        field.name
        for field in fields(Point)
        if not isinstance(values[field.name], needed[str(field.type)])
        or isinstance(values[field.name], bool)
    ]
    if wrong:
        what = f"{', '.join(wrong)} missing or of another type"
        raise _damaged(f"a point of the plan is damaged: {what}", where)
    return Point(**values)  # type: ignore[arg-type]


PLAN_NAME = "plan.json"
SCHEMA = "hdbench/calibration-plan/1"


def write_points(folder: Path, points: tuple[Point, ...], preset: str) -> Path:
    """Write the sequence into a run folder."""
    body: dict[str, Any] = {
        "schema": SCHEMA,
        "preset": preset,
        "points": [asdict(point) for point in points],
    }
    write_json(folder / PLAN_NAME, body)
    return folder / PLAN_NAME


def read_points(folder: Path) -> tuple[Point, ...]:
    """Read the sequence of a stored run."""
    path = folder / PLAN_NAME
    if not path.is_file():
        raise DataError(
            f"no {PLAN_NAME}: the sequence of this calibration is not known",
            where=str(folder),
            fix="start the calibration anew; what was read is kept in this run",
        )
    listed = read_json(path, SCHEMA).get("points")
    if not isinstance(listed, list) or not listed:
        raise _damaged("no points; needed: the sequence of the calibration", str(path))
    points = tuple(
        point_from_dict(body, f"{path}: point {place}") for place, body in enumerate(listed, 1)
    )
    if [point.number for point in points] != list(range(1, len(points) + 1)):
        raise _damaged("the points are not numbered in order", str(path))
    return points
