"""A drawing in millimetres: lines, circles, closed outlines, text."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

__all__ = ["Circle", "Drawing", "Line", "Outline", "Point", "Text", "along"]

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Line:
    """A straight stroke.

    Parameters
    ----------
    start, end : tuple of float
        Its ends, mm from the lower left corner of the sheet, y upwards.
    """

    start: Point
    end: Point


@dataclass(frozen=True, slots=True)
class Circle:
    """A circle.

    Parameters
    ----------
    centre : tuple of float
        Its centre, mm.
    radius_mm : float
        Its radius, mm.
    """

    centre: Point
    radius_mm: float


@dataclass(frozen=True, slots=True)
class Outline:
    """A closed polygon.

    Parameters
    ----------
    corners : tuple of tuple of float
        At least three points, mm.
    """

    corners: tuple[Point, ...]


@dataclass(frozen=True, slots=True)
class Text:
    """One line of text.

    Parameters
    ----------
    at : tuple of float
        Start, middle or end of its base line, mm.
    words : str
        The text, Latin-1.
    size_pt : float
        Type size, point.
    align : {"start", "middle", "end"}
        Which part of the text is at `at`.
    """

    at: Point
    words: str
    size_pt: float
    align: Literal["start", "middle", "end"] = "start"


@dataclass(frozen=True, slots=True)
class Drawing:
    """Everything on one sheet.

    Parameters
    ----------
    title : str
        Title of the document.
    width_mm, height_mm : float
        The sheet.
    line_mm : float
        Width of every stroke, mm.
    strokes : tuple of Line, Circle or Outline
        What is drawn.
    texts : tuple of Text
        What is written.
    origin : tuple of float
        Where a file format of few digits counts from, mm: the middle of what has to be exact.
    """

    title: str
    width_mm: float
    height_mm: float
    line_mm: float
    strokes: tuple[Line | Circle | Outline, ...]
    texts: tuple[Text, ...]
    origin: Point = (0.0, 0.0)


def along(centre: Point, angle_rad: float, distance_mm: float, aside_mm: float = 0.0) -> Point:
    """Return a point seen from a centre."""
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return (
        centre[0] + distance_mm * cosine - aside_mm * sine,
        centre[1] + distance_mm * sine + aside_mm * cosine,
    )
