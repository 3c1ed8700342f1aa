"""Strain gauges on the diaphragm: their bridge, their placement, the film that places them."""

from __future__ import annotations

from hdbench.gauges.bridge import bridge_ratio, torque_reading
from hdbench.gauges.errortable import ErrorTable, Tolerance, table_as_csv, tabulate_errors
from hdbench.gauges.layout import (
    LAYOUTS,
    GridGeometry,
    Layout,
    cancellation,
    layout_named,
    usual_places,
)
from hdbench.gauges.misplacement import (
    GaugedBench,
    closed_form_ripple,
    gauged_bench,
    placement_effects,
)
from hdbench.gauges.strain import PlacementErrors, StrainField, Wave, grid_strain, off_centre

__all__ = [
    "LAYOUTS",
    "ErrorTable",
    "GaugedBench",
    "GridGeometry",
    "Layout",
    "PlacementErrors",
    "StrainField",
    "Tolerance",
    "Wave",
    "bridge_ratio",
    "cancellation",
    "closed_form_ripple",
    "gauged_bench",
    "grid_strain",
    "layout_named",
    "off_centre",
    "placement_effects",
    "table_as_csv",
    "tabulate_errors",
    "torque_reading",
    "usual_places",
]
