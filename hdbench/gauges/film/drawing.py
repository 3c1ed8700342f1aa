"""The film as a drawing: rim, radii, rosettes, grids, degree scale, targets, bars, small print."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any, Literal

from reportlab.graphics.shapes import Circle, Drawing, Line, Polygon, Shape, String
from reportlab.lib.colors import black

from hdbench.gauges.film.request import BAR_MM, MARGIN_MM, SHEETS, FilmRequest
from hdbench.gauges.layout import Rosette

Point = tuple[float, float]
_TOP_RAD = 0.5 * math.pi
# reportlab's writer of SVG rounds some places to whole units: a hundredth of a point is fine enough
UNITS_PER_POINT = 100.0
_UNITS_PER_MM = UNITS_PER_POINT * 72.0 / 25.4


def draw_film(request: FilmRequest) -> Drawing:
    """Return the drawing of a film; a unit is 0.01 point, the origin the lower left corner."""
    sheet = _Sheet(request)
    shapes = [*sheet.rings(), *sheet.degree_scale(), *sheet.targets(), *sheet.bars()]
    for rosette in request.layout.rosettes:
        shapes += sheet.rosette(rosette)
    width, height = _units(SHEETS[request.sheet])
    return Drawing(width, height, *shapes, *sheet.page_text())


def film_title(request: FilmRequest) -> str:
    """Return the head line."""
    count = len(request.layout.rosettes)
    return f"Gauge placement film, {request.diameter_mm:g} mm flexspline, {count} rosettes"


def _units(*sizes_mm: Iterable[float]) -> list[float]:
    return [_UNITS_PER_MM * size for sizes in sizes_mm for size in sizes]


def _along(centre: Point, angle_rad: float, distance_mm: float, aside_mm: float = 0.0) -> Point:
    """Return a point seen from a centre."""
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return (
        centre[0] + distance_mm * cosine - aside_mm * sine,
        centre[1] + distance_mm * sine + aside_mm * cosine,
    )


class _Sheet:
    """Parts of a film in millimetres."""

    def __init__(self, request: FilmRequest) -> None:
        self._asked, self._centre = request, request.centre
        (self._width,) = _units((request.line_mm,))
        self._pen: Any = {"strokeColor": black, "strokeWidth": self._width, "fillColor": None}
        self._rim, self._boss = 0.5 * request.diameter_mm, 0.5 * request.boss_mm
        # mirrored, angles go clockwise
        self._hand = -1.0 if request.mirror else 1.0
        half = 0.5 * request.geometry.spacing_mm
        self._radius = request.geometry.radius_mm
        self._inner, self._outer = self._radius - half, self._radius + half

    def _line(self, start: Point, end: Point) -> Shape:
        return Line(*_units(start, end), strokeColor=black, strokeWidth=self._width)

    def _circle(self, centre: Point, radius_mm: float) -> Shape:
        return Circle(*_units(centre), *_units((radius_mm,)), **self._pen)

    def _outline(self, *corners: Point) -> Shape:
        return Polygon(_units(*corners), **self._pen)

    def _text(
        self, at: Point, words: str, size_pt: float, align: Literal["start", "middle"] = "start"
    ) -> Shape:
        size = UNITS_PER_POINT * size_pt
        x, y = _units(at)
        return String(x, y, words, fontName="Helvetica", fontSize=size, textAnchor=align)

    def _ray(self, centre: Point, direction: float, start_mm: float, end_mm: float) -> Shape:
        return self._line(_along(centre, direction, start_mm), _along(centre, direction, end_mm))

    def _cross(self, at: Point, reach_mm: float) -> Iterator[Shape]:
        x, y = at
        yield self._line((x - reach_mm, y), (x + reach_mm, y))
        yield self._line((x, y - reach_mm), (x, y + reach_mm))

    def _box(self, middle: Point, direction: float, along_mm: float, across_mm: float) -> Shape:
        """Return a rectangle by its half lengths."""
        signs = ((1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0))
        corners = (_along(middle, direction, a * along_mm, b * across_mm) for a, b in signs)
        return self._outline(*corners)

    def rings(self) -> Iterator[Shape]:
        """Yield rim, boss, the rings of rosettes and grids, and a centre mark of 4 mm."""
        for radius in sorted({self._rim, self._boss, self._radius, self._inner, self._outer}):
            if radius > 0.0:
                yield self._circle(self._centre, radius)
        yield from self._cross(self._centre, 2.0)

    def degree_scale(self) -> Iterator[Shape]:
        """Yield one tick per degree outside the rim, their labels, and the index mark."""
        for degree in range(360):
            direction = _TOP_RAD + self._hand * math.radians(degree)
            length = 3.0 if degree % 10 == 0 else 2.0 if degree % 5 == 0 else 1.2
            yield self._ray(self._centre, direction, self._rim + 0.3, self._rim + 0.3 + length)
            if degree % 30 == 0:
                x, y = _along(self._centre, direction, self._rim + 5.2)
                words = f"{degree}" if degree else "0 index"
                yield self._text((x, y - 0.6), words, 4.5, "middle")
        tip = _along(self._centre, _TOP_RAD, self._rim)
        feet = (_along(self._centre, _TOP_RAD, self._rim - 2.0, side) for side in (0.9, -0.9))
        yield self._outline(tip, *feet)

    def targets(self) -> Iterator[Shape]:
        """Yield four registration targets at the corners of a square about the diaphragm."""
        reach = self._asked.target_mm
        for x in (-reach, reach):
            for y in (-reach, reach):
                at = self._centre[0] + x, self._centre[1] + y
                yield from self._cross(at, 3.0)
                yield self._circle(at, 1.5)

    def rosette(self, rosette: Rosette) -> Iterator[Shape]:
        """Yield a pad on its radius with centre marks, and both grids with axes and names."""
        asked, centre = self._asked, self._centre
        direction = _TOP_RAD + self._hand * math.radians(rosette.angle_deg)
        across, length = 0.5 * asked.pad_mm[0], 0.5 * asked.pad_mm[1]
        middle = _along(centre, direction, self._radius)
        yield self._ray(centre, direction, self._boss, self._rim)
        for side in (1.0, -1.0):
            ends = (_along(middle, direction, 0.0, side * at) for at in (across, across + 2.0))
            yield self._line(*ends)
        yield self._box(middle, direction, length, across)
        half_length, half_width = 0.5 * asked.grid_mm[0], 0.5 * asked.grid_mm[1]
        radii = (self._inner, self._outer)
        # the odd grid lies at +45, the even one at -45 degrees to the radius
        for number, radius, turn in zip(
            rosette.gauges, radii[::-1] if rosette.reverse else radii, (0.25, -0.25), strict=True
        ):
            place = _along(centre, direction, radius)
            axis = direction + self._hand * turn * math.pi
            yield self._box(place, axis, half_length, half_width)
            # the axis stands out 0.4 mm beyond the grid on both sides
            yield self._ray(place, axis, -half_length - 0.4, half_length + 0.4)
            x, y = _along(centre, direction, radius, -across - 2.6)
            yield self._text((x, y - 0.5), f"R{number}", 4.0, "middle")

    def bars(self) -> Iterator[Shape]:
        """Yield a horizontal and a vertical bar of 100 mm with a tick per 10 mm."""
        x, y = self._centre[0], self._centre[1] - self._asked.target_mm - 12.0
        left, low = x - 0.5 * BAR_MM, y - BAR_MM
        # downwards from the same height, beside the small print
        upright = left - 15.0
        yield self._line((left, y), (left + BAR_MM, y))
        yield self._line((upright, low), (upright, y))
        for step in range(11):
            at, tick = 10.0 * step, 3.0 if step % 5 == 0 else 1.8
            yield self._line((left + at, y), (left + at, y + tick))
            yield self._line((upright, low + at), (upright - tick, low + at))
        yield self._text((x, y + 4.0), "100.0 mm: measure it", 7.0, "middle")
        yield self._text((upright - 4.0, y + 2.5), "100.0 mm", 7.0)

    def page_text(self) -> Iterator[Shape]:
        """Yield head line, sizes and instructions."""
        sizes, *steps = _small_print(self._asked)
        top = SHEETS[self._asked.sheet][1] - MARGIN_MM - 4.0
        yield self._text((MARGIN_MM + 4.0, top), film_title(self._asked), 11.0)
        yield self._text((MARGIN_MM + 4.0, top - 5.0), sizes, 7.5)
        left = self._centre[0] - 0.5 * BAR_MM
        y = self._centre[1] - self._asked.target_mm - 20.0
        for index, words in enumerate(steps):
            yield self._text((left, y - 4.0 * index), words, 7.0)


def _small_print(request: FilmRequest) -> tuple[str, ...]:
    """Return sizes and instructions, one line each."""
    geometry = request.geometry
    side = (
        "MIRRORED: gauges go on the PRINTED side, backs up; it then lies on the metal."
        if request.mirror
        else "Gauges go on the UNPRINTED side, backs up; this text reads right from outside."
    )
    reverse = [r for r in request.layout.rosettes if r.reverse]
    inner = ", ".join(f"R{r.gauges[r.reverse]}" for r in request.layout.rosettes)
    outer = ", ".join(f"R{r.gauges[not r.reverse]}" for r in request.layout.rosettes)
    turned = (
        f"; rosettes {', '.join(str(r.number) for r in reverse)} turned round" if reverse else ""
    )
    span = 2.0 * request.target_mm
    bench = f"{request.bench}: " if request.bench else ""
    return (
        f"{bench}boss {request.boss_mm:g}, rosettes on radius {geometry.radius_mm:g}, "
        f"grids {geometry.spacing_mm:g} apart, pad {request.pad_mm[0]:g} x {request.pad_mm[1]:g}, "
        f"grid {request.grid_mm[0]:g} x {request.grid_mm[1]:g} mm, lines {request.line_mm:g} mm",
        "1. Print at 100 % (actual size, no fit to page), finest resolution, on clear film.",
        "2. Measure BOTH bars. Use the film only if each is 100.0 mm within 0.1 mm.",
        f"    Targets are {span:.2f} mm apart along both edges: check their diagonals for skew.",
        f"3. {side}",
        "4. Under a microscope lay each pad on its outline; its centre marks on the radius and",
        "    on the short lines beside the pad. Grid axes are drawn through each grid.",
        f"    Inner grids: {inner}. Outer grids: {outer}{turned}.",
        "5. Scribe an index line on the flexspline. Lay the film on the clean, flat diaphragm:",
        "    outer ring on the rim, inner ring on the boss, 0 on the index line. Cement, press.",
        "6. Odd gauges lie at +45, even ones at -45 degrees to the radius (counter-clockwise, seen",
        "    from outside). If torque shows with the wrong sign, swap the two output wires.",
        "7. What a misplaced rosette does to gain, zero and ripple: hdbench gauge errors.",
    )
