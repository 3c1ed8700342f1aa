"""How the members of a bank stand in a space: what makes a statistic of their numerators."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.detect.bank import Bank, Gram
from hdbench.diagnosis.noise.whitened import Space
from hdbench.records.trace import FloatArray

__all__ = ["Geometry", "geometry"]

# share of a column that must be left after the explained part was projected out
_MIN_SHARE = 0.01
# whitened size squared of a column of which 1000 N m are one standard deviation
_FAINTEST = 1e-6


@dataclass(frozen=True, slots=True)
class Geometry:
    """How the members of a bank stand in a space.

    Parameters
    ----------
    cross : ndarray, shape (q, n_columns)
        What the explained columns have in common with the whitened ones.
    weights : tuple of ndarray
        Of each member, shape (k, dof): the squares of its numerators times these add up to its
        statistic.
    sigma_nm : ndarray, shape (n_members,)
        Standard deviation of each member's largest torque, N m; infinite where nothing is left.
    """

    cross: FloatArray
    weights: tuple[FloatArray, ...]
    sigma_nm: FloatArray

    def dof(self) -> NDArray[np.int64]:
        """Return the degrees of freedom of each member."""
        return np.array([w.shape[1] for w in self.weights], dtype=np.int64)

    def statistics(self, bank: Bank, numerators: FloatArray) -> FloatArray:
        """Return the statistic of each member, shape (n_members, draws).

        Parameters
        ----------
        bank : Bank
            Bank.
        numerators : ndarray, shape (n_columns, draws)
            ``X' pull``.

        Returns
        -------
        ndarray
        """
        rows = [
            np.sum((w.T @ numerators[m.place]) ** 2, axis=0)
            for m, w in zip(bank.members, self.weights, strict=True)
        ]
        return np.array(rows).reshape(len(rows), numerators.shape[1])


def geometry(bank: Bank, gram: Gram, space: Space) -> Geometry:
    """Return how the members of a bank stand in a space.

    Parameters
    ----------
    bank : Bank
        Bank.
    gram : Gram
        As `bank_gram` gives it for the whitener of `space`.
    space : Space
        Whitened residual.

    Returns
    -------
    Geometry
    """
    cross = (space.pull_basis.astype(np.float32).T @ bank.table).astype(np.float64)
    weights: list[FloatArray] = []
    sigmas: list[float] = []
    for place, block, index in zip(
        bank.family_places, gram.blocks, bank.families.values(), strict=True
    ):
        left = block - cross[:, place].T @ cross[:, place]
        for member in (bank.members[k] for k in index):
            own = slice(member.place.start - place.start, member.place.stop - place.start)
            weight, sigma = _weights(np.diag(block)[own], left[own, own])
            weights.append(weight)
            sigmas.append(member.peak_nm * sigma)
    return Geometry(cross, tuple(weights), np.array(sigmas))


def _weights(before: FloatArray, left: FloatArray) -> tuple[FloatArray, float]:
    """Return what makes a statistic of numerators, and the standard deviation per unit norm."""
    if not np.all(before > _FAINTEST):
        return np.zeros((len(before), 0)), np.inf
    scale = 1.0 / np.sqrt(before)
    values, vectors = np.linalg.eigh(left * np.outer(scale, scale))
    good = values > _MIN_SHARE
    if not good.any():
        return np.zeros((len(before), 0)), np.inf
    weight = scale[:, None] * vectors[:, good] / np.sqrt(values[good])
    return weight, float(1.0 / np.sqrt(np.trace(left)))
