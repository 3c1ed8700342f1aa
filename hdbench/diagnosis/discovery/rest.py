"""Rest: what the noise holds beyond noise: bursts in time, and humps of its spectrum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.discovery.fit import Fit
from hdbench.diagnosis.evidence import chi2_tail
from hdbench.records.trace import FloatArray

# samples over which a burst changes, its lengths, and the share of the record of the longest
_SCALES = (1, 4, 16, 64)
_LENGTHS = (4, 16, 64, 256, 1024, 4096)
_SHARE = 0.1
# power above the falling part of the spectrum by this factor is a hump
_ABOVE = 2.0
# fourteen bumps fit the scatter of fifty bands to some ten nats; a hump must gain more than twice
# as much
_HUMP_NATS = 25.0


@dataclass(frozen=True, slots=True)
class Burst:
    """A stretch with more power than the noise has.

    Parameters
    ----------
    from_s, to_s : float
        Its ends, s.
    samples : int
        Its length.
    power_nm2 : float
        Mean square beyond the noise over the whole record, (N m)^2.
    chance : float
        Probability of one anywhere without it.
    """

    from_s: float
    to_s: float
    samples: int
    power_nm2: float
    chance: float


@dataclass(frozen=True, slots=True)
class Hump:
    """A range of frequencies with more power than a noise that falls with frequency.

    Parameters
    ----------
    low_hz, high_hz : float
        Its ends, Hz.
    power_nm2 : float
        Mean square beyond that noise, (N m)^2.
    """

    low_hz: float
    high_hz: float
    power_nm2: float


def whitened_nm(fit: Fit) -> FloatArray:
    """Return the residual with white noise of unit variance, in time; 0 where not valid."""
    scaled = fit.residual * np.sqrt(fit.bands.spread(1.0 / fit.spectrum.power))
    white = fit.bands.waves(scaled[None, :])[0]
    return np.where(fit.record.valid, white, 0.0)


def residual_nm(fit: Fit) -> FloatArray:
    """Return the residual in time, N m; 0 where not valid."""
    left = fit.bands.waves(fit.residual[None, :])[0]
    return np.where(fit.record.valid, left, 0.0)


def falling_noise(fit: Fit) -> tuple[FloatArray, float]:
    """Return the power of a noise that only falls with frequency, and what bumps add, nats."""
    power = fit.bands.power(fit.residual) / np.maximum(fit.bands.counts, 1e-9)
    dof = fit.bands.counts
    falling = fit.shapes.rising().without_bumps().fit(power, dof).power
    nats = [
        -0.5 * float(np.sum(dof * (np.log(s) + power / s))) for s in (fit.spectrum.power, falling)
    ]
    return falling, nats[0] - nats[1]


def noise_rms_nm(fit: Fit) -> float:
    """Return the root mean square of the part of the noise that falls with frequency, N m."""
    counts = np.diff(fit.bands.edges)
    falling = falling_noise(fit)[0]
    return float(np.sqrt(np.sum(counts * falling) / fit.bands.length))


def find_burst(fit: Fit, variance: FloatArray | None = None) -> Burst | None:
    """Return the stretch whose power is least likely to be noise, of a known variance if given."""
    white = whitened_nm(fit)
    if variance is not None:
        white = white / np.sqrt(variance)
    n = len(white)
    # a channel that passes half of the band has half of the independent samples
    share = fit.bands.size / fit.bands.length
    lengths = [m for m in _LENGTHS if m <= _SHARE * n and m * share >= 2.0]
    tried = [(s, m, shift) for s in _SCALES for m in lengths if m >= s for shift in {0, s // 2}]
    best: Burst | None = None
    for scale, m, shift in tried:
        # what changes slowly stands in the means of its samples, far above their scatter
        sums = np.add.reduceat(white[shift:], np.arange(0, n - shift, scale))
        total = np.concatenate([[0.0], np.cumsum(sums**2) / scale])
        long = m // scale
        starts = np.arange(0, len(sums) - long, max(1, long // 2))
        energy = total[starts + long] - total[starts]
        at = int(np.argmax(energy))
        dof = long * min(1.0, share * scale)
        chance = chi2_tail(float(energy[at]), dof) * len(starts) * len(tried)
        if best is None or chance < best.chance:
            first = shift + scale * int(starts[at])
            left = residual_nm(fit)[first : first + m]
            time = fit.record.motion.time_s
            square = float(np.sum(white[first : first + m] ** 2))
            beyond = float(np.sum(left**2)) * max(0.0, 1.0 - m * share / max(square, 1e-9))
            best = Burst(
                float(time[first]), float(time[first + m - 1]), m, beyond / n, min(1.0, chance)
            )
    return best


def find_humps(fit: Fit) -> list[Hump]:
    """Return the ranges of frequency that hold more than a falling noise."""
    spectrum, bands = fit.spectrum, fit.bands
    falling, nats = falling_noise(fit)
    if nats < _HUMP_NATS:
        return []
    high = spectrum.power > _ABOVE * falling
    counts = np.diff(bands.edges)
    edges_hz = (
        bands.edges
        * bands.frequency_hz[-1]
        / max(float(np.sqrt(bands.edges[-2] * bands.edges[-1])), 1.0)
    )
    humps = []
    start = None
    for k in range(len(high) + 1):
        inside = k < len(high) and bool(high[k])
        if inside and start is None:
            start = k
        if not inside and start is not None:
            beyond = counts[start:k] * (spectrum.power - falling)[start:k]
            humps.append(
                Hump(float(edges_hz[start]), float(edges_hz[k]), float(beyond.sum()) / bands.length)
            )
            start = None
    return humps
