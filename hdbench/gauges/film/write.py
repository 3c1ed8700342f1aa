"""Writer of a film: PDF and SVG of one drawing."""

from __future__ import annotations

import io
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from reportlab.graphics import renderPDF, renderSVG
from reportlab.pdfgen.canvas import Canvas

from hdbench.errors import UsageError
from hdbench.gauges.film.drawing import UNITS_PER_POINT, draw_film, film_title
from hdbench.gauges.film.request import BAR_MM, SHEETS, FilmRequest
from hdbench.records.storage import storage_error, write_atomic


@dataclass(frozen=True, slots=True)
class Film:
    """A film that was written.

    Parameters
    ----------
    title : str
        Its head line.
    pdf, svg : Path
        The files.
    sizes_mm : dict of str to float
        Sizes to check on the printed film, mm.
    """

    title: str
    pdf: Path
    svg: Path
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
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise storage_error(error, out) from error
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
