"""Evidence of linear models with form error: small dense algebra, no data of its own."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdbench.records.trace import FloatArray

__all__ = [
    "RIVAL_NATS",
    "SAME_SPACE",
    "marginal_nats",
    "orthonormal",
    "probabilities",
    "rivals",
    "share_p_value",
    "sine_squared",
]

# contract: names within this many nats of the best are rivals, a Bayes factor of 20
RIVAL_NATS = 3.0
# contract: sine squared of the largest angle below which names span the same space
SAME_SPACE = 0.01
# scaled directions below this share of the largest are rounding
_RANK = 1e-9
# the noise is looked for in equal ratios; the logarithm of the likelihood is flat at its top, so
# that this many steps over the possible range cost less than 0.01 nats
_NOISE_STEPS = 200
# odds beyond this are beyond all doubt
_MOST_NATS = 100.0


def orthonormal(columns: FloatArray, least: float = _RANK) -> FloatArray:
    """Return an orthonormal basis of the columns' span, shape (n, rank).

    Parameters
    ----------
    columns : ndarray, shape (n, k)
        Finite numbers.
    least : float
        Pivots below this share of the largest are none.

    Returns
    -------
    ndarray, shape (n, rank)
    """
    if not columns.size:
        return np.zeros((len(columns), 0))
    from scipy.linalg import qr

    size = np.sqrt(np.einsum("nk,nk->k", columns, columns))
    seen = columns[:, size > 0.0] / size[size > 0.0]
    if not seen.size:
        return np.zeros((len(columns), 0))
    q, r, _ = qr(seen, mode="economic", pivoting=True)
    pivots = np.abs(np.diag(r))
    return np.asarray(q[:, : len(pivots)][:, pivots > least * pivots[0]])


def sine_squared(first: FloatArray, second: FloatArray) -> float:
    """Return the sine squared of the largest angle between two spaces; 1 at unequal rank.

    Parameters
    ----------
    first, second : ndarray, shape (n, rank)
        Orthonormal bases.

    Returns
    -------
    float
    """
    if first.shape[1] != second.shape[1] or not first.shape[1]:
        return 1.0
    if first.shape[1] == 1:
        return 1.0 - float(first[:, 0] @ second[:, 0]) ** 2
    return 1.0 - float(np.linalg.svd(first.T @ second, compute_uv=False).min()) ** 2


def share_p_value(share: float, rank: int, dof: int) -> float:
    """Return the probability that noise of any size puts this share along `rank` of `dof`.

    Parameters
    ----------
    share : float
        Share of the sum of squares, in [0, 1].
    rank, dof : int
        Directions, and degrees of freedom.

    Returns
    -------
    float
        Of the law Beta(rank / 2, (dof - rank) / 2), the F test; 1 where nothing is left to compare.
    """
    from scipy.special import betainc

    if not dof > rank > 0:
        return 1.0
    return float(betainc((dof - rank) / 2.0, rank / 2.0, min(max(1.0 - share, 0.0), 1.0)))


def marginal_nats(
    left: FloatArray, forms: FloatArray, dof: int, floor: float
) -> tuple[float, float]:
    r"""Return the log likelihood of a residual of white noise and form error, and the noise.

    Parameters
    ----------
    left : ndarray, shape (n,)
        Residual of all free columns.
    forms : ndarray, shape (n, m)
        Directions of form error less the free columns, each as large as its standard deviation.
    dof : int
        Degrees of freedom that are compared, common to all models that are.
    floor : float
        Smallest variance that the noise can have, the data's rounding.

    Returns
    -------
    nats : float
        At the noise that makes it largest.
    variance : float
        That noise.

    Notes
    -----
    .. math:: -\tfrac12\left[(d - m)\ln s^2 + \sum_i \ln(s^2 + u_i^2) + r^T K^{-1} r\right],
        \quad K = s^2 I + U U^T
    """
    total = float(left @ left)
    if not forms.shape[1]:
        variance = max(total / dof, floor)
        return -0.5 * (dof * float(np.log(variance)) + total / variance), variance
    values, vectors = np.linalg.eigh(forms.T @ forms)
    good = values > max(values[-1], 0.0) * _RANK
    scales = values[good]
    along = (vectors[:, good].T @ (forms.T @ left)) ** 2 / scales
    rest = max(total - float(along.sum()), 0.0)
    low = max(0.5 * rest / dof, floor)
    grid = np.geomspace(low, max(2.0 * total / dof, 2.0 * low), _NOISE_STEPS)
    both = grid[:, None] + scales[None, :]
    twice = (dof - len(scales)) * np.log(grid) + rest / grid + (np.log(both) + along / both).sum(1)
    best = int(np.argmin(twice))
    return -0.5 * float(twice[best]), float(grid[best])


def rivals(table: Mapping[str, float], name: str) -> tuple[str, ...]:
    """Return the names within 3 nats of one, the best first.

    Parameters
    ----------
    table : mapping of str to float
        Evidence of each name, nats.
    name : str
        The one.

    Returns
    -------
    tuple of str
    """
    near = [other for other in table if other != name and table[name] - table[other] <= RIVAL_NATS]
    return tuple(sorted(near, key=lambda other: -table[other]))


def probabilities(table: Mapping[str, float]) -> dict[str, float]:
    """Return the probability of each name where all are as likely beforehand.

    Parameters
    ----------
    table : mapping of str to float
        Evidence of each name, nats.

    Returns
    -------
    dict
        Shares of 1.
    """
    top = max(table.values())
    odds = {name: float(np.exp(max(nats - top, -_MOST_NATS))) for name, nats in table.items()}
    total = sum(odds.values())
    return {name: value / total for name, value in odds.items()}
