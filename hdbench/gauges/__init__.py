"""Strain gauges on the diaphragm: their bridge, their placement, the film that places them."""

from __future__ import annotations

from hdbench.gauges.errortable import Tolerance, table_as_csv, tabulate_errors
from hdbench.gauges.layout import LAYOUTS, GridGeometry, usual_places
from hdbench.gauges.strain import gauged_bench

__all__ = [
    "LAYOUTS",
    "GridGeometry",
    "Tolerance",
    "gauged_bench",
    "table_as_csv",
    "tabulate_errors",
    "usual_places",
]
