"""Two channels together: whether one was computed of the other, and how much later it is."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import coherence, csd

from hdbench.records.trace import FloatArray

__all__ = ["delay_of", "same_noise", "same_to_the_end"]

# samples of the running mean that takes the motion out
_FAST = 5
# share of the fast part of one channel that the other one leaves: two sensors have noise each
_SHARED = 1e-3
# side lobes 220 dB down: a strong slow part must not stand for the rest
_WINDOW = ("kaiser", 30)
# samples that both need
_FEWEST = 64
# coherence from which a frequency tells a delay, segments of the average, samples of one
_COHERENT, _SEGMENTS, _LONGEST = 0.5, 12, 2048


def _both_change(one: FloatArray, other: FloatArray) -> bool:
    return bool(np.ptp(one) > 0.0 and np.ptp(other) > 0.0)


def same_noise(one: FloatArray, other: FloatArray) -> bool:
    """Return whether two channels are one, times a factor: they share their noise too."""
    good = np.isfinite(one) & np.isfinite(other)
    if int(good.sum()) < _FEWEST:
        return False
    parts = [v[good] - uniform_filter1d(v[good], _FAST) for v in (one, other)]
    sizes = [float(part @ part) for part in parts]
    if not min(sizes) > 0.0:
        return False
    return bool(1.0 - float(parts[0] @ parts[1]) ** 2 / (sizes[0] * sizes[1]) < _SHARED)


def same_to_the_end(
    one: FloatArray, other: FloatArray, rate_hz: float, limit_hz: float | None
) -> bool:
    """Return whether two channels agree up to the end of their band, where motion has none.

    Notes
    -----
    Two sensors share the motion and no noise. Of K segments their coherence exceeds 1/2 by chance
    with probability ``2^(1 - K)`` at each frequency; here the median of many has to.
    """
    good = np.isfinite(one) & np.isfinite(other)
    if int(good.sum()) < _SEGMENTS * _FEWEST or not _both_change(one[good], other[good]):
        return False
    at = np.arange(len(one))
    a, b = (np.interp(at, at[good], v[good]) for v in (one, other))
    size = min(_LONGEST, len(at) // _SEGMENTS)
    frequency, shared = coherence(a, b, rate_hz, _WINDOW, nperseg=size)
    place = frequency / (limit_hz or 0.5 * rate_hz)
    end = shared[(place > 0.5) & (place < 0.9)]
    return bool(len(end) and float(np.median(end)) > _COHERENT)


def delay_of(late: FloatArray, early: FloatArray, period_s: float) -> tuple[float, float] | None:
    """Return by how much one channel is later than another, and its standard deviation, s.

    Notes
    -----
    Slope of the phase of their cross spectrum, each frequency by its weight
    ``2 K g^2 / (1 - g^2)``, K segments and coherence g^2 (Bendat and Piersol, Random Data, 9.2).
    Noise of either channel does not turn the phase.
    """
    good = np.isfinite(late) & np.isfinite(early)
    if int(good.sum()) < _SEGMENTS * _FEWEST or not _both_change(late[good], early[good]):
        return None
    at = np.arange(len(late))
    a, b = (np.interp(at, at[good], v[good]) for v in (early, late))
    size = min(_LONGEST, len(at) // _SEGMENTS)
    frequency, cross = csd(a, b, 1.0 / period_s, nperseg=size)
    _, shared = coherence(a, b, 1.0 / period_s, nperseg=size)
    used = (shared > _COHERENT) & (frequency > 0.0) & (frequency < 0.25 / period_s)
    if not used.any():
        return None
    segments = 2.0 * len(at) / size - 1.0
    turn = 2.0 * np.pi * frequency[used]
    weight = 2.0 * segments * shared[used] / np.maximum(1.0 - shared[used], 1e-9)
    phase = -np.unwrap(np.angle(cross[used]))
    information = float(np.sum(weight * turn**2))
    delay = float(np.sum(weight * turn * phase)) / information
    left = phase - delay * turn
    # phases that lie on no line are not known better than they scatter
    scatter = float(np.sum(weight * left**2)) / max(int(used.sum()) - 1, 1)
    return delay, float(np.sqrt(max(scatter, 1.0) / information))
