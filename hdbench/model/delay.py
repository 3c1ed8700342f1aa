"""A sampled signal at another time: exact for what the sampling resolves."""

from __future__ import annotations

from typing import Final

import numpy as np

from hdbench.model.localfit import segments
from hdbench.records.trace import FloatArray

__all__ = ["delayed"]

# a spline of degree 5 through all samples: 0.3 % off at a quarter of the sampling rate
_DEGREE: Final = 5
# time stamps this close to a uniform grid (relative to the period) move a value by as little
_UNIFORM = 1e-6


def delayed(time_s: FloatArray, values: FloatArray, delay_s: float) -> FloatArray:
    """Return a signal as it was a delay ago."""
    result = np.full(len(time_s), np.nan)
    present = np.flatnonzero(np.isfinite(values))
    if len(present) < 2:
        result[present] = values[present]
        return result
    time, samples = time_s[present], values[present]
    period = float(np.median(np.diff(time)))
    for part in segments(time, period):
        result[present[part]] = _shifted(time[part], samples[part], delay_s)
    return result


def _shifted(time: FloatArray, samples: FloatArray, delay: float) -> FloatArray:
    """Return one stretch as it was `delay` ago; as it is where it is too short for a spline."""
    if len(time) <= _DEGREE + 1:
        return samples
    at = np.clip(time - delay, time[0], time[-1])
    period = float(time[-1] - time[0]) / (len(time) - 1)
    grid = time[0] + period * np.arange(len(time))
    if float(np.abs(time - grid).max()) > _UNIFORM * period:
        from scipy.interpolate import make_interp_spline

        return np.asarray(make_interp_spline(time, samples, k=_DEGREE)(at), dtype=np.float64)
    from scipy.ndimage import map_coordinates, spline_filter1d

    coefficients = spline_filter1d(samples, order=_DEGREE, mode="mirror")
    places = ((at - time[0]) / period)[None, :]
    out = map_coordinates(coefficients, places, order=_DEGREE, mode="mirror", prefilter=False)
    return np.asarray(out, dtype=np.float64)
