"""Channel beside another: common noise."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from hdbench.diagnosis.faults.shaft import FAST
from hdbench.estimation.delay import side_by_side
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


def same_to_the_end(
    one: FloatArray, other: FloatArray, rate_hz: float, limit_hz: float | None
) -> bool:
    """Return whether two channels agree up to the end of their band, where motion has none."""
    from scipy.signal import coherence  # half a second of every start

    both = side_by_side(one, other)
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
