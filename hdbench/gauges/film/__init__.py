"""The transparent film that places the rosettes: drawn at 1:1, read back, written."""

from __future__ import annotations

from hdbench.gauges.film.check import Dimension
from hdbench.gauges.film.request import SHEETS, FilmRequest
from hdbench.gauges.film.write import Film, write_film

__all__ = ["SHEETS", "Dimension", "Film", "FilmRequest", "write_film"]
