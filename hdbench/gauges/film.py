"""Placement film of the rosettes: checked request, drawing at 1:1, PDF and SVG."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any, Literal

from reportlab.graphics import renderPDF, renderSVG
from reportlab.graphics.shapes import Circle, Drawing, Line, Polygon, Shape, String
from reportlab.lib.colors import black
from reportlab.pdfgen.canvas import Canvas

from hdbench.errors import UsageError
from hdbench.gauges.layout import LAYOUTS, GridGeometry, Layout, Rosette
from hdbench.records.storage import disk_errors, write_atomic

SHEETS = {"a4": (210.0, 297.0), "letter": (215.9, 279.4), "a3": (297.0, 420.0)}
BAR_MM = 100.0
# laser printers leave up to 6 mm white at the edge
MARGIN_MM = 10.0
# from the rim to the centres of the registration targets, along x and y
TARGET_GAP_MM = 14.0
# head line, scale bar and small print above and below the drawing
_HEAD_MM, _FOOT_MM = 16.0, 92.0


@dataclass(frozen=True, slots=True)
class FilmRequest:
    """A film for the diaphragm of one flexspline.

    Raises
    ------
    UsageError
        If a size is out of its domain, or the parts do not fit on each other or on the sheet; all
        problems at once.
    """

    # flexspline diameter, mm
    diameter_mm: float
    # diameter of the boss or of the ring of screws that the gauges must stay clear of, mm
    boss_mm: float
    # radius of the rosettes and distance of their two grids, mm
    geometry: GridGeometry
    # rosette pad: along the circumference, along the radius, mm
    pad_mm: tuple[float, float]
    # measuring grid: along its wires, across them, mm
    grid_mm: tuple[float, float]
    # the rosettes
    layout: Layout = field(default_factory=lambda: LAYOUTS["four"])
    # A key of `SHEETS`
    sheet: str = "a4"
    # true: as seen from the diaphragm, for gauges laid on the printed side
    mirror: bool = False
    # line width, mm
    line_mm: float = 0.05
    # name of the bench, printed on the sheet
    bench: str = ""

    def __post_init__(self) -> None:
        problems = list(self._fits())
        if len(problems) == 1:
            raise problems[0]
        if problems:
            raise UsageError(
                f"{len(problems)} sizes do not fit",
                where="gauge film",
                fix="correct each of them",
                problems=tuple(problems),
            )

    @property
    def centre(self) -> tuple[float, float]:
        """Middle of the diaphragm on the sheet, mm from the lower left corner."""
        width, height = SHEETS[self.sheet]
        return 0.5 * width, height - MARGIN_MM - _HEAD_MM - 0.5 * self.diameter_mm - TARGET_GAP_MM

    @property
    def target_mm(self) -> float:
        """Distance from the middle to a registration target, along x and along y, mm."""
        return 0.5 * self.diameter_mm + TARGET_GAP_MM

    def _fits(self) -> Iterator[UsageError]:
        radius, (pad, length) = self.geometry.radius_mm, self.pad_mm
        inner, outer = radius - 0.5 * length, math.hypot(radius + 0.5 * length, 0.5 * pad)
        boss, rim = 0.5 * self.boss_mm, 0.5 * self.diameter_mm
        room = 2.0 * inner * math.tan(0.5 * _least_step_rad(self.layout))
        # a grid at 45 degrees needs this much along the radius and along the circumference
        side = (self.grid_mm[0] + self.grid_mm[1]) / math.sqrt(2.0)
        both = self.geometry.spacing_mm + side
        if not inner >= boss:
            yield _bad(
                "--radius",
                f"pads reach in to {inner:.2f} mm from the axis",
                f"outside the boss, at least {boss:.2f} mm",
                "take a larger --radius, a shorter --pad-length or the true --boss",
            )
        for where, size, most, found, needed, fix in (
            ("--radius", outer, rim, f"corners of the pads are {outer:.2f} mm from the axis",
             "on the diaphragm, at most", "take a smaller --radius or pad"),
            ("--pad-width", pad, room, f"{pad:g} mm wide pads overlap at their inner ends",
             "at most", "take a larger --radius, a smaller pad or another --layout"),
            ("--grid-length", side, pad, f"a grid at 45 degrees is {side:.2f} mm wide",
             "at most the pad's", "correct this size"),
            ("--grid-spacing", both, length, f"both grids together are {both:.2f} mm long",
             "at most the pad's", "correct this size"),
        ):  # fmt: skip
            if not size <= most:
                yield _bad(where, found, f"{needed} {most:.2f} mm", fix)
        width, height = SHEETS[self.sheet]
        span = self.diameter_mm + 2.0 * (TARGET_GAP_MM + 4.0)
        wide = max(span, BAR_MM) + 2.0 * MARGIN_MM
        tall = span + _HEAD_MM + _FOOT_MM + 2.0 * MARGIN_MM
        if not (wide <= width and tall <= height):
            larger = [k for k, (w, h) in SHEETS.items() if wide <= w and tall <= h]
            fix = "no sheet is large enough: check --diameter"
            yield _bad(
                "--sheet",
                f"the drawing is {wide:.0f} x {tall:.0f} mm",
                f"at most {width:g} x {height:g} mm ({self.sheet})",
                f"take --sheet {larger[0]}" if larger else fix,
            )


def _bad(where: str, found: str, needed: str, fix: str = "correct this size") -> UsageError:
    return UsageError(f"{found}; needed: {needed}", where=where, fix=fix)


def _least_step_rad(layout: Layout) -> float:
    """Return the smallest angle between neighbouring rosettes, rad."""
    turns = sorted(angle % (2.0 * math.pi) for angle in layout.angles_rad)
    gaps = [b - a for a, b in zip(turns, (*turns[1:], turns[0] + 2.0 * math.pi), strict=True)]
    return min(*gaps, 0.75 * math.pi)


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


@dataclass(frozen=True, slots=True)
class Film:
    """A film that was written."""

    # its head line
    title: str
    # the files
    pdf: Path
    svg: Path
    # sizes to check on the printed film, mm
    sizes_mm: dict[str, float]

    def to_dict(self) -> dict[str, Any]:
        """Return the film as ``--json`` prints it."""
        files = {"pdf": str(self.pdf), "svg": str(self.svg)}
        return {"title": self.title, "files": files, "sizes_mm": self.sizes_mm}


def write_film(request: FilmRequest, out: Path) -> Film:
    """Write a film as PDF and SVG.

    Parameters
    ----------
    request : FilmRequest
        What to show.
    out : Path
        The PDF file; the SVG goes beside it under the same name.

    Returns
    -------
    Film
        The files and the sizes to check on paper.

    Raises
    ------
    UsageError
        If `out` is not a name that ends in ``.pdf``.
    StorageError
        If a file cannot be written.
    """
    if out.suffix.lower() != ".pdf":
        raise UsageError(
            f"{out.name!r} does not end in .pdf", where="--out", fix="name it such as film.pdf"
        )
    other = out.with_suffix(".svg")
    with disk_errors(out):
        out.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(out, _as_pdf(request))
    write_atomic(other, _as_svg(request))
    sizes = {
        "flexspline ring, diameter": request.diameter_mm,
        "boss ring, diameter": request.boss_mm,
        "rosette ring, diameter": 2.0 * request.geometry.radius_mm,
        "scale bar across": BAR_MM,
        "scale bar upright": BAR_MM,
        "targets across": 2.0 * request.target_mm,
        "targets upright": 2.0 * request.target_mm,
    }
    return Film(film_title(request), out, other, sizes)


def _as_pdf(request: FilmRequest) -> bytes:
    """Return a page of the sheet's size, vectors only, that asks to be printed at 1:1."""
    drawing, buffer = draw_film(request), io.BytesIO()
    size = (drawing.width / UNITS_PER_POINT, drawing.height / UNITS_PER_POINT)
    page = Canvas(buffer, pagesize=size, pageCompression=1, invariant=1)
    page.setTitle(film_title(request))
    page.setCreator("hdbench")
    page.setViewerPreference("PrintScaling", "None")
    page.scale(1.0 / UNITS_PER_POINT, 1.0 / UNITS_PER_POINT)
    renderPDF.draw(drawing, page, 0, 0)
    page.save()
    return buffer.getvalue()


def _as_svg(request: FilmRequest) -> bytes:
    """Return a picture of the sheet's size in mm."""
    drawing, (width, height) = draw_film(request), SHEETS[request.sheet]
    box = f"0 0 {drawing.width:.6f} {drawing.height:.6f}"
    sizes = {"width": f"{width}mm", "height": f"{height}mm", "viewBox": box}
    text: str = renderSVG.drawToString(drawing, svgAttrs=sizes)
    title = escape(film_title(request))
    return text.replace("<title>...</title>", f"<title>{title}</title>").encode()
