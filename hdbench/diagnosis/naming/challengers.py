"""What may be left that is no torque: variance, bursts, outliers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.special import gammaincc, ndtri

from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.naming.curves import equal_bins
from hdbench.diagnosis.naming.gliding import gliding_tones
from hdbench.diagnosis.naming.left import Left
from hdbench.diagnosis.naming.passing import bursts
from hdbench.diagnosis.noise.whitened import Space
from hdbench.records.trace import FloatArray

__all__ = [
    "CHALLENGERS",
    "TESTS",
    "Left",
    "challenge",
    "outliers",
    "tiles",
    "variance_over_speed",
    "variance_over_torque",
]

_VARIANCE_BINS = 16
# lengths of tiles, s; samples of the shortest and number of tiles that make a look worth while
_TILES_S = (1.0, 4.0, 16.0)
_SHORTEST_TILE = 32
_LEAST_TILES = 4


def _variance_over(
    space: Space, record: Record, noise_nm: float, axis: FloatArray, unit: str
) -> Left | None:
    """Return where the residual's variance differs over bins of an axis that is not negative.

    Means of the squared whitened residual in m bins of n samples are compared with each other;
    their spread without an effect is the variance of the squares over n, taken from the record.
    """
    used = space.whitener.used
    masks = equal_bins(axis, used & record.valid, _VARIANCE_BINS)
    if len(masks) < 2:
        return None
    squares = space.residual**2
    means = np.array([squares[m].mean() for m in masks])
    weights = np.array([float(m.sum()) for m in masks]) / float(squares[used].var())
    centre = float((weights * means).sum() / weights.sum())
    statistic = float((weights * (means - centre) ** 2).sum())
    p = float(gammaincc((len(masks) - 1) / 2.0, statistic / 2.0))
    worst = int(np.argmax(np.abs(means - centre) * np.sqrt(weights)))
    place = axis[masks[worst]]
    excess = noise_nm**2 * abs(float(means[worst]) - centre)
    return Left(
        "variance",
        unit,
        float(np.median(place)),
        (float(place.min()), float(place.max())),
        float(np.sqrt(excess)),
        p,
        float(excess * masks[worst].sum() / used.sum()),
    )


def variance_over_speed(space: Space, record: Record, noise_nm: float) -> Left | None:
    """Return where the residual's variance differs over the magnitude of motor speed.

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
    """
    speed = np.abs(record.motion.velocity_rad_s)
    return _variance_over(space, record, noise_nm, speed, "rad/s")


def variance_over_torque(space: Space, record: Record, noise_nm: float) -> Left | None:
    """Return where the residual's variance differs over the magnitude of the torque.

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
        The bin that stands out most, N m: of the measured load, else of the simulated torque.
    """
    motion = record.motion
    torque = motion.simulated_nm if motion.load_torque_nm is None else motion.applied_nm
    if torque is None:
        return None
    magnitude = np.abs(np.where(record.valid & np.isfinite(torque), torque, 0.0))
    return _variance_over(space, record, noise_nm, magnitude, "N m")


def tiles(space: Space, record: Record, noise_nm: float) -> Left | None:
    """Return the strongest burst of any frequency in tiles of 1, 4 and 16 s.

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
        Its middle and its ends, s; None for a record shorter than four tiles of 1 s.

    Notes
    -----
    ``2 |F|^2 / n`` of white noise is chi^2 with two degrees of freedom in each bin of each tile.
    """
    best: tuple[float, int, int] | None = None
    tried = 0
    for span_s in _TILES_S:
        length = round(span_s / record.period_s)
        whole = len(space.residual) // max(length, 1)
        if length < _SHORTEST_TILE or whole < _LEAST_TILES:
            continue
        table = space.residual[: whole * length].reshape(whole, length)
        powers = 2.0 * np.abs(np.fft.rfft(table, axis=1)[:, 1:-1]) ** 2 / length
        tried += powers.size
        at = int(np.argmax(powers))
        if best is None or powers.flat[at] > best[0]:
            best = (float(powers.flat[at]), at // powers.shape[1], length)
    if best is None:
        return None
    power, tile, length = best
    times = record.motion.time_s[tile * length : (tile + 1) * length]
    amplitude = noise_nm * float(np.sqrt(2.0 * power / length))
    return Left(
        "time",
        "s",
        float(np.median(times)),
        (float(times[0]), float(times[-1])),
        amplitude,
        min(1.0, tried * float(np.exp(-0.5 * power))),
        0.5 * amplitude**2 * length / len(space.residual),
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
    variance_over_speed,
    variance_over_torque,
    tiles,
    bursts,
    gliding_tones,
    outliers,
)
# two more are made elsewhere: where the acceleration jumps, and of a variance that grows with speed
TESTS = len(CHALLENGERS) + 2


def challenge(space: Space, record: Record, noise_nm: float, level: float) -> list[Left]:
    """Return what stands out of white noise, surest first.

    Parameters
    ----------
    space : Space
        Whitened residual with what is explained projected out.
    record : Record
        Record.
    noise_nm : float
        Standard deviation of the noise's innovation, N m.
    level : float
        Probability of any finding without an effect, in (0, 1).

    Returns
    -------
    list of Left
    """
    found = [left for test in CHALLENGERS if (left := test(space, record, noise_nm)) is not None]
    passed = [left for left in found if left.p_value * TESTS < level]
    return sorted(passed, key=lambda left: left.p_value)
