"""The transparent film that places the rosettes: drawn at 1:1 as PDF and SVG."""

from __future__ import annotations

from hdbench.gauges.film.request import SHEETS, FilmRequest
from hdbench.gauges.film.write import Film, write_film

__all__ = ["SHEETS", "Film", "FilmRequest", "write_film"]
