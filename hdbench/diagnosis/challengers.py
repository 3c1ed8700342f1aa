"""What may be left when no name fits: means over speed and time, variance, outliers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc, ndtri

from hdbench.diagnosis.families import exact_statistic
from hdbench.diagnosis.record import Record
from hdbench.diagnosis.whitened import Space
from hdbench.records.trace import FloatArray

__all__ = [
    "CHALLENGERS",
    "Left",
    "equal_bins",
    "outliers",
    "time_means",
    "variance_map",
    "velocity_means",
]

_VELOCITY_BINS = 16
_TIME_BLOCKS = 32
# smallest share of the samples that a bin of the map may hold
_MIN_BIN = 200


@dataclass(frozen=True, slots=True)
class Left:
    """A part of the residual that has a place and no name.

    Parameters
    ----------
    domain : str
        Domain of the contract.
    unit : str
        Unit of the place.
    location : float
        Centre of the place.
    extent : tuple of float
        Its ends.
    size_nm : float
        Size of the effect there, N m.
    p_value : float
        Probability of the statistic or more without it, for this challenger alone.
    variance_nm2 : float
        Its part of the residual's variance, (N m)^2.
    """

    domain: str
    unit: str
    location: float
    extent: tuple[float, float]
    size_nm: float
    p_value: float
    variance_nm2: float


def equal_bins(values: FloatArray, valid: NDArray[np.bool_], count: int) -> list[NDArray[np.bool_]]:
    """Return masks of bins that hold equal shares of the valid samples.

    Parameters
    ----------
    values : ndarray, shape (n,)
        What is binned: speed, rad/s, or time, s.
    valid : ndarray of bool, shape (n,)
        Samples that count.
    count : int
        Number of bins, at least 2.

    Returns
    -------
    list of ndarray of bool, shape (n,)
        Bins of 200 samples at least; none where the values are too few or too much alike.
    """
    edges = np.unique(np.quantile(values[valid], np.linspace(0.0, 1.0, count + 1)))
    if len(edges) < 3:
        return []
    where = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    masks = [valid & (where == k) for k in range(len(edges) - 1)]
    return [m for m in masks if int(m.sum()) >= _MIN_BIN]


def _means(
    space: Space,
    record: Record,
    axis: FloatArray,
    masks: list[NDArray[np.bool_]],
    what: tuple[str, str],
) -> Left | None:
    if len(masks) < 2:
        return None
    columns = np.array(masks, dtype=float).T
    statistic, dof, linear = exact_statistic(space, columns)
    if dof == 0:
        return None
    p = float(gammaincc(dof / 2.0, statistic / 2.0))
    curve = columns @ linear
    curve = np.where(record.valid, curve - curve[record.valid].mean(), 0.0)
    worst = max(range(len(masks)), key=lambda k: abs(float(curve[masks[k]].mean())))
    place = axis[masks[worst]]
    return Left(
        what[0],
        what[1],
        float(np.median(place)),
        (float(place.min()), float(place.max())),
        abs(float(curve[masks[worst]].mean())),
        p,
        float(np.mean(curve[record.valid] ** 2)),
    )


def velocity_means(space: Space, record: Record, noise_nm: float) -> Left | None:
    """Return what the mean residual over bins of motor speed leaves.

    Parameters
    ----------
    space : Space
        Whitened residual with what is explained projected out.
    record : Record
        Record.
    noise_nm : float
        Standard deviation of the noise's innovation, N m; not needed here.

    Returns
    -------
    Left or None
        The bin that stands out most, rad/s, and the probability of all bins together; None
        where the speed does not change.
    """
    del noise_nm
    speed = record.motion.velocity_rad_s
    masks = equal_bins(speed, record.valid, _VELOCITY_BINS)
    return _means(space, record, speed, masks, ("velocity", "rad/s"))


def time_means(space: Space, record: Record, noise_nm: float) -> Left | None:
    """Return what the mean residual over blocks of time leaves.

    Parameters
    ----------
    space : Space
        Whitened residual with what is explained projected out.
    record : Record
        Record.
    noise_nm : float
        Standard deviation of the noise's innovation, N m; not needed here.

    Returns
    -------
    Left or None
        The block that stands out most, s, and the probability of all blocks together; None
        where the record is too short.
    """
    del noise_nm
    time = record.motion.time_s
    masks = equal_bins(time, record.valid, _TIME_BLOCKS)
    return _means(space, record, time, masks, ("time", "s"))


def variance_map(space: Space, record: Record, noise_nm: float) -> Left | None:
    """Return where the residual's variance differs, over bins of absolute motor speed.

    Parameters
    ----------
    space : Space
        Whitened residual with what is explained projected out.
    record : Record
        Record.
    noise_nm : float
        Standard deviation of the noise's innovation, N m.

    Returns
    -------
    Left or None
        The bin that stands out most, rad/s; None where the speed does not change.

    Notes
    -----
    Means of the squared whitened residual in m bins of n samples are compared with each other;
    their spread without an effect is the variance of the squares over n, taken from the record.
    """
    used = space.whitener.used
    speed = np.abs(record.motion.velocity_rad_s)
    masks = equal_bins(speed, used & record.valid, _VELOCITY_BINS)
    if len(masks) < 2:
        return None
    squares = space.residual**2
    means = np.array([squares[m].mean() for m in masks])
    weights = np.array([float(m.sum()) for m in masks]) / float(squares[used].var())
    centre = float((weights * means).sum() / weights.sum())
    statistic = float((weights * (means - centre) ** 2).sum())
    p = float(gammaincc((len(masks) - 1) / 2.0, statistic / 2.0))
    worst = int(np.argmax(np.abs(means - centre) * np.sqrt(weights)))
    place = record.motion.velocity_rad_s[masks[worst]]
    excess = noise_nm**2 * abs(float(means[worst]) - centre)
    return Left(
        "variance",
        "rad/s",
        float(np.median(np.abs(place))),
        (float(np.abs(place).min()), float(np.abs(place).max())),
        float(np.sqrt(excess)),
        p,
        float(excess * masks[worst].sum() / used.sum()),
    )


def outliers(space: Space, record: Record, noise_nm: float) -> Left | None:
    """Return what is left of isolated samples far outside of a normal distribution.

    Parameters
    ----------
    space : Space
        Whitened residual with what is explained projected out.
    record : Record
        Record.
    noise_nm : float
        Standard deviation of the noise's innovation, N m.

    Returns
    -------
    Left or None
        The farthest sample, s; None where no sample is beyond what 1 in 10 000 records shows.
    """
    used = np.flatnonzero(space.whitener.used)
    magnitude = np.abs(space.residual[used])
    # the probability that the largest of n normal samples is beyond this is 1e-4
    far = magnitude > -float(ndtri(0.5e-4 / len(used)))
    if not far.any():
        return None
    at = used[far]
    times = record.motion.time_s[at]
    worst = int(at[np.argmax(magnitude[far])])
    largest = float(magnitude.max())
    tail = 2.0 * len(used) * float(0.5 * gammaincc(0.5, largest**2 / 2.0))
    variance = noise_nm**2 * float((magnitude[far] ** 2).sum()) / len(used)
    return Left(
        "outliers",
        "s",
        float(record.motion.time_s[worst]),
        (float(times.min()), float(times.max())),
        noise_nm * largest,
        min(1.0, tail),
        variance,
    )


CHALLENGERS: tuple[Callable[[Space, Record, float], Left | None], ...] = (
    velocity_means,
    time_means,
    variance_map,
    outliers,
)
