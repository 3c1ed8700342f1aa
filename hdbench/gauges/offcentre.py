"""A whole film that lies off the middle of the diaphragm."""

from __future__ import annotations

import numpy as np

from hdbench.gauges.layout import GridGeometry, Layout
from hdbench.gauges.strain import PlacementErrors
from hdbench.records.trace import FloatArray

__all__ = ["off_centre"]


def off_centre(
    layout: Layout, geometry: GridGeometry, shift_mm: FloatArray, towards_rad: FloatArray
) -> PlacementErrors:
    """Return the errors of rosettes that stay in place on a film that was shifted.

    Parameters
    ----------
    layout : Layout
        The rosettes.
    geometry : GridGeometry
        Their radius.
    shift_mm : ndarray, shape (draws,)
        How far the film's middle is off the axis, mm; less than the radius.
    towards_rad : ndarray, shape (draws,)
        In which direction, rad, counter-clockwise from the index mark.

    Returns
    -------
    PlacementErrors
        Radius and angle of every rosette about the true axis. A shift does not turn the rosettes:
        each turns against its own radius by as much as its angle changes, the other way.

    Notes
    -----
    To first order rosettes opposite each other change their angle by opposite amounts, and the
    bridge adds them: four rosettes at right angles take it away, two do not.
    """
    angles = np.array(layout.angles_rad)
    x = geometry.radius_mm * np.cos(angles) + (shift_mm * np.cos(towards_rad))[:, None]
    y = geometry.radius_mm * np.sin(angles) + (shift_mm * np.sin(towards_rad))[:, None]
    along = np.arctan2(y, x) - angles
    along = np.arctan2(np.sin(along), np.cos(along))
    return PlacementErrors(np.hypot(x, y) - geometry.radius_mm, along, -along)
