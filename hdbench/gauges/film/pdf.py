"""A drawing as a PDF page of its own size."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from hdbench.gauges.film.drawing import Circle, Drawing, Line, Outline, Point

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

__all__ = ["drawing_as_pdf"]

_POINT_PER_MM = 72.0 / 25.4


def drawing_as_pdf(drawing: Drawing) -> bytes:
    """Return a drawing as PDF, vectors only."""
    from reportlab.pdfgen.canvas import Canvas

    buffer = io.BytesIO()
    k = _POINT_PER_MM
    page = Canvas(
        buffer,
        pagesize=(drawing.width_mm * k, drawing.height_mm * k),
        pageCompression=1,
        invariant=1,
    )
    page.setTitle(drawing.title)
    page.setCreator("hdbench")
    page.setViewerPreference("PrintScaling", "None")
    page.setLineWidth(drawing.line_mm * k)
    # coordinates are written with seven digits: from the middle of the film that is 0.02 um
    page.translate(k * drawing.origin[0], k * drawing.origin[1])
    for stroke in drawing.strokes:
        _draw(page, stroke, drawing.origin)
    write = {
        "start": page.drawString,
        "middle": page.drawCentredString,
        "end": page.drawRightString,
    }
    for text in drawing.texts:
        page.setFont("Helvetica", text.size_pt)
        write[text.align](*_points(text.at, drawing.origin), text.words)
    page.save()
    return buffer.getvalue()


def _points(at: Point, origin: Point) -> Point:
    """Return a point in the unit of PDF, from the origin."""
    return _POINT_PER_MM * (at[0] - origin[0]), _POINT_PER_MM * (at[1] - origin[1])


def _draw(page: Canvas, stroke: Line | Circle | Outline, origin: Point) -> None:
    if isinstance(stroke, Line):
        page.line(*_points(stroke.start, origin), *_points(stroke.end, origin))
    elif isinstance(stroke, Circle):
        page.circle(*_points(stroke.centre, origin), _POINT_PER_MM * stroke.radius_mm)
    else:
        path = page.beginPath()
        path.moveTo(*_points(stroke.corners[0], origin))
        for corner in stroke.corners[1:]:
            path.lineTo(*_points(corner, origin))
        path.close()
        page.drawPath(path)
