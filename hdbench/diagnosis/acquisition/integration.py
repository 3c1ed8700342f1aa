"""What the integral of a measured velocity leaves open."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.acquisition.channels import Shaft
from hdbench.records.trace import FloatArray

__all__ = ["unintegrated_rad"]

# samples of the median that a velocity is held against
_WINDOW = 5
# samples that leave the course of their neighbours three times as far as nine in ten do: normal
# noise does so at five standard deviations
_USUAL, _UNUSUAL = 0.9, 3.0
# the median of five follows two such samples in a row half of the way: twice what it leaves counts
_FOLLOWED = 2.0


def unintegrated_rad(shaft: Shaft) -> FloatArray:
    """Return what the trapezoidal rule does not know around each increment, rad.

    A velocity that leaves the course of its neighbours for a sample, as one that was formed over a
    stamp that came late does, is integrated as if it had lasted: the part of three intervals that
    it leaves open is the rule's own error.

    Parameters
    ----------
    shaft : Shaft
        Increments by both.

    Returns
    -------
    ndarray, shape (n - 1,)
        rad, one for each increment; 0 where the velocity keeps its course.
    """
    from scipy.ndimage import median_filter

    velocity = np.nan_to_num(shaft.velocity_rad_s)
    away = np.abs(velocity - median_filter(velocity, size=_WINDOW, mode="nearest"))
    usual = float(np.quantile(away, _USUAL))
    beyond = np.where(away > _UNUSUAL * usual, away, 0.0)
    open_rad = 0.5 * _FOLLOWED * (beyond[1:] + beyond[:-1]) * np.diff(shaft.time_s)
    return np.asarray(np.convolve(open_rad, np.ones(3), mode="same"))
