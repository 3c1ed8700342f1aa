"""The film as a drawing: rim, radii, rosettes, grids, degree scale, targets, bars, small print."""

from __future__ import annotations

import math

from hdbench.gauges.film.drawing import Circle, Drawing, Line, Outline, Point, Text, along
from hdbench.gauges.film.request import BAR_MM, MARGIN_MM, SHEETS, FilmRequest
from hdbench.gauges.film.words import small_print, title
from hdbench.gauges.layout import Rosette

__all__ = ["compose"]

_TOP_RAD = 0.5 * math.pi
Stroke = Line | Circle | Outline


def compose(request: FilmRequest) -> Drawing:
    """Return the drawing of a film."""
    width, height = SHEETS[request.sheet]
    strokes: list[Stroke] = [*_rings(request), *_degree_scale(request), *_targets(request)]
    texts: list[Text] = [*_degree_labels(request)]
    for rosette in request.layout.rosettes:
        strokes += _rosette(request, rosette)
        texts += _rosette_labels(request, rosette)
    bars, labels = _bars(request)
    return Drawing(
        title(request),
        width,
        height,
        request.line_mm,
        (*strokes, *bars),
        (*texts, *labels, *_page_text(request)),
        request.centre,
    )


def _turn(request: FilmRequest, angle_rad: float) -> float:
    """Return the direction on the sheet of an angle on the diaphragm."""
    return _TOP_RAD - angle_rad if request.mirror else _TOP_RAD + angle_rad


def _rings(request: FilmRequest) -> list[Stroke]:
    centre, geometry = request.centre, request.geometry
    half = 0.5 * geometry.spacing_mm
    radii = {0.5 * request.diameter_mm, 0.5 * request.boss_mm, geometry.radius_mm}
    radii |= {geometry.radius_mm - half, geometry.radius_mm + half}
    rings: list[Stroke] = [Circle(centre, radius) for radius in sorted(radii) if radius > 0.0]
    # centre mark: a cross of 4 mm
    return [*rings, *_cross(centre, 2.0)]


def _cross(at: Point, reach_mm: float) -> list[Stroke]:
    x, y = at
    return [
        Line((x - reach_mm, y), (x + reach_mm, y)),
        Line((x, y - reach_mm), (x, y + reach_mm)),
    ]


def _degree_scale(request: FilmRequest) -> list[Stroke]:
    """Return one tick per degree outside the rim, and the index mark across it."""
    rim = 0.5 * request.diameter_mm
    ticks: list[Stroke] = []
    for degree in range(360):
        length = 3.0 if degree % 10 == 0 else 2.0 if degree % 5 == 0 else 1.2
        direction = _turn(request, math.radians(degree))
        ticks.append(_ray(request.centre, direction, rim + 0.3, rim + 0.3 + length))
    tip = along(request.centre, _TOP_RAD, rim)
    left = along(request.centre, _TOP_RAD, rim - 2.0, 0.9)
    right = along(request.centre, _TOP_RAD, rim - 2.0, -0.9)
    return [*ticks, Outline((tip, left, right))]


def _ray(centre: Point, direction: float, start_mm: float, end_mm: float) -> Line:
    return Line(along(centre, direction, start_mm), along(centre, direction, end_mm))


def _degree_labels(request: FilmRequest) -> list[Text]:
    at = 0.5 * request.diameter_mm + 5.2
    labels = []
    for degree in range(0, 360, 30):
        x, y = along(request.centre, _turn(request, math.radians(degree)), at)
        words = "0 index" if degree == 0 else f"{degree}"
        labels.append(Text((x, y - 0.6), words, 4.5, "middle"))
    return labels


def _targets(request: FilmRequest) -> list[Stroke]:
    """Return four registration targets at the corners of a square about the diaphragm."""
    reach = request.target_mm
    marks: list[Stroke] = []
    for sx in (-1.0, 1.0):
        for sy in (-1.0, 1.0):
            at = (request.centre[0] + sx * reach, request.centre[1] + sy * reach)
            marks += [*_cross(at, 3.0), Circle(at, 1.5)]
    return marks


def _rosette(request: FilmRequest, rosette: Rosette) -> list[Stroke]:
    radius = request.geometry.radius_mm
    direction = _turn(request, math.radians(rosette.angle_deg))
    centre = request.centre
    across, length = 0.5 * request.pad_mm[0], 0.5 * request.pad_mm[1]
    middle = along(centre, direction, radius)
    boss, rim = 0.5 * request.boss_mm, 0.5 * request.diameter_mm
    return [
        _ray(centre, direction, boss, rim),
        Line(along(middle, direction, 0.0, across + 2.0), along(middle, direction, 0.0, across)),
        Line(along(middle, direction, 0.0, -across), along(middle, direction, 0.0, -across - 2.0)),
        _box(middle, direction, length, across),
        *_grids(request, rosette, direction),
    ]


def _box(middle: Point, direction: float, along_mm: float, across_mm: float) -> Outline:
    """Return a rectangle by its half lengths."""
    return Outline(
        tuple(
            along(middle, direction, a * along_mm, b * across_mm)
            for a, b in ((1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0))
        )
    )


def _grid_radii(request: FilmRequest, rosette: Rosette) -> tuple[float, float]:
    """Return the radii of the odd and the even grid, mm."""
    half = 0.5 * request.geometry.spacing_mm
    inner, outer = request.geometry.radius_mm - half, request.geometry.radius_mm + half
    return (outer, inner) if rosette.reverse else (inner, outer)


def _grids(request: FilmRequest, rosette: Rosette, direction: float) -> list[Stroke]:
    """Return both grids with their axes: odd at +45, even at -45 degrees to the radius."""
    strokes: list[Stroke] = []
    half_length, half_width = 0.5 * request.grid_mm[0], 0.5 * request.grid_mm[1]
    hand = -1.0 if request.mirror else 1.0
    for radius, turn in zip(_grid_radii(request, rosette), (0.25, -0.25), strict=True):
        middle = along(request.centre, direction, radius)
        axis = direction + hand * turn * math.pi
        strokes += [
            _box(middle, axis, half_length, half_width),
            # the axis stands out 0.4 mm beyond the grid on both sides
            _ray(middle, axis, -half_length - 0.4, half_length + 0.4),
        ]
    return strokes


def _rosette_labels(request: FilmRequest, rosette: Rosette) -> list[Text]:
    direction = _turn(request, math.radians(rosette.angle_deg))
    aside = 0.5 * request.pad_mm[0] + 2.6
    labels = []
    for number, radius in zip(rosette.gauges, _grid_radii(request, rosette), strict=True):
        x, y = along(request.centre, direction, radius, -aside)
        labels.append(Text((x, y - 0.5), f"R{number}", 4.0, "middle"))
    return labels


def _bars(request: FilmRequest) -> tuple[list[Stroke], list[Text]]:
    """Return a horizontal and a vertical bar of 100 mm with a tick per 10 mm."""
    x, y = request.centre[0], request.centre[1] - request.target_mm - 12.0
    left, right = x - 0.5 * BAR_MM, x + 0.5 * BAR_MM
    upright = left - 15.0
    # downwards from the same height, beside the small print
    low = y - BAR_MM
    bars: list[Stroke] = [Line((left, y), (right, y)), Line((upright, low), (upright, y))]
    for step in range(11):
        at = 10.0 * step
        long = 3.0 if step % 5 == 0 else 1.8
        bars.append(Line((left + at, y), (left + at, y + long)))
        bars.append(Line((upright, low + at), (upright - long, low + at)))
    labels = [
        Text((x, y + 4.0), "100.0 mm: measure it", 7.0, "middle"),
        Text((upright - 4.0, y + 2.5), "100.0 mm", 7.0, "start"),
    ]
    return bars, labels


def _page_text(request: FilmRequest) -> list[Text]:
    height = SHEETS[request.sheet][1]
    top = height - MARGIN_MM - 4.0
    head = title(request), *small_print(request)[:1]
    texts = [
        Text((MARGIN_MM + 4.0, top), head[0], 11.0),
        Text((MARGIN_MM + 4.0, top - 5.0), head[1], 7.5),
    ]
    left = request.centre[0] - 0.5 * BAR_MM
    y = request.centre[1] - request.target_mm - 20.0
    for index, words in enumerate(small_print(request)[1:]):
        texts.append(Text((left, y - 4.0 * index), words, 7.0))
    return texts
