"""The sequence of a calibration in its run folder: what a resumed run goes on with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hdbench.errors import DataError
from hdbench.records.jsonfile import read_json, write_json
from hdbench.session.calibrating.points import Point, point_from_dict

__all__ = ["PLAN_NAME", "SCHEMA", "read_points", "write_points"]

PLAN_NAME = "plan.json"
SCHEMA = "hdbench/calibration-plan/1"


def write_points(folder: Path, points: tuple[Point, ...], preset: str) -> Path:
    """Write the sequence into a run folder."""
    body: dict[str, Any] = {
        "schema": SCHEMA,
        "preset": preset,
        "points": [point.to_dict() for point in points],
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
        raise DataError(
            "no points; needed: the sequence of the calibration",
            where=str(path),
            fix="restore the file from a copy, or start the calibration anew",
        )
    points = tuple(
        point_from_dict(body, f"{path}: point {place}") for place, body in enumerate(listed, 1)
    )
    if [point.number for point in points] != list(range(1, len(points) + 1)):
        raise DataError(
            "the points are not numbered in order",
            where=str(path),
            fix="restore the file from a copy, or start the calibration anew",
        )
    return points
