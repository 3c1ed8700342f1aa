"""Draw a film, check it by reading it back, and write it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdbench.errors import StorageError, UsageError
from hdbench.gauges.film.check import Dimension, check_film
from hdbench.gauges.film.compose import compose
from hdbench.gauges.film.pdf import drawing_as_pdf
from hdbench.gauges.film.readback import read_pdf, read_svg
from hdbench.gauges.film.request import FilmRequest
from hdbench.gauges.film.svg import drawing_as_svg
from hdbench.gauges.film.words import title
from hdbench.records.storage import storage_error, write_atomic

__all__ = ["Film", "write_film"]


@dataclass(frozen=True, slots=True)
class Film:
    """A film that was written and measured.

    Parameters
    ----------
    title : str
        Its head line.
    pdf, svg : Path
        The files.
    dimensions : mapping of str to tuple of Dimension
        What was measured in ``pdf`` and in ``svg``.
    """

    title: str
    pdf: Path
    svg: Path
    dimensions: dict[str, tuple[Dimension, ...]]

    @property
    def largest_error_mm(self) -> float:
        """Largest distance of a size from what was asked for, mm, in either file."""
        return max(abs(d.error_mm) for found in self.dimensions.values() for d in found)

    def to_dict(self) -> dict[str, Any]:
        """Return the film as ``--json`` prints it."""
        return {
            "title": self.title,
            "files": {"pdf": str(self.pdf), "svg": str(self.svg)},
            "largest_error_mm": self.largest_error_mm,
            "dimensions": {
                kind: [d.to_dict() for d in found] for kind, found in self.dimensions.items()
            },
        }


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
        The files and every size measured in them.

    Raises
    ------
    UsageError
        If `out` is not a name that ends in ``.pdf``.
    HdbenchError
        If a size read back is off by more than 0.01 mm: nothing is written then.
    StorageError
        If a file cannot be written, or does not read back as it was written.
    """
    if out.suffix.lower() != ".pdf":
        raise UsageError(
            f"{out.name!r} does not end in .pdf", where="--out", fix="name it such as film.pdf"
        )
    drawing = compose(request)
    pdf, svg = drawing_as_pdf(drawing), drawing_as_svg(drawing)
    other = out.with_suffix(".svg")
    found = {
        "pdf": check_film(read_pdf(pdf), request, str(out)),
        "svg": check_film(read_svg(svg), request, str(other)),
    }
    for path, content in ((out, pdf), (other, svg)):
        _write(path, content)
    return Film(title(request), out, other, found)


def _write(path: Path, content: bytes) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, content)
        kept = path.read_bytes()
    except OSError as error:
        raise storage_error(error, path) from error
    if kept != content:
        raise StorageError(
            "the file does not read back as it was written",
            where=str(path),
            fix="check the disk, then write the film again",
        )
