"""Noise of a known law: drawn, and whitened by the exact inverse of what coloured it."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

__all__ = ["KINDS", "Noise"]

# zeros and poles of the noise at 1 kHz; the last rises like 1/f between 0.3 Hz and 100 Hz
KINDS = {
    "white": ((), ()),
    "ar": ((), (0.9,)),
    "flicker": ((0.9937, 0.937, 0.45), (0.998, 0.98, 0.82)),
}
_RUN_IN = 8000


@dataclass(frozen=True)
class Noise:
    """Noise of standard deviation `sigma_nm`, N m, and spectrum `kind`."""

    kind: str
    sigma_nm: float

    def _law(self):
        zeros, poles = KINDS[self.kind]
        over, under = np.poly(zeros), np.poly(poles)
        kick = np.zeros(_RUN_IN)
        kick[0] = 1.0
        answer = lfilter(over, under, kick)
        return over, under, self.sigma_nm / float(np.sqrt(answer @ answer))

    def draw(self, count, rng):
        """Draw `count` samples, N m, already settled."""
        over, under, scale = self._law()
        white = rng.standard_normal(count + _RUN_IN)
        return scale * lfilter(over, under, white)[_RUN_IN:]

    def whiten(self, columns):
        """Return `columns` (n,) or (n, k), N m, with unit white noise."""
        over, under, scale = self._law()
        if self.kind == "white":
            return columns / scale
        return lfilter(under, over, columns, axis=0) / scale
