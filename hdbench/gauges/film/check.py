"""Measure a film that was read back, and compare with what was asked for."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

from hdbench.errors import HdbenchError
from hdbench.gauges.film.drawing import Line, Point
from hdbench.gauges.film.readback import Shapes
from hdbench.gauges.film.request import BAR_MM, SHEETS, FilmRequest

__all__ = ["TOLERANCE_MM", "Dimension", "check_film"]

# a tenth of what a microscope stage is set to; laser printers place to 0.04 mm at best
TOLERANCE_MM = 0.01


@dataclass(frozen=True, slots=True)
class Dimension:
    """One size of a film.

    Parameters
    ----------
    name : str
        What was measured.
    asked_mm, found_mm : float
        What it should be and what the file holds, mm.
    """

    name: str
    asked_mm: float
    found_mm: float

    @property
    def error_mm(self) -> float:
        """Found less asked, mm."""
        return self.found_mm - self.asked_mm

    def to_dict(self) -> dict[str, object]:
        """Return the dimension as ``--json`` prints it."""
        return {**asdict(self), "error_mm": self.error_mm}


def check_film(shapes: Shapes, request: FilmRequest, name: str) -> tuple[Dimension, ...]:
    """Measure a film and refuse it where a size is off."""
    measured = tuple(_measure(shapes, request))
    wrong = [d for d in measured if not abs(d.error_mm) <= TOLERANCE_MM]
    if wrong:
        worst = max(wrong, key=lambda d: abs(d.error_mm))
        raise HdbenchError(
            f"read back, {len(wrong)} of {len(measured)} sizes are off by more than "
            f"{TOLERANCE_MM} mm; worst: {worst.name} is {worst.found_mm:.4f} mm, asked for "
            f"{worst.asked_mm:.4f} mm",
            where=name,
            fix="this is a bug: nothing was written; send us the command and its sizes",
        )
    return measured


def _measure(shapes: Shapes, request: FilmRequest) -> Iterator[Dimension]:
    width, height = SHEETS[request.sheet]
    yield Dimension("sheet width", width, shapes.width_mm)
    yield Dimension("sheet height", height, shapes.height_mm)
    yield from _bars(shapes)
    centre = _middle(shapes, request)
    yield from _rings(shapes, request, centre)
    yield from _targets(shapes, centre, request)
    boxes = [o.corners for o in shapes.outlines if len(o.corners) == 4]
    for rosette in request.layout.rosettes:
        # seen from outside, angles go counter-clockwise from the top; mirrored, clockwise
        hand = -1.0 if request.mirror else 1.0
        angle = 0.5 * math.pi + hand * math.radians(rosette.angle_deg)
        radius, half = request.geometry.radius_mm, 0.5 * request.geometry.spacing_mm
        place = _Place(f"rosette {rosette.number} pad", radius, angle, 0.0)
        yield from _box(boxes, centre, place, (request.pad_mm[1], request.pad_mm[0]))
        odd_outside = 1.0 if rosette.reverse else -1.0
        for number, side, turn in (
            (rosette.gauges[0], odd_outside, 0.25 * math.pi),
            (rosette.gauges[1], -odd_outside, -0.25 * math.pi),
        ):
            place = _Place(f"grid R{number}", radius + side * half, angle, hand * turn)
            yield from _box(boxes, centre, place, request.grid_mm)


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a rectangle should be: its centre in polar form and its turn against the radius."""

    name: str
    radius_mm: float
    angle_rad: float
    turn_rad: float


def _longest(lines: Sequence[Line], axis: int) -> float:
    straight = (ln for ln in lines if abs(ln.start[1 - axis] - ln.end[1 - axis]) < TOLERANCE_MM)
    return max((abs(ln.end[axis] - ln.start[axis]) for ln in straight), default=math.nan)


def _bars(shapes: Shapes) -> Iterator[Dimension]:
    yield Dimension("scale bar across", BAR_MM, _longest(shapes.lines, 0))
    yield Dimension("scale bar upright", BAR_MM, _longest(shapes.lines, 1))


def _middle(shapes: Shapes, request: FilmRequest) -> Point:
    """Return the centre of the ring whose diameter is nearest to the flexspline's."""
    if not shapes.circles:
        return math.nan, math.nan
    ring = min(shapes.circles, key=lambda c: abs(2.0 * c.radius_mm - request.diameter_mm))
    return ring.centre


def _rings(shapes: Shapes, request: FilmRequest, centre: Point) -> Iterator[Dimension]:
    found = [c.radius_mm for c in shapes.circles if math.dist(c.centre, centre) < TOLERANCE_MM]
    half = 0.5 * request.geometry.spacing_mm
    for name, radius in (
        ("flexspline", 0.5 * request.diameter_mm),
        ("boss", 0.5 * request.boss_mm),
        ("rosette", request.geometry.radius_mm),
        ("inner grid", request.geometry.radius_mm - half),
        ("outer grid", request.geometry.radius_mm + half),
    ):
        if radius > 0.0:
            nearest = min(found, key=lambda r: abs(r - radius), default=math.nan)
            yield Dimension(f"{name} ring, diameter", 2.0 * radius, 2.0 * nearest)


def _targets(shapes: Shapes, centre: Point, request: FilmRequest) -> Iterator[Dimension]:
    marks = [c.centre for c in shapes.circles if math.dist(c.centre, centre) > TOLERANCE_MM]
    for axis, name in ((0, "across"), (1, "upright")):
        places = [mark[axis] for mark in marks]
        span = max(places, default=math.nan) - min(places, default=math.nan)
        yield Dimension(f"targets {name}", 2.0 * request.target_mm, span)


def _box(
    boxes: Sequence[tuple[Point, ...]], centre: Point, place: _Place, size: tuple[float, float]
) -> tuple[Dimension, ...]:
    """Measure the rectangle that fits a place best, in position, size and turn."""
    corners: tuple[Point, ...] = ((math.nan, math.nan),) * 4
    measured = [_measured(box, centre, place, size) for box in boxes]
    missing = _measured(corners, centre, place, size)
    return min(measured, key=lambda found: sum(abs(d.error_mm) for d in found), default=missing)


def _measured(
    corners: Sequence[Point], centre: Point, place: _Place, size: tuple[float, float]
) -> tuple[Dimension, ...]:
    x = centre[0] + place.radius_mm * math.cos(place.angle_rad)
    y = centre[1] + place.radius_mm * math.sin(place.angle_rad)
    middle = _mean(corners)
    lengths, turn = _sides(corners, place.angle_rad + place.turn_rad)
    return (
        Dimension(f"{place.name}, radius", place.radius_mm, math.dist(middle, centre)),
        Dimension(f"{place.name}, off its place", 0.0, math.dist(middle, (x, y))),
        Dimension(f"{place.name}, length", size[0], lengths[0]),
        Dimension(f"{place.name}, width", size[1], lengths[1]),
        Dimension(f"{place.name}, turned", 0.0, place.radius_mm * math.sin(turn)),
    )


def _mean(points: Sequence[Point]) -> Point:
    return sum(p[0] for p in points) / len(points), sum(p[1] for p in points) / len(points)


def _sides(corners: Sequence[Point], axis_rad: float) -> tuple[tuple[float, float], float]:
    """Return the sides nearest to an axis and across it, and the turn against that axis, rad."""
    sides = [(corners[i], corners[(i + 1) % 4]) for i in range(2)]
    turns = [
        math.remainder(math.atan2(b[1] - a[1], b[0] - a[0]) - axis_rad, math.pi) for a, b in sides
    ]
    first = 0 if abs(turns[0]) <= abs(turns[1]) else 1
    lengths = [math.dist(a, b) for a, b in sides]
    return (lengths[first], lengths[1 - first]), turns[first]
