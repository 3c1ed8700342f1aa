"""What each cause adds to the torque on a motion, and where its shape parameters are looked for."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.model import Cause, Motion, shape_bounds
from hdbench.records.trace import FloatArray

__all__ = [
    "Effect",
    "effect_columns",
    "fitted_shape",
    "line_key",
    "nominal_shape",
    "picked",
    "shape_axes",
    "shape_grid",
]

# Shapes of a cause before anything is known of it: an order that the baseline lacks, the bearing of
# a wave generator (23 balls, d/D = 0.1), a motor of 12 pole pairs, the load on a flexspline of
# 16 kN m/rad, mains of 50 Hz, a tone away from it, a warming-up that a run of minutes shows,
# friction of a greased bearing.
_NOMINAL = {
    ("ripple-harmonic", "order"): 6.0,
    ("bearing-defect", "order"): 10.35,
    ("cogging", "order"): 12.0,
    ("torsional-resonance", "resonance_hz"): 153.0,
    ("torsional-resonance", "damping"): 0.03,
    ("mains-hum", "frequency_hz"): 50.0,
    ("structural-tone", "frequency_hz"): 37.3,
    ("warm-up", "time_constant_s"): 60.0,
    ("stribeck-friction", "stribeck_rad_s"): 15.0,
}
# a step in time nearer to the ends than this share is moved where it can be seen, off the middle,
# where a symmetric run turns round
_STEP_SHARE, _STEP_AT = 0.1, 0.45
# a domain with ends this far apart is cut in equal ratios, any other in equal steps
_DECADE = 10.0
# points of a grid along each shape, for one, two and more shapes together; refined afterwards
_POINTS = {1: 33, 2: 9}
_POINTS_MORE = 5
# the same for a cause whose columns need every sample of the motion, a hundred times the work
_COARSE = {1: 13, 2: 5}
_COARSE_MORE = 3


@dataclass(frozen=True, slots=True)
class Effect:
    """A cause with its shape.

    Parameters
    ----------
    cause : Cause
        Cause of the catalogue.
    shape : mapping of str to float
        Shape parameters.
    amplitude_nm : float or None
        Peak torque, N m, where it is known from a diagnosis; None where it is not.
    """

    cause: Cause
    shape: Mapping[str, float]
    amplitude_nm: float | None = None

    @property
    def name(self) -> str:
        """Name of the cause."""
        return self.cause.name


def _inside(value: float, bands: tuple[tuple[float, float], ...]) -> float:
    """Return the value of the bands that is nearest."""
    near = [float(np.clip(value, low, high)) for low, high in bands]
    return min(near, key=lambda x: abs(x - value)) if near else value


def _middle(bands: tuple[tuple[float, float], ...]) -> float:
    low, high = bands[0][0], bands[-1][1]
    if low > 0.0 and high / low >= _DECADE:
        return float(np.sqrt(low * high))
    return 0.5 * (low + high)


def nominal_shape(cause: Cause) -> dict[str, float]:
    """Return the shape that a cause is given before anything is known of it.

    Parameters
    ----------
    cause : Cause
        Cause of the catalogue.

    Returns
    -------
    dict
        Each shape parameter in its domain: a value of the literature where there is one, else the
        middle of the domain (of its logarithm where it covers a decade). A time of a step is
        `fitted_shape`'s to choose.
    """
    shape = {}
    for parameter in cause.shape:
        bands = parameter.bands or ((parameter.lower, parameter.upper),)
        wanted = _NOMINAL.get((cause.name, parameter.name))
        shape[parameter.name] = _inside(_middle(bands) if wanted is None else wanted, bands)
    return shape


def fitted_shape(
    cause: Cause, shape: Mapping[str, float], motion: Motion, time_s: FloatArray
) -> dict[str, float] | None:
    """Return a shape moved to what a motion can show.

    Parameters
    ----------
    cause : Cause
        Cause.
    shape : mapping of str to float
        Wanted shape.
    motion : Motion
        Motion that bounds it.
    time_s : ndarray, shape (m,)
        Times at which it is looked at, s, increasing.

    Returns
    -------
    dict or None
        The shape in its bounds, a step in time with a tenth of the samples or more on either side;
        None where the motion leaves nothing of a domain.
    """
    fitted = {}
    for name, bands in shape_bounds(cause, motion).items():
        if not bands:
            return None
        value = _inside(shape[name], bands)
        if name == "step_time_s":
            before = float(np.mean(time_s < value))
            if not _STEP_SHARE <= before <= 1.0 - _STEP_SHARE:
                value = float(time_s[int(_STEP_AT * (len(time_s) - 1))])
        fitted[name] = value
    return fitted


def line_key(cause: Cause) -> str | None:
    """Return ``order`` or ``frequency_hz`` for a cause that is lines at one free place, else None.

    Parameters
    ----------
    cause : Cause
        Cause.

    Returns
    -------
    str or None
    """
    names = [parameter.name for parameter in cause.shape]
    return names[0] if names in (["order"], ["frequency_hz"]) else None


def shape_axes(cause: Cause, motion: Motion, *, coarse: bool = False) -> dict[str, FloatArray]:
    """Return the grid along each shape parameter.

    Parameters
    ----------
    cause : Cause
        Cause.
    motion : Motion
        Motion that bounds the shapes.
    coarse : bool
        Whether fewer points have to do.

    Returns
    -------
    dict
        Name to increasing values; empty arrays where nothing of the domain is left.
    """
    bounds = shape_bounds(cause, motion)
    some, more = (_COARSE, _COARSE_MORE) if coarse else (_POINTS, _POINTS_MORE)
    count = some.get(len(bounds), more)
    axes = {}
    for name, bands in bounds.items():
        pieces = [_spread(low, high, max(2, count // len(bands))) for low, high in bands]
        axes[name] = np.unique(np.concatenate(pieces)) if pieces else np.zeros(0)
    return axes


def _spread(low: float, high: float, count: int) -> FloatArray:
    if low > 0.0 and high / low >= _DECADE:
        return np.geomspace(low, high, count)
    return np.linspace(low, high, count)


def shape_grid(axes: Mapping[str, FloatArray]) -> list[dict[str, float]]:
    """Return every combination of the values along the axes.

    Parameters
    ----------
    axes : mapping of str to ndarray
        As `shape_axes` gives them.

    Returns
    -------
    list of dict
    """
    return [
        dict(zip(axes, (float(v) for v in values), strict=True))
        for values in itertools.product(*axes.values())
    ]


def effect_columns(cause: Cause, shape: Mapping[str, float], motion: Motion) -> FloatArray:
    """Return what a cause adds to the torque.

    Parameters
    ----------
    cause : Cause
        Cause.
    shape : mapping of str to float
        Shape parameters.
    motion : Motion
        Motion.

    Returns
    -------
    ndarray, shape (n_samples, k)
        N m; no column for a cause that is no torque.
    """
    if not cause.additive:
        return np.zeros((len(motion), 0))
    return np.asarray(cause.columns(motion, shape), dtype=np.float64)


def picked(motion: Motion, rows: NDArray[np.intp]) -> Motion:
    """Return some samples of a motion, as samples without neighbours.

    Parameters
    ----------
    motion : Motion
        Motion.
    rows : ndarray of int
        Samples.

    Returns
    -------
    Motion
        Every array at these rows.
    """
    arrays: dict[str, Any] = {
        name: value[rows]
        for name in motion.__dataclass_fields__
        if isinstance(value := getattr(motion, name), np.ndarray)
    }
    return replace(motion, **arrays)
