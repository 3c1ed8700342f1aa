"""Channel by itself and beside another: spectrum, common noise and delay."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from hdbench.diagnosis.faults.scatter import bridged
from hdbench.diagnosis.faults.shaft import FAST
from hdbench.records.trace import FloatArray


def same_noise(one: FloatArray, other: FloatArray) -> bool:
    """Return whether two channels are one, times a factor: they share their noise too."""
    good = np.isfinite(one) & np.isfinite(other)
    # fewer samples than a shortest segment tell nothing
    if int(good.sum()) < 64:
        return False
    parts = [v[good] - uniform_filter1d(v[good], FAST) for v in (one, other)]
    sizes = [float(part @ part) for part in parts]
    if not min(sizes) > 0.0:
        return False
    return bool(1.0 - float(parts[0] @ parts[1]) ** 2 / (sizes[0] * sizes[1]) < 1e-3)


def _side_by_side(one: FloatArray, other: FloatArray) -> tuple[FloatArray, FloatArray, int] | None:
    """Return two channels that change, and the segment to average; None where too short."""
    good = np.isfinite(one + other)
    ranges = [float(np.ptp(v[good])) if good.any() else 0.0 for v in (one, other)]
    # twelve segments of 64 samples
    if int(good.sum()) < 12 * 64 or not min(ranges) > 0.0:
        return None
    a, b = (bridged(np.where(good, v, np.nan)) for v in (one, other))
    return a, b, min(2048, len(one) // 12)


def same_to_the_end(
    one: FloatArray, other: FloatArray, rate_hz: float, limit_hz: float | None
) -> bool:
    """Return whether two channels agree up to the end of their band, where motion has none."""
    from scipy.signal import coherence  # half a second of every start

    both = _side_by_side(one, other)
    if both is None:
        return False
    a, b, size = both
    # side lobes 220 dB down: a strong slow part must not hide an empty floor behind them
    frequency, shared = coherence(a, b, rate_hz, ("kaiser", 30), nperseg=size)
    place = frequency / (limit_hz or 0.5 * rate_hz)
    end = shared[(place > 0.5) & (place < 0.9)]
    # two sensors share the motion and no noise: of K segments their coherence exceeds 1/2 by chance
    # with 2^(1 - K) at each frequency; here the median of many has to
    return bool(len(end) and float(np.median(end)) > 0.5)


def delay_of(late: FloatArray, early: FloatArray, period_s: float) -> tuple[float, float] | None:
    """Return by how much one channel is later than another, and its standard deviation, s."""
    from scipy.signal import coherence, csd

    both = _side_by_side(early, late)
    if both is None:
        return None
    a, b, size = both
    frequency, cross = csd(a, b, 1.0 / period_s, nperseg=size)
    _, shared = coherence(a, b, 1.0 / period_s, nperseg=size)
    used = (shared > 0.5) & (frequency > 0.0) & (frequency < 0.25 / period_s)
    if not used.any():
        return None
    # slope of the phase, which noise of either channel does not turn, each frequency by its weight
    # 2 K g^2 / (1 - g^2) of K segments and coherence g^2 (Bendat and Piersol, Random Data, 9.2)
    segments = 2.0 * len(a) / size - 1.0
    turn = 2.0 * np.pi * frequency[used]
    weight = 2.0 * segments * shared[used] / np.maximum(1.0 - shared[used], 1e-9)
    phase = -np.unwrap(np.angle(cross[used]))
    information = float(np.sum(weight * turn**2))
    delay = float(np.sum(weight * turn * phase)) / information
    left = phase - delay * turn
    # phases that lie on no line are not known better than they scatter
    scatter = float(np.sum(weight * left**2)) / max(int(used.sum()) - 1, 1)
    return delay, float(np.sqrt(max(scatter, 1.0) / information))
