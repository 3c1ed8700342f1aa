"""What a cause gains on predicted blocks, with its interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.answer.records import Gain
from hdbench.diagnosis.measured.record import Record
from hdbench.records.trace import FloatArray

__all__ = ["Gain", "HeldOut", "gain_between"]

_DRAWS = 2000
# at least this many blocks in the bootstrap, else its interval is no interval
_MIN_BLOCKS = 20


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Residual of predictions for blocks that were left out of the fit.

    Parameters
    ----------
    residual_nm : ndarray, shape (n,)
        Measured less predicted, N m; zero where not valid.
    valid : ndarray of bool, shape (n,)
        Samples that were predicted.
    chi2 : float
        Sum of squares of the whitened residual.
    """

    residual_nm: FloatArray
    valid: NDArray[np.bool_]
    chi2: float

    @property
    def rms_nm(self) -> float:
        """Root mean square, N m."""
        return float(np.sqrt(np.mean(self.residual_nm[self.valid] ** 2)))


def _block_sums(values: FloatArray, length: int) -> FloatArray:
    edges = np.arange(0, len(values), length)
    return np.asarray(np.add.reduceat(values, edges))


def gain_between(before: HeldOut, after: HeldOut, record: Record, rng: np.random.Generator) -> Gain:
    """Return the gain from one prediction to the other.

    Parameters
    ----------
    before, after : HeldOut
        Predictions without and with a cause.
    record : Record
        Record; an output turn is the length of a bootstrap block where 20 of them fit.
    rng : Generator
        For the bootstrap.

    Returns
    -------
    Gain

    References
    ----------
    .. [1] H. R. Kuensch, Ann. Statist. 17 (1989) 1217, doi:10.1214/aos/1176347265.
    """
    old = before.residual_nm[before.valid] ** 2
    new = after.residual_nm[after.valid] ** 2
    travelled = np.abs(np.diff(record.motion.output_angle_rad[record.valid])).sum() / (2.0 * np.pi)
    turn = len(old) / travelled if travelled > 0.0 else np.inf
    length = int(np.clip(turn, 1, max(1, len(old) // _MIN_BLOCKS)))
    sums_old, sums_new = _block_sums(old, length), _block_sums(new, length)
    pick = rng.integers(0, len(sums_old), (_DRAWS, len(sums_old)))
    fractions = 1.0 - sums_new[pick].sum(axis=1) / sums_old[pick].sum(axis=1)
    low, high = np.percentile(fractions, (2.5, 97.5))
    return Gain(
        before.rms_nm,
        after.rms_nm,
        float(1.0 - new.mean() / old.mean()),
        (float(low), float(high)),
    )
