"""A drawing as SVG in millimetres."""

from __future__ import annotations

from xml.etree import ElementTree

from hdbench.gauges.film.drawing import Circle, Drawing, Line, Point

__all__ = ["drawing_as_svg"]

_MM_PER_POINT = 25.4 / 72.0


def drawing_as_svg(drawing: Drawing) -> bytes:
    """Return a drawing as SVG whose user unit is 1 mm."""
    width, height = _size(drawing.width_mm), _size(drawing.height_mm)
    root = ElementTree.Element(
        "svg",
        {
            "xmlns": "http://www.w3.org/2000/svg",
            "width": f"{width}mm",
            "height": f"{height}mm",
            "viewBox": f"0 0 {width} {height}",
        },
    )
    ElementTree.SubElement(root, "title").text = drawing.title
    ElementTree.SubElement(root, "rect", {"width": width, "height": height, "fill": "#fff"})
    lines = ElementTree.SubElement(
        root, "g", {"fill": "none", "stroke": "#000", "stroke-width": _size(drawing.line_mm)}
    )
    for stroke in drawing.strokes:
        if isinstance(stroke, Line):
            (x1, y1), (x2, y2) = _down(drawing, stroke.start), _down(drawing, stroke.end)
            names = {"x1": x1, "y1": y1, "x2": x2, "y2": y2}
            ElementTree.SubElement(lines, "line", names)
        elif isinstance(stroke, Circle):
            x, y = _down(drawing, stroke.centre)
            ElementTree.SubElement(
                lines, "circle", {"cx": x, "cy": y, "r": _size(stroke.radius_mm)}
            )
        else:
            points = " ".join(",".join(_down(drawing, corner)) for corner in stroke.corners)
            ElementTree.SubElement(lines, "polygon", {"points": points})
    words = ElementTree.SubElement(
        root, "g", {"font-family": "Helvetica, Arial, sans-serif", "fill": "#000"}
    )
    for text in drawing.texts:
        x, y = _down(drawing, text.at)
        size = _size(text.size_pt * _MM_PER_POINT)
        names = {"x": x, "y": y, "font-size": size, "text-anchor": text.align}
        ElementTree.SubElement(words, "text", names).text = text.words
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def _size(value_mm: float) -> str:
    # a nanometre: the turn of a grid of 1 mm is measured at a radius of up to 200 mm
    return f"{value_mm:.6f}".rstrip("0").rstrip(".")


def _down(drawing: Drawing, point: Point) -> tuple[str, str]:
    """Return a point as SVG counts: y downwards."""
    return _size(point[0]), _size(drawing.height_mm - point[1])
