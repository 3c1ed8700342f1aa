"""Normal equations of base and causes, block by block: only columns that moved are formed anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.fit.normal import Normal, normal_solve
from hdbench.diagnosis.fit.terms import Term, term_columns
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.noise.whitened import Whitener
from hdbench.records.trace import FloatArray

__all__ = ["Design", "Solved"]


@dataclass(frozen=True, slots=True)
class Solved:
    """Linear solution at given shapes.

    Parameters
    ----------
    terms : tuple of Term
        Causes with their shapes.
    raw, white : tuple of ndarray
        Columns of each term, zero where a parameter is at its bound, and these whitened.
    solution : ndarray, shape (k,)
        Coefficients of base and terms.
    normal : Normal
        Normal equations.
    chi2 : float
        Sum of squares of the whitened residual.
    """

    terms: tuple[Term, ...]
    raw: tuple[FloatArray, ...]
    white: tuple[FloatArray, ...]
    solution: FloatArray
    normal: Normal
    chi2: float


@dataclass(frozen=True, slots=True)
class Design:
    """What stays the same while shapes move: base and response, whitened.

    Parameters
    ----------
    record : Record
        Record.
    whitener : Whitener
        Noise.
    base : ndarray, shape (n, q)
        Whitened base.
    gram : ndarray, shape (q, q)
        It times itself.
    response : ndarray, shape (n,)
        Whitened response.
    right : ndarray, shape (q,)
        Base times response.
    """

    record: Record
    whitener: Whitener
    base: FloatArray
    gram: FloatArray
    response: FloatArray
    right: FloatArray

    @classmethod
    def of(cls, record: Record, whitener: Whitener) -> Design:
        """Whiten base and response of a record."""
        base, gram = whitener.whitened_base(record.base)
        response = whitener.apply(record.response_nm)
        return cls(record, whitener, base, gram, response, base.T @ response)

    def solve(self, terms: tuple[Term, ...], last: Solved | None = None) -> Solved:
        """Return the linear solution at the shapes of terms; columns that `last` has are kept."""
        raw, white = self._columns(terms, last)
        gram, right = self.normal(white)
        solution, _ = normal_solve(gram, right)
        first = self.base.shape[1]
        edges = first + np.cumsum([0, *(block.shape[1] for block in raw)])
        slices = tuple(slice(int(a), int(b)) for a, b in pairwise(edges))
        while (outside := _below_zero(terms, solution[first:])).any():
            # at its bound of zero a parameter's column takes no part
            for k, part in enumerate(slices):
                own = outside[part.start - first : part.stop - first]
                if own.any():
                    raw[k], white[k] = np.where(own, 0.0, raw[k]), np.where(own, 0.0, white[k])
            place = first + np.flatnonzero(outside)
            gram[place] = 0.0
            gram[:, place] = 0.0
            right[place] = 0.0
            solution, _ = normal_solve(gram, right)
            solution[np.diag(gram) == 0.0] = 0.0
        left = self.response - self.base @ solution[:first]
        for block, part in zip(white, slices, strict=True):
            left -= block @ solution[part]
        total = float(self.response @ self.response)
        normal = Normal(gram, right, total, slices)
        return Solved(terms, tuple(raw), tuple(white), solution, normal, float(left @ left))

    def _columns(
        self, terms: tuple[Term, ...], last: Solved | None
    ) -> tuple[list[FloatArray], list[FloatArray]]:
        """Return the columns of terms, and these whitened."""
        raw = [term_columns(term, self.record) for term in terms]
        white = []
        for k, block in enumerate(raw):
            same = last is not None and block is last.raw[k]
            white.append(last.white[k] if same and last is not None else self.whitener.apply(block))
        return raw, white

    def normal(self, blocks: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return base and blocks times themselves and times the response, block by block."""
        beside = np.hstack([np.zeros((len(self.base), 0)), *blocks])
        cross, own = self.base.T @ beside, beside.T @ beside
        gram = np.block([[self.gram, cross], [cross.T, own]])
        return gram, np.concatenate([self.right, beside.T @ self.response])

    def with_slopes(
        self, state: Solved, tangents: Sequence[FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the normal equations of a state with slopes beside its columns."""
        slopes = [self.whitener.apply(block) for block in tangents]
        if not sum(block.shape[1] for block in slopes):
            return state.normal.gram, state.normal.right
        beside = np.hstack(slopes)
        blocks = (self.base, *state.white)
        cross = np.vstack([block.T @ beside for block in blocks])
        gram = np.block([[state.normal.gram, cross], [cross.T, beside.T @ beside]])
        return gram, np.concatenate([state.normal.right, beside.T @ self.response])


def _below_zero(terms: tuple[Term, ...], linear: FloatArray) -> NDArray[np.bool_]:
    """Return which linear parameters are negative though their domain begins at zero."""
    lower = [parameter.lower for term in terms for parameter in term.cause.linear]
    return np.asarray((np.array(lower) == 0.0) & (linear < 0.0), dtype=bool)
