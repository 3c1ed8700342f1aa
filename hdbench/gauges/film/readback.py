"""Read the shapes of a written film back, knowing nothing of how it was drawn."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

from hdbench.errors import HdbenchError
from hdbench.gauges.film.drawing import Circle, Line, Outline, Point

__all__ = ["Shapes", "read_pdf", "read_svg"]

_MM_PER_POINT = 25.4 / 72.0
_SVG = "{http://www.w3.org/2000/svg}"
_LENGTH = re.compile(r"([0-9.]+)mm")


@dataclass(frozen=True, slots=True)
class Shapes:
    """What a file shows, in millimetres from its lower left corner.

    Parameters
    ----------
    width_mm, height_mm : float
        The sheet.
    lines : tuple of Line
        Straight strokes.
    circles : tuple of Circle
        Circles.
    outlines : tuple of Outline
        Closed polygons.
    """

    width_mm: float
    height_mm: float
    lines: tuple[Line, ...]
    circles: tuple[Circle, ...]
    outlines: tuple[Outline, ...]


def _wrong(what: str) -> HdbenchError:
    return HdbenchError(
        f"the film read back is not what was drawn: {what}",
        where="gauge film",
        fix="this is a bug: nothing was written; send us the command and its sizes",
    )


def read_svg(content: bytes) -> Shapes:
    """Read the shapes of an SVG in millimetres."""
    root = ElementTree.fromstring(content)
    sizes = [_LENGTH.fullmatch(root.get(name, "")) for name in ("width", "height")]
    if not all(sizes):
        raise _wrong("the size of the SVG is not in mm")
    width, height = (float(size[1]) for size in sizes if size is not None)
    box = [float(number) for number in root.get("viewBox", "").split()]
    if box != [0.0, 0.0, width, height]:
        raise _wrong(f"the SVG shows {box} on {width} x {height} mm")

    def point(x: str | None, y: str | None) -> Point:
        return float(x or "nan"), height - float(y or "nan")

    lines = [
        Line(point(e.get("x1"), e.get("y1")), point(e.get("x2"), e.get("y2")))
        for e in root.iter(f"{_SVG}line")
    ]
    circles = [
        Circle(point(e.get("cx"), e.get("cy")), float(e.get("r", "nan")))
        for e in root.iter(f"{_SVG}circle")
    ]
    outlines = [
        Outline(tuple(point(*pair.split(",")) for pair in e.get("points", "").split()))
        for e in root.iter(f"{_SVG}polygon")
    ]
    return Shapes(width, height, tuple(lines), tuple(circles), tuple(outlines))


@dataclass(slots=True)
class _Pen:
    """Follows the operators of a PDF page: one sub-path at a time."""

    shapes: list[Line | Circle | Outline]
    matrix: tuple[float, ...] = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
    path: list[Point] | None = None
    curves: int = 0
    closed: bool = False

    def _at(self, x: Any, y: Any) -> Point:
        a, b, c, d, e, f = self.matrix
        px, py = float(x), float(y)
        k = _MM_PER_POINT
        return k * (a * px + c * py + e), k * (b * px + d * py + f)

    def transform(self, numbers: Sequence[Any]) -> None:
        a, b, c, d, e, f = (float(n) for n in numbers)
        p, q, r, s, t, u = self.matrix
        self.matrix = (
            a * p + b * r,
            a * q + b * s,
            c * p + d * r,
            c * q + d * s,
            e * p + f * r + t,
            e * q + f * s + u,
        )

    def start(self, numbers: Sequence[Any]) -> None:
        self.path, self.curves, self.closed = [self._at(*numbers)], 0, False

    def line(self, numbers: Sequence[Any]) -> None:
        (self.path or []).append(self._at(*numbers))

    def curve(self, numbers: Sequence[Any]) -> None:
        self.curves += 1
        (self.path or []).append(self._at(*numbers[4:]))

    def close(self, _numbers: Sequence[Any]) -> None:
        self.closed = True

    def stroke(self, _numbers: Sequence[Any]) -> None:
        points = self.path or []
        if self.curves == 4 and len(points) == 5:
            centre = _mean(points[:4])
            self.shapes.append(Circle(centre, sum(math.dist(centre, p) for p in points[:4]) / 4))
        elif self.curves == 0 and self.closed and len(points) >= 3:
            self.shapes.append(Outline(tuple(points)))
        elif self.curves == 0 and len(points) == 2:
            self.shapes.append(Line(points[0], points[1]))
        else:
            raise _wrong(f"a path of {len(points)} points and {self.curves} curves")
        self.path = None


def _mean(points: Sequence[Point]) -> Point:
    n = len(points)
    return sum(p[0] for p in points) / n, sum(p[1] for p in points) / n


def read_pdf(content: bytes) -> Shapes:
    """Read the shapes of a one-page PDF."""
    from pypdf import PdfReader
    from pypdf.generic import ContentStream

    reader = PdfReader(io.BytesIO(content))
    page = reader.pages[0]
    if len(reader.pages) != 1 or float(page.get("/UserUnit", 1.0)) != 1.0:
        raise _wrong("the PDF has several pages or a unit of its own")
    pen = _Pen([])
    acts: dict[bytes, Callable[[Sequence[Any]], None]] = {
        b"cm": pen.transform,
        b"m": pen.start,
        b"l": pen.line,
        b"c": pen.curve,
        b"h": pen.close,
        b"S": pen.stroke,
    }
    contents = page.get_contents()
    operations = ContentStream(contents, reader).operations if contents is not None else []
    for operands, operator in operations:
        act = acts.get(operator)
        if act is not None:
            act(operands)
    k = _MM_PER_POINT
    return Shapes(
        k * float(page.mediabox.width),
        k * float(page.mediabox.height),
        tuple(s for s in pen.shapes if isinstance(s, Line)),
        tuple(s for s in pen.shapes if isinstance(s, Circle)),
        tuple(s for s in pen.shapes if isinstance(s, Outline)),
    )
