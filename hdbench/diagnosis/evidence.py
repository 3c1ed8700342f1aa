"""Evidence of linear models with form error: small dense algebra, no data of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from hdbench.records.trace import FloatArray

# told what is being done and the share done
Told = Callable[[str, float], None]
# contract: names within this many nats of the best are rivals, a Bayes factor of 20
RIVAL_NATS = 3.0
# contract: sine squared of the largest angle below which names span the same space
SAME_SPACE = 0.01
# a name says what an effect is if it spans this share of its squares
SPANS = 0.95
# values beyond its parameters that noise needs before anything is held against its scatter
LEAST_DOF = 3
# a step of time longer than this many median periods is a gap: one lost sample makes 2
GAP = 1.5
# a cause of which the torque channel passes less than this share of its power is not seen there
PASSED = 0.1
# of columns of length 1, what is below this share of the largest is rounding
RANK = 1e-9


def silent(_what: str, _share: float) -> None:
    """Tell nobody how far a computation is."""


def check_rates(alpha: float, materiality: float) -> None:
    """Raise ValueError where the false-alarm rate or the least share is out of its domain."""
    if not 0.0 < alpha < 1.0:
        raise ValueError(f"alpha {alpha!r} must be in (0, 1)")
    if not 0.0 <= materiality < 1.0:
        raise ValueError(f"materiality {materiality!r} must be in [0, 1)")


def scaled(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return columns of length 1, and their lengths; a column of zeros has 1."""
    size = np.sqrt(np.einsum("nk,nk->k", columns, columns))
    size = np.where(size > 0.0, size, 1.0)
    return columns / size, size


def orthonormal(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis of the columns' span, shape (n, rank)."""
    from scipy.linalg import qr

    seen = scaled(columns)[0][:, columns.any(axis=0)]
    if not seen.size:
        return np.zeros((len(columns), 0))
    q, r, _ = qr(seen, mode="economic", pivoting=True)
    pivots = np.abs(np.diag(r))
    return np.asarray(q[:, pivots > RANK * pivots[0]])


def sine_squared(first: FloatArray, second: FloatArray) -> float:
    """Return the sine squared of the largest angle between two spaces; 1 at unequal rank."""
    if first.shape[1] != second.shape[1] or not first.shape[1]:
        return 1.0
    if first.shape[1] == 1:
        return 1.0 - float(first[:, 0] @ second[:, 0]) ** 2
    return 1.0 - float(np.linalg.svd(first.T @ second, compute_uv=False).min()) ** 2


def chi2_tail(value: float, dof: float) -> float:
    """Return the probability of a chi^2 of `dof` above `value`."""
    from scipy.special import chdtrc

    return float(chdtrc(dof, max(value, 0.0)))


def chi2_tails(values: FloatArray, dof: float) -> FloatArray:
    """Return the probability of a chi^2 of `dof` above each value."""
    from scipy.special import chdtrc

    return np.asarray(chdtrc(dof, np.maximum(values, 0.0)))


def chi2_level(chance: float, dof: float) -> float:
    """Return the value that a chi^2 of `dof` exceeds with this probability."""
    from scipy.special import chdtri

    return float(chdtri(dof, chance))


def share_p_value(share: FloatArray | float, rank: int, dof: int) -> FloatArray:
    """Return how often noise of any size has this share of its squares along `rank` of `dof`."""
    from scipy.special import betainc

    # the law of the share is Beta(rank / 2, (dof - rank) / 2): the F test
    return np.asarray(betainc((dof - rank) / 2.0, rank / 2.0, np.clip(1.0 - share, 0.0, 1.0)))


def any_of(p_value: FloatArray | float, trials: float) -> FloatArray:
    """Return ``1 - (1 - p)^trials`` without loss for small p."""
    return np.asarray(-np.expm1(trials * np.log1p(-np.minimum(p_value, 1.0 - 1e-16))))


def marginal_nats(
    left: FloatArray, forms: FloatArray, dof: int, floor: float
) -> tuple[float, float]:
    """Return the log likelihood of a residual of white noise and form error, and the noise.

    `forms`, less all free columns, has directions of form error, each as long as its standard
    deviation; of `dof` degrees of freedom the noise has the likeliest variance of `floor` or more.
    """
    total = float(left @ left)
    if not forms.shape[1]:
        variance = max(total / dof, floor)
        return -0.5 * (dof * float(np.log(variance)) + total / variance), variance
    values, vectors = np.linalg.eigh(forms.T @ forms)
    good = values > max(values[-1], 0.0) * RANK
    scales = values[good]
    along = (vectors[:, good].T @ (forms.T @ left)) ** 2 / scales
    rest = max(total - float(along.sum()), 0.0)
    low = max(0.5 * rest / dof, floor)
    # the logarithm of the likelihood is flat at its top: 200 equal ratios over the possible range
    # cost less than 0.01 nats
    grid = np.geomspace(low, max(2.0 * total / dof, 2.0 * low), 200)
    both = grid[:, None] + scales[None, :]
    twice = (dof - len(scales)) * np.log(grid) + rest / grid + (np.log(both) + along / both).sum(1)
    best = int(np.argmin(twice))
    return -0.5 * float(twice[best]), float(grid[best])


def rivals(table: Mapping[str, float], name: str) -> tuple[str, ...]:
    """Return the names within 3 nats of one, the best first."""
    near = [other for other in table if other != name and table[name] - table[other] <= RIVAL_NATS]
    return tuple(sorted(near, key=lambda other: -table[other]))


def probabilities(table: Mapping[str, float]) -> dict[str, float]:
    """Return the probability of each name where all are as likely beforehand."""
    from scipy.special import softmax

    return dict(zip(table, softmax(list(table.values())).tolist(), strict=True))
