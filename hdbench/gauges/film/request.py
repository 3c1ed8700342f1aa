"""Request for a placement film, checked before anything is drawn."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

from hdbench.errors import UsageError
from hdbench.gauges.layout import LAYOUTS, GridGeometry, Layout

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

    Parameters
    ----------
    diameter_mm : float
        Flexspline diameter, mm.
    boss_mm : float
        Diameter of the boss or of the ring of screws that the gauges must stay clear of, mm.
    geometry : GridGeometry
        Radius of the rosettes and distance of their two grids, mm.
    pad_mm : tuple of float
        Rosette pad: along the circumference, along the radius, mm.
    grid_mm : tuple of float
        Measuring grid: along its wires, across them, mm.
    layout : Layout
        The rosettes.
    sheet : str
        A key of `SHEETS`.
    mirror : bool
        True: as seen from the diaphragm, for gauges laid on the printed side.
    line_mm : float
        Line width, mm.
    bench : str
        Name of the bench, printed on the sheet.

    Raises
    ------
    UsageError
        If a size is out of its domain, or the parts do not fit on each other or on the sheet; all
        problems at once.
    """

    diameter_mm: float
    boss_mm: float
    geometry: GridGeometry
    pad_mm: tuple[float, float]
    grid_mm: tuple[float, float]
    layout: Layout = field(default_factory=lambda: LAYOUTS["four"])
    sheet: str = "a4"
    mirror: bool = False
    line_mm: float = 0.05
    bench: str = ""

    def __post_init__(self) -> None:
        problems = list(self._sizes()) or list(self._fits())
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

    def _sizes(self) -> Iterator[UsageError]:
        if self.sheet not in SHEETS:
            yield _bad("--sheet", f"sheet {self.sheet!r:.30}", f"one of {', '.join(SHEETS)}")
        for where, value, least, most in (
            ("--diameter", self.diameter_mm, 10.0, 400.0),
            ("--boss", self.boss_mm, 0.0, 400.0),
            ("--pad-width", self.pad_mm[0], 0.5, 100.0),
            ("--pad-length", self.pad_mm[1], 0.5, 100.0),
            ("--grid-length", self.grid_mm[0], 0.5, 50.0),
            ("--grid-width", self.grid_mm[1], 0.1, 50.0),
            ("--line", self.line_mm, 0.01, 0.5),
        ):
            if not least <= value <= most:
                yield _bad(where, f"{value:g} mm", f"{least:g} to {most:g} mm")

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
