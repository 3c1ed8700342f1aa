"""How high noise alone reaches among many members of many families."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincc, gammainccinv

from hdbench.diagnosis.detect.bank import Bank, Gram
from hdbench.diagnosis.detect.geometry import Geometry
from hdbench.diagnosis.noise.whitened import Space
from hdbench.records.trace import FloatArray

__all__ = ["FamilyLaw", "Law", "draw_law", "local_p"]

# draws of the numerators: a level of 5 % is known to 10 %
_DRAWS = 2000
_LEVEL = 0.05
_SMALLEST = 1e-300


def local_p(statistic: FloatArray, dof: FloatArray) -> FloatArray:
    """Return the probability that noise alone reaches statistics at one place.

    Parameters
    ----------
    statistic, dof : ndarray
        chi^2 and its degrees of freedom; 1 where these are zero.

    Returns
    -------
    ndarray
        At least 1e-300.
    """
    p = gammaincc(np.maximum(dof, 1) / 2.0, statistic / 2.0)
    return np.where(dof > 0, np.maximum(p, _SMALLEST), 1.0)


@dataclass(frozen=True, slots=True)
class FamilyLaw:
    """Probability of the smallest local p-value of a family, without its effect.

    Parameters
    ----------
    slope : float
        Trials are ``1 + slope c^(shapes / 2)``, c the chi^2 of the local p-value: the law of the
        maximum of a smooth chi^2 field over that many dimensions. Harmonics that are tried alone
        beside all together are some more of them at any level.
    shapes : int
        Shape parameters.
    dof : int
        Degrees of freedom of its members.
    """

    slope: float
    shapes: int
    dof: int

    def trials(self, p: FloatArray) -> FloatArray:
        """Return the effective number of independent members at a local p-value."""
        if self.slope <= 0.0:
            return np.ones_like(p)
        c = 2.0 * gammainccinv(0.5 * self.dof, np.maximum(p, _SMALLEST))
        return np.asarray(1.0 + self.slope * c ** (0.5 * self.shapes))

    def probability(self, p: FloatArray) -> FloatArray:
        """Return the probability of a local p-value that small anywhere in the family."""
        return np.minimum(1.0, p * self.trials(p))


@dataclass(frozen=True, slots=True)
class Law:
    """Law of a bank: of each family, and of all together.

    Parameters
    ----------
    families : mapping of str to FamilyLaw
        By name.
    together : float
        Effective number of independent families.
    """

    families: dict[str, FamilyLaw]
    together: float


def draw_law(
    bank: Bank, gram: Gram, shape: Geometry, space: Space, rng: np.random.Generator
) -> Law:
    """Return the law of a bank in a space, by draws of noise in the space of its columns.

    Parameters
    ----------
    bank : Bank
        Bank.
    gram : Gram
        Its whitened columns.
    shape : Geometry
        Its geometry.
    space : Space
        Whitened residual.
    rng : Generator
        For the draws.

    Returns
    -------
    Law

    Notes
    -----
    The numerators of all members are normal with a known covariance when there is no effect, so
    that a draw costs a product with its root and no record has to be simulated. Level by level:
    the smallest p-value of a family gives its trials, the smallest of the families' probabilities
    gives how many of them are independent. Covariances between families are those of a sixth of
    the samples.
    """
    if not bank.members:
        return Law({}, 1.0)
    left = gram.sample - space.basis[gram.rows].astype(np.float32) @ shape.cross.astype(np.float32)
    covariance = (left.T @ left).astype(np.float64) * (len(bank.table) / max(1, len(left)))
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    draws = root @ rng.standard_normal((len(values), _DRAWS))
    laws: dict[str, FamilyLaw] = {}
    smallest = np.ones(_DRAWS)
    dof = shape.dof()
    for name, index in bank.families.items():
        alive = [k for k in index if dof[k] > 0]
        if not alive:
            continue
        p = _smallest_p(bank, shape, draws, alive, covariance)
        law = _family_law(p, len(alive), len(bank.members[alive[0]].term.shape), int(dof[alive[0]]))
        laws[name] = law
        smallest = np.minimum(smallest, law.probability(p))
    level = float(np.quantile(smallest, _LEVEL))
    # no more than there are, however the draws fell
    together = min(float(len(laws)), _LEVEL / max(level, _SMALLEST))
    return Law(laws, max(1.0, together))


def _smallest_p(
    bank: Bank, shape: Geometry, draws: FloatArray, alive: list[int], covariance: FloatArray
) -> FloatArray:
    """Return the smallest local p-value of a family's members in each draw."""
    dof = shape.dof()
    largest: dict[int, FloatArray] = {}
    for k in alive:
        place, weight = bank.members[k].place, shape.weights[k]
        # the sampled covariance differs a little from the one that the weights are made for
        inner = weight.T @ covariance[place, place] @ weight
        values, vectors = np.linalg.eigh(inner)
        even = weight @ (vectors / np.sqrt(np.maximum(values, 1e-12)))
        value = np.sum((even.T @ draws[place]) ** 2, axis=0)
        before = largest.get(int(dof[k]))
        largest[int(dof[k])] = value if before is None else np.maximum(before, value)
    p = [local_p(value, np.full(len(value), float(k))) for k, value in largest.items()]
    return np.asarray(np.min(p, axis=0))


def _family_law(p: FloatArray, members: int, shapes: int, dof: int) -> FamilyLaw:
    if members == 1:
        return FamilyLaw(0.0, shapes, dof)
    level = float(np.quantile(p, _LEVEL))
    trials = max(1.0, _LEVEL / max(level, _SMALLEST))
    c = 2.0 * float(gammainccinv(0.5 * dof, max(level, _SMALLEST)))
    return FamilyLaw((trials - 1.0) / max(c, 1.0) ** (0.5 * shapes), shapes, dof)
