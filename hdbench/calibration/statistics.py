"""The mean gain over flexspline positions and the spread of gains, with uncertainties."""

from __future__ import annotations

import math

import numpy as np

from hdbench.calibration.lines import ExperimentLine
from hdbench.records.quantity import Quantity

__all__ = ["consistency_interval", "mean_gain", "shared_dof"]

# positions closer than this are one position: far below a tooth, above the rounding of a file
_POSITION_RAD = 1e-4


def _by_position(lines: tuple[ExperimentLine, ...]) -> list[list[ExperimentLine]]:
    """Group experiments by flexspline position; a full turn is the same position."""
    groups: list[list[ExperimentLine]] = []
    for line in lines:
        for group in groups:
            apart = math.remainder(line.position_rad - group[0].position_rad, 2.0 * math.pi)
            if abs(apart) < _POSITION_RAD:
                group.append(line)
                break
        else:
            groups.append([line])
    return groups


def mean_gain(lines: tuple[ExperimentLine, ...]) -> tuple[Quantity, str, str]:
    """Return the mean gain with the uncertainty of a mean over flexspline positions.

    Parameters
    ----------
    lines : tuple of ExperimentLine
        At least one experiment.

    Returns
    -------
    gain : Quantity
        Plain mean of the gains, N m/V.
    basis : str
        ``positions``, ``positions-unbalanced`` or ``residual``.
    reason : str
        One line that says what the uncertainty rests on.

    Notes
    -----
    What is estimated is the gain averaged over flexspline positions. The position is a random
    effect; directions and ranges are fixed effects whose average is wanted. Experiments at one
    position share its effect and are not independent: with P positions and as many experiments
    of each direction and range at each, ``std = s / sqrt(P)``, s the standard deviation of the
    P position means, with P - 1 dof; position effect, differences of direction between
    positions and reading noise are all in s. Unbalanced: ``std = s sqrt(sum (n_i / n)^2)``, an
    approximation, because then the fixed effects do not cancel in s. With a single position the
    spread between positions is unknown: the pooled residual of the lines gives the uncertainty
    at this position alone, which is marked.

    References
    ----------
    .. [1] S. R. Searle, G. Casella, C. E. McCulloch, Variance Components, Wiley 1992, chapter 3.
    """
    gains = np.array([line.gain_nm_per_v.value for line in lines])
    value = float(gains.mean())
    groups = _by_position(lines)
    if len(groups) < 2:
        variances = [line.gain_nm_per_v.std**2 for line in lines]
        dof = math.fsum(line.gain_nm_per_v.dof or 0.0 for line in lines)
        reason = (
            "one flexspline position: the uncertainty comes from the residuals of the lines and "
            "leaves out the spread between positions"
        )
        return (
            Quantity(value, math.sqrt(math.fsum(variances)) / len(lines), dof),
            "residual",
            reason,
        )
    means = [math.fsum(x.gain_nm_per_v.value for x in group) / len(group) for group in groups]
    spread = float(np.std(means, ddof=1))
    share = math.sqrt(math.fsum((len(group) / len(lines)) ** 2 for group in groups))
    cells = [sorted((x.direction, x.range) for x in group) for group in groups]
    balanced = all(cell == cells[0] for cell in cells)
    basis = "positions" if balanced else "positions-unbalanced"
    reason = (
        f"spread of {len(groups)} position means"
        if balanced
        else f"spread of {len(groups)} position means that do not hold the same directions and "
        "ranges: differences between these are in the spread"
    )
    return Quantity(value, spread * share, float(len(groups) - 1)), basis, reason


def shared_dof(lines: tuple[ExperimentLine, ...]) -> float:
    """Return the effective dof of the spread of gains that share positions.

    Parameters
    ----------
    lines : tuple of ExperimentLine
        At least two experiments.

    Returns
    -------
    float
        Between 1 and the number of experiments less one.

    Notes
    -----
    With sums of squares B between and W within positions, of b and w dof:
    ``(B + W)^2 / (B^2 / b + W^2 / w)``.

    References
    ----------
    .. [1] F. E. Satterthwaite, Biometrics Bull. 2 (1946) 110, doi:10.2307/3002019.
    """
    groups = _by_position(lines)
    gains = [np.array([x.gain_nm_per_v.value for x in group]) for group in groups]
    total = float(np.concatenate(gains).mean())
    between = math.fsum(len(g) * (float(g.mean()) - total) ** 2 for g in gains)
    within = math.fsum(float(((g - g.mean()) ** 2).sum()) for g in gains)
    n_between, n_within = len(groups) - 1, len(lines) - len(groups)
    loss = (between**2 / n_between if n_between else 0.0) + (
        within**2 / n_within if n_within else 0.0
    )
    # no spread at all: every gain the same, dof as for independent gains
    return (between + within) ** 2 / loss if loss > 0.0 else float(len(lines) - 1)


def consistency_interval(
    consistency: float, dof: float, confidence: float = 0.95
) -> tuple[float, float | None]:
    """Return the interval of a coefficient of variation of normal values.

    Parameters
    ----------
    consistency : float
        Standard deviation over mean, at least 0.
    dof : float
        Degrees of freedom of that standard deviation, above 0.
    confidence : float
        Coverage probability, in (0, 1).

    Returns
    -------
    tuple of (float, float or None)
        Lower and upper end; None where the interval has no upper end.

    Notes
    -----
    With n = dof + 1 and u the chi-square quantile of dof degrees of freedom (upper for the
    lower end): ``C / sqrt(((u + 2) / n - 1) C^2 + u / (n - 1))``.

    References
    ----------
    .. [1] M. G. Vangel, Am. Stat. 50 (1996) 21, doi:10.1080/00031305.1996.10473537.
    """
    from scipy.special import chdtri

    n = dof + 1.0
    tail = (1.0 - confidence) / 2.0
    ends: list[float | None] = []
    # chdtri takes the probability above the quantile
    for u in (float(chdtri(dof, tail)), float(chdtri(dof, 1.0 - tail))):
        square = ((u + 2.0) / n - 1.0) * consistency**2 + u / dof
        ends.append(consistency / math.sqrt(square) if square > 0.0 else None)
    low, high = ends
    return (0.0 if low is None else low), high
