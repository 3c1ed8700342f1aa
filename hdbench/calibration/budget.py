"""Budget of the mean gain: sources of uncertainty, what they add up to, and random draws."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from hdbench.calibration.gains import any_one_position, by_position
from hdbench.calibration.lever import budget_row
from hdbench.profile.schema import ProfileData
from hdbench.records.quantity import Quantity, coverage_factor
from hdbench.records.trace import FloatArray
from hdbench.results import calibration as record

# number of trials that fixes the ends of a 95 % interval to two digits of the uncertainty
_DRAWS = 1_000_000
# standard uncertainties of an end within which chance differs in 1 of 400 cases
_SIGMAS = 3.0
# the density about an end is that of this share of the trials to either side
_SPAN = 500
# trials in hand at a time: 2 MB per array
_BLOCK = 250_000
# dof above which Student's t is the normal distribution to four digits of k
_MANY_DOF = 1e6


@dataclass(frozen=True, slots=True)
class ExpandedUncertainty:
    """A standard uncertainty, its degrees of freedom, and the 95 % interval they make."""

    std: float
    dof: float | None
    coverage_factor: float
    expanded: float


def expanded_uncertainty(std: float, dof: float | None) -> ExpandedUncertainty:
    """Return the expanded uncertainty with k from the degrees of freedom.

    References
    ----------
    .. [1] JCGM 100:2008, annex G.
    """
    known = dof if dof is not None and dof < _MANY_DOF else None
    k = coverage_factor(known)
    return ExpandedUncertainty(std, known, k, k * std)


def expanded_gain(value: float, found: ExpandedUncertainty | None) -> record.ExpandedGain | None:
    """Return an expanded uncertainty beside the gain that it belongs to."""
    if found is None:
        return None
    return record.ExpandedGain(
        value=value,
        **asdict(found),
        expanded_relative=found.expanded / abs(value) if value else None,
    )


def combined(parts: Sequence[tuple[float, float | None]]) -> tuple[float, float | None]:
    """Return root sum of squares and effective degrees of freedom.

    References
    ----------
    .. [1] F. E. Satterthwaite, Biometrics Bull. 2 (1946) 110; JCGM 100:2008, equation G.2b.
    """
    variance = math.fsum(std**2 for std, _ in parts)
    loss = math.fsum(std**4 / dof for std, dof in parts if dof is not None)
    return math.sqrt(variance), variance**2 / loss if loss > 0.0 else None


def gain_rows(
    gain: Quantity,
    lines: tuple[record.ExperimentLine, ...],
    torque_rows: tuple[record.BudgetRow, ...],
    bench: ProfileData | None,
) -> tuple[record.BudgetRow, ...]:
    """Return the budget of the mean gain."""
    relative, n = gain.std / abs(gain.value), len(lines)
    scatter = record.BudgetRow(
        name="scatter of the gain",
        group="gain",
        half_width=relative,
        distribution="t",
        relative_std=relative,
        dof=gain.dof,
        declared=True,
        origin=f"{n} experiments" if n > 1 else "residuals of one line",
    )
    loading = "single" if bench is None else bench.arm.loading
    return (scatter, *torque_rows, *_instrument(bench), *_side_force(lines, loading))


def _instrument(bench: ProfileData | None) -> tuple[record.BudgetRow, ...]:
    if bench is None:
        return ()
    stated = bench.standards.instrument
    origin = stated.certificate or stated.identity
    expanded = stated.relative_expanded_uncertainty
    return (
        budget_row(
            "reading of the bridge", expanded, origin, group="instrument", distribution="normal"
        ),
    )


def _side_force(
    lines: tuple[record.ExperimentLine, ...], loading: str
) -> tuple[record.BudgetRow, ...]:
    """Return a row without size where one direction alone leaves the side force in the gain."""
    if loading == "couple" or len({line.direction for line in lines}) > 1:
        return ()
    return (
        record.BudgetRow(
            name="side force, one direction only",
            group="gain",
            half_width=None,
            distribution="rectangular",
            relative_std=0.0,
            declared=False,
        ),
    )


def expanded_of(value: float, rows: Sequence[record.BudgetRow]) -> ExpandedUncertainty:
    """Return the expanded uncertainty of the gain averaged over positions."""
    sized = [row for row in rows if row.relative_std > 0.0]
    if not sized:
        return expanded_uncertainty(0.0, rows[0].dof)
    if len(sized) == 1:
        return expanded_uncertainty(sized[0].relative_std * abs(value), sized[0].dof)
    return expanded_uncertainty(*combined([(r.relative_std * abs(value), r.dof) for r in sized]))


def expanded_any_one(
    value: float,
    positions: record.PositionVariance | None,
    lines: tuple[record.ExperimentLine, ...],
    rows: Sequence[record.BudgetRow],
) -> ExpandedUncertainty | None:
    """Return the expanded uncertainty of the gain at any one position."""
    n_positions = len(by_position(lines))
    if n_positions < 2:
        return None
    if positions is None:
        # one experiment at each position: the next one differs from their mean by this
        gains = [line.gain_nm_per_v for line in lines]
        own = float(np.std(gains, ddof=1)) * math.sqrt(1.0 + 1.0 / n_positions)
        parts: list[tuple[float, float | None]] = [(own, float(n_positions - 1))]
    else:
        parts = [any_one_position(positions)]
    parts += [(row.relative_std * abs(value), row.dof) for row in rows[1:] if row.relative_std > 0]
    return expanded_uncertainty(*combined(parts))


def expanded_naive(gains: Sequence[float]) -> ExpandedUncertainty | None:
    """Return the expanded uncertainty as if every experiment were independent."""
    if len(gains) < 2:
        return None
    std = float(np.std(gains, ddof=1)) / math.sqrt(len(gains))
    return expanded_uncertainty(std, float(len(gains) - 1))


def propagate(
    value: float, rows: Sequence[record.BudgetRow], formula: tuple[float, float], *, seed: int
) -> record.MonteCarlo | None:
    """Draw the gain.

    Notes
    -----
    ``G = value (1 + sum of draws)``; a source with degrees of freedom is a scaled t. Intervals
    are compared, not standard deviations: a t of 3 dof has sqrt(3) times its scale.

    References
    ----------
    .. [1] JCGM 101:2008, sections 6.4.9.5, 7.7 and 8.1.
    """
    sized = [row for row in rows if row.relative_std > 0.0]
    if not sized or value == 0.0:
        return None
    generator = np.random.default_rng(seed)
    parts = [min(_BLOCK, _DRAWS - done) for done in range(0, _DRAWS, _BLOCK)]
    trials = np.sort(value * np.concatenate([1.0 + _block(generator, sized, n) for n in parts]))
    keep = round(0.95 * _DRAWS)
    low = (_DRAWS - keep) // 2
    equal = (float(trials[low]), float(trials[low + keep - 1]))
    narrow = int(np.argmin(trials[keep - 1 :] - trials[: _DRAWS - keep + 1]))
    std, expanded = formula
    digit = 0.5 * 10.0 ** (math.floor(math.log10(std)) - 1)
    tolerance = max(digit, _SIGMAS * max(_end_std(trials, end) for end in (low, low + keep - 1)))
    ends = (value - expanded, value + expanded)
    return record.MonteCarlo(
        draws=_DRAWS,
        seed=seed,
        mean_nm_per_v=float(trials.mean()),
        std_nm_per_v=float(trials.std(ddof=1)),
        interval_nm_per_v=equal,
        shortest_interval_nm_per_v=(float(trials[narrow]), float(trials[narrow + keep - 1])),
        expanded_nm_per_v=(equal[1] - equal[0]) / 2.0,
        agrees_with_formula=all(abs(a - b) <= tolerance for a, b in zip(ends, equal, strict=True)),
        tolerance_nm_per_v=tolerance,
    )


def _end_std(trials: FloatArray, place: int) -> float:
    """Return the standard uncertainty of an order statistic, by the density about it."""
    n = len(trials)
    p, reach = (place + 0.5) / n, max(1, n // _SPAN)
    low, high = max(0, place - reach), min(n - 1, place + reach)
    slope = float(trials[high] - trials[low]) * n / (high - low)
    return math.sqrt(p * (1.0 - p) / n) * slope


def _block(generator: np.random.Generator, rows: Sequence[record.BudgetRow], n: int) -> FloatArray:
    """Return the relative deviation of n trials."""
    total = np.zeros(n)
    for row in rows:
        if row.dof is not None:
            total += row.relative_std * generator.standard_t(row.dof, n)
        elif row.distribution == "rectangular":
            half = row.relative_std * math.sqrt(3.0)
            total += generator.uniform(-half, half, n)
        else:
            total += row.relative_std * generator.standard_normal(n)
    return total
