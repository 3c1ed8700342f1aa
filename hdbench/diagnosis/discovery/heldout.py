"""Held-out blocks: each part of a record predicted from the others, with and without a cause."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.discovery.fit import Fit
from hdbench.diagnosis.discovery.record import Record
from hdbench.diagnosis.discovery.stack import coefficients_of, glances
from hdbench.records.trace import FloatArray
from hdbench.results.diagnosis import Gain

# twenty blocks hold most conditions of a run; five folds leave four fifths to the fit
_BLOCKS, _FOLDS = 20, 5
# draws of the bootstrap: the ends of its 95 % interval are known to a tenth of its width
_DRAWS = 2000
# coefficients may be so many times what the whole record says: a fold may hold the only samples
_WIDER = 3.0


@dataclass(frozen=True, slots=True)
class Prediction:
    """Residual of predictions for blocks that were left out of the fit.

    Parameters
    ----------
    squares : ndarray, shape (n_pieces,)
        Sum of squares over short pieces of the record, (N m)^2.
    counts : ndarray, shape (n_pieces,)
        Samples in each.
    chi2 : float
        Sum of squares of the whitened residual.
    """

    squares: FloatArray
    counts: FloatArray
    chi2: float

    @property
    def rms_nm(self) -> float:
        """Root mean square, N m."""
        return float(np.sqrt(self.squares.sum() / max(float(self.counts.sum()), 1.0)))


@dataclass(frozen=True, slots=True)
class _Piece:
    """One record in time.

    Parameters
    ----------
    plain : ndarray of float32, shape (k + 1, n)
        Rows in time, the measured torque last.
    folds : ndarray of int, shape (n,)
        Fold of each sample.
    used : ndarray of bool, shape (n,)
        Samples that are predicted.
    length : int
        Samples of one piece of the bootstrap.
    """

    plain: NDArray[np.float32]
    folds: NDArray[np.int64]
    used: NDArray[np.bool_]
    length: int


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Columns of a fit in time, and the products of the whitened ones in each fold.

    Parameters
    ----------
    fit : Fit
        Joint fit.
    rows : ndarray of int, shape (k,)
        Active rows of the fit.
    pieces : tuple of _Piece
        The record, or each record of a stack.
    grams : ndarray, shape (n_folds, k + 1, k + 1)
        Products of white rows in each fold.
    """

    fit: Fit
    rows: NDArray[np.int64]
    pieces: tuple[_Piece, ...]
    grams: FloatArray

    def predict(self, parts: set[int]) -> Prediction:
        """Return the prediction of every fold from the others by these parts of the fit."""
        each = self.predict_each(parts)
        return Prediction(
            np.concatenate([one.squares for one in each]),
            np.concatenate([one.counts for one in each]),
            each[0].chi2,
        )

    def predict_each(self, parts: set[int]) -> list[Prediction]:
        """Return the same for each record; the whitened sum is that of all."""
        fit = self.fit
        kept = np.flatnonzero(np.isin(fit.owner[self.rows], list(parts)))
        coefficients = fit.coefficients[self.rows][kept]
        wide = (_WIDER * np.abs(coefficients)) ** 2 + 1e-12 * float(
            np.max(coefficients**2, initial=1.0)
        )
        penalty = np.maximum(fit.penalty[self.rows][kept], 1.0 / wide)
        known = (fit.penalty * fit.expected)[self.rows][kept]
        total = self.grams.sum(axis=0)
        squares = [np.zeros(len(piece.used)) for piece in self.pieces]
        chi2 = 0.0
        for fold, own in enumerate(self.grams):
            rest = total - own
            matrix = rest[np.ix_(kept, kept)] + np.diag(penalty)
            scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
            solution = (
                scale
                * np.linalg.lstsq(
                    matrix * np.outer(scale, scale), scale * (rest[kept, -1] + known), rcond=1e-12
                )[0]
            )
            for piece, out in zip(self.pieces, squares, strict=True):
                inside = (piece.folds == fold) & piece.used
                plain = piece.plain[:, inside]
                left = plain[-1] - solution.astype(np.float32) @ plain[kept]
                out[inside] = left.astype(np.float64) ** 2
            v = np.append(-solution, 1.0)
            at = np.append(kept, len(self.rows))
            chi2 += float(v @ own[np.ix_(at, at)] @ v)
        found = []
        for piece, out in zip(self.pieces, squares, strict=True):
            edges = np.arange(0, len(out), piece.length)
            counts = np.add.reduceat(piece.used.astype(float), edges)
            found.append(Prediction(np.add.reduceat(out, edges), counts, chi2))
        return found


def _piece_length(record: Record) -> int:
    """Return the samples of one piece: an output turn where twenty of them fit."""
    turn = record.motion.output_angle_rad[record.valid]
    travelled = float(np.abs(np.diff(turn)).sum()) / (2.0 * np.pi)
    n = len(record)
    return int(np.clip(n / max(travelled, 1e-9), 1, max(1, n // _BLOCKS)))


def hold_out(fit: Fit) -> HeldOut:
    """Return the columns of a fit in time, cut into blocks."""
    from scipy.fft import idct

    rows = np.flatnonzero(fit.active)
    pieces = []
    grams = np.zeros((_FOLDS, len(rows) + 1, len(rows) + 1))
    for one, at in zip(glances(fit), coefficients_of(fit), strict=True):
        bands, n = one.bands, len(one.record)
        whiten = np.sqrt(bands.spread(1.0 / one.noise))
        plain = np.empty((len(rows) + 1, n), dtype=np.float32)
        white = np.empty_like(plain)
        buffer = np.zeros(bands.length)
        for place, row in enumerate([*fit.rows[rows], fit.measured]):
            buffer[: bands.size] = row[at]
            plain[place] = idct(buffer, norm="ortho")[:n]
            buffer[: bands.size] = row[at] * whiten
            white[place] = idct(buffer, norm="ortho")[:n]
        folds = (np.arange(n) * _BLOCKS // n) % _FOLDS
        for fold in range(_FOLDS):
            part = white[:, folds == fold].astype(np.float64)
            grams[fold] += part @ part.T
        used = one.record.valid & (bands.fade > 0.999)
        pieces.append(_Piece(plain, folds, used, _piece_length(one.record)))
    return HeldOut(fit, rows, tuple(pieces), grams)


def gain_between(before: Prediction, after: Prediction, rng: np.random.Generator) -> Gain:
    """Return the gain from one prediction to the other, its interval by a paired block bootstrap.

    References
    ----------
    .. [1] H. R. Kuensch, Ann. Statist. 17 (1989) 1217, doi:10.1214/aos/1176347265.
    """
    pick = rng.integers(0, len(before.squares), (_DRAWS, len(before.squares)))
    old = np.maximum(before.squares[pick].sum(axis=1), 1e-300)
    fractions = 1.0 - after.squares[pick].sum(axis=1) / old
    low, high = np.percentile(fractions, (2.5, 97.5))
    total = max(float(before.squares.sum()), 1e-300)
    return Gain(
        before.rms_nm,
        after.rms_nm,
        float(1.0 - after.squares.sum() / total),
        (float(low), float(high)),
    )
