"""How much later one channel of a log is than another."""

from __future__ import annotations

import numpy as np

from hdbench.records.trace import FloatArray


def side_by_side(one: FloatArray, other: FloatArray) -> tuple[FloatArray, FloatArray, int] | None:
    """Return two channels that change, and the segment to average; None where too short."""
    good = np.isfinite(one + other)
    ranges = [float(np.ptp(v[good])) if good.any() else 0.0 for v in (one, other)]
    # twelve segments of 64 samples
    if int(good.sum()) < 12 * 64 or not min(ranges) > 0.0:
        return None
    at = np.arange(len(one))
    a, b = (np.interp(at, at[good], v[good]) for v in (one, other))
    return a, b, min(2048, len(one) // 12)


def delay_of(late: FloatArray, early: FloatArray, period_s: float) -> tuple[float, float] | None:
    """Return by how much one channel is later than another, and its standard deviation, s."""
    from scipy.signal import coherence, csd

    both = side_by_side(early, late)
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
