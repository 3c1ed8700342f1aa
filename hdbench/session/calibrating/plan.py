"""Sequence of a calibration: planned, and kept in its run folder for a resumed run."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

from pydantic import TypeAdapter, ValidationError

from hdbench.errors import DataError
from hdbench.profile.calibrating import Arm, CalibrationPlan
from hdbench.profile.schema import ProfileData
from hdbench.records.jsonfile import read_json, write_json
from hdbench.session.plans import PLAN_NAME, Lock, Place, Plan, Point, Role, Step

Preset = Literal["report", "cg14"]

# Estimates for the printed duration only, from the weights' size: taking one or two pieces of up to
# 5 kg off a shelf, hanging and steadying them; unlocking, turning the flexspline, locking again.
HANDLING_S = 20.0
MOUNTING_S = 180.0

# share of the largest load that each step of cg14 has where the profile names no masses
_SHARES = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)


def calibration_plan(profile: ProfileData, preset: Preset | None = None) -> Plan:
    """Plan a calibration: what is asked for, in order, and how long it takes."""
    chosen = preset or profile.calibration.preset
    return sequence_plan(calibration_points(profile, chosen), profile, chosen)


def sequence_plan(points: Sequence[Point], profile: ProfileData, preset: str | None = None) -> Plan:
    """Return the plan of a sequence: its points with the steps between them."""
    steps: list[Step] = [Lock(locked=True)]
    position_rad: float | None = None
    for point in points:
        if point.position_rad != position_rad:
            position_rad = point.position_rad
            steps.append(Place(position_rad, point.position_index, point.position_count))
        steps.append(point)
    average_s = profile.calibration.average_s
    bench_s = sum(max(2.0 * average_s, point.read_after_s) for point in points)
    mountings = len({point.mounting for point in points})
    person_s = HANDLING_S * len(points) + MOUNTING_S * mountings
    return Plan("calibration", tuple(steps), bench_s, preset=preset, handling_s=person_s)


def calibration_points(profile: ProfileData, preset: Preset | None = None) -> tuple[Point, ...]:
    """Return every point of a calibration, in order."""
    plan = profile.calibration
    cg14 = (preset or plan.preset) == "cg14"
    positions = plan.cg14.positions if cg14 else plan.positions
    sequence = [
        *_checks(profile, positions),
        *(_cg14(profile, plan) if cg14 else _report(profile, plan)),
    ]
    return tuple(replace(point, number=number) for number, point in enumerate(sequence, start=1))


def _checks(profile: ProfileData, positions: int) -> Iterator[Point]:
    plan = profile.calibration
    loading = _Loading(profile.arm, 0, positions, plan.directions[0], "full")
    rest = loading.point("zero-check", "zero-check", "up", 0.0, 0.0, "bridge at rest")
    yield replace(rest, torque_nm=0.0)
    if plan.shunt is not None:
        yield replace(rest, role="shunt", experiment="shunt", label="shunt check", torque_nm=0.0)


def _report(profile: ProfileData, plan: CalibrationPlan) -> Iterator[Point]:
    for index in range(plan.positions):
        for direction in plan.directions:
            for load_range in plan.ranges:
                masses = plan.low_masses_kg if load_range == "low" else plan.full_masses_kg
                loading = _Loading(profile.arm, index, plan.positions, direction, load_range)
                yield from loading.series(f"p{index + 1}-{direction}-{load_range}", masses)


def _cg14(profile: ProfileData, plan: CalibrationPlan) -> Iterator[Point]:
    steps = plan.cg14
    top = max(plan.full_masses_kg)
    masses = steps.masses_kg or tuple(share * top for share in _SHARES)
    first = True
    for direction in plan.directions:
        for index in range(steps.positions):
            loading = _Loading(
                profile.arm, index, steps.positions, direction, "full", steps.read_after_s
            )
            name = f"p{index + 1}-{direction}-full"
            preloads = steps.preloads_first if first else steps.preloads_remounted
            first = False
            yield from loading.preloads(name, max(masses), preloads, steps.preload_s)
            yield from loading.series(name, masses)
            for repeat in range(steps.repeat_series if index == 0 else 0):
                again = loading.series(f"{name}-r{repeat + 2}", masses)
                yield from (replace(point, repeat=repeat + 1) for point in again)


@dataclass(frozen=True, slots=True)
class _Loading:
    """Points at one position, in one direction, over one range."""

    arm: Arm
    index: int
    count: int
    direction: str
    range: str
    read_after_s: float = 0.0

    def series(self, name: str, masses: Sequence[float]) -> Iterator[Point]:
        """Yield one loading and unloading that begins and ends without weight."""
        up = sorted({0.0, *masses})
        loads = [("up", mass) for mass in up] + [("down", mass) for mass in reversed(up[:-1])]
        step_kg = min(b - a for a, b in pairwise(up))
        for number, (series, mass) in enumerate(loads, start=1):
            label = f"{name} {number} of {len(loads)} ({series})"
            yield self.point("reading", name, series, mass, step_kg, label)

    def preloads(self, name: str, mass: float, count: int, hold_s: float) -> Iterator[Point]:
        """Yield loadings to the heaviest mass and back."""
        for number in range(1, count + 1):
            for series, load in (("up", mass), ("down", 0.0)):
                label = f"{name} preload {number} of {count}" + ("" if load else ", released")
                point = self.point("preload", name, series, load, mass, label)
                yield replace(point, read_after_s=hold_s)

    def point(
        self, role: Role, name: str, series: str, mass: float, step_kg: float, label: str
    ) -> Point:
        lever_nm_per_kg = self.arm.gravity_m_s2 * self.arm.length_m
        hung_kg = mass + (self.arm.tare_kg if mass else 0.0)
        sign = 1.0 if self.direction == "cw" else -1.0
        return Point(
            number=0,
            role=role,
            experiment=name,
            position_rad=2.0 * math.pi * self.index / self.count,
            range=self.range,
            direction=self.direction,
            series=series,
            mass_kg=mass,
            torque_nm=sign * lever_nm_per_kg * hung_kg,
            step_nm=lever_nm_per_kg * step_kg,
            read_after_s=self.read_after_s,
            label=label,
            position_index=self.index + 1,
            position_count=self.count,
        )


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
