"""Sources of uncertainty of the mean gain, and the expanded uncertainties that they make."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hdbench.calibration.budget import (
    BudgetRow,
    ExpandedUncertainty,
    combined,
    expanded_uncertainty,
)
from hdbench.calibration.gains.oneway import OneWay
from hdbench.calibration.lines import ExperimentLine
from hdbench.calibration.statistics import by_position
from hdbench.calibration.torque.applied import TorqueAccount
from hdbench.profile.schema import ProfileData
from hdbench.records.quantity import Quantity

__all__ = ["expanded_any_one", "expanded_naive", "expanded_of", "gain_rows"]


def gain_rows(
    gain: Quantity,
    lines: tuple[ExperimentLine, ...],
    account: TorqueAccount,
    bench: ProfileData | None,
) -> tuple[BudgetRow, ...]:
    """Return the budget of the mean gain."""
    loading = "single" if bench is None else bench.arm.loading
    return (
        _scatter_row(gain, len(lines)),
        *account.rows,
        *_instrument(bench),
        *_side_force(lines, loading),
    )


def _scatter_row(gain: Quantity, n: int) -> BudgetRow:
    relative = gain.std / abs(gain.value)
    return BudgetRow(
        name="scatter of the gain",
        group="gain",
        half_width=relative,
        unit="1",
        distribution="t",
        divisor=1.0,
        sensitivity=1.0,
        relative_std=relative,
        dof=gain.dof,
        declared=True,
        origin=f"{n} experiments" if n > 1 else "residuals of one line",
    )


def _instrument(bench: ProfileData | None) -> tuple[BudgetRow, ...]:
    if bench is None:
        return ()
    instrument = bench.standards.instrument
    expanded = instrument.relative_expanded_uncertainty
    return (
        BudgetRow(
            name="reading of the bridge",
            group="instrument",
            half_width=expanded,
            unit="1",
            distribution="normal",
            divisor=2.0,
            sensitivity=1.0,
            relative_std=0.0 if expanded is None else expanded / 2.0,
            dof=None,
            declared=expanded is not None,
            origin=instrument.certificate or instrument.identity,
        ),
    )


def _side_force(lines: tuple[ExperimentLine, ...], loading: str) -> tuple[BudgetRow, ...]:
    """Return a row without size where one direction alone leaves the side force in the gain."""
    if loading == "couple" or len({line.direction for line in lines}) > 1:
        return ()
    name = "side force, one direction only"
    return (BudgetRow(name, "gain", None, "1", "rectangular", 1.0, 1.0, 0.0, None, False),)


def expanded_of(value: float, rows: Sequence[BudgetRow]) -> ExpandedUncertainty:
    """Return the expanded uncertainty of the gain averaged over positions."""
    sized = [row for row in rows if row.relative_std > 0.0]
    if not sized:
        return expanded_uncertainty(0.0, rows[0].dof)
    if len(sized) == 1:
        return expanded_uncertainty(sized[0].relative_std * abs(value), sized[0].dof)
    std, dof = combined([(row.relative_std * abs(value), row.dof) for row in sized])
    return expanded_uncertainty(std, dof)


def expanded_any_one(
    value: float,
    positions: OneWay | None,
    lines: tuple[ExperimentLine, ...],
    rows: Sequence[BudgetRow],
) -> ExpandedUncertainty | None:
    """Return the expanded uncertainty of the gain at any one position."""
    n_positions = len(by_position(lines))
    if n_positions < 2:
        return None
    if positions is None:
        # one experiment at each position: the next one differs from their mean by this
        gains = [line.gain_nm_per_v.value for line in lines]
        own = float(np.std(gains, ddof=1)) * math.sqrt(1.0 + 1.0 / n_positions)
        parts: list[tuple[float, float | None]] = [(own, float(n_positions - 1))]
    else:
        parts = [positions.any_one]
    parts += [(row.relative_std * abs(value), row.dof) for row in rows[1:] if row.relative_std > 0]
    return expanded_uncertainty(*combined(parts))


def expanded_naive(gains: Sequence[float]) -> ExpandedUncertainty | None:
    """Return the expanded uncertainty as if every experiment were independent."""
    if len(gains) < 2:
        return None
    std = float(np.std(gains, ddof=1)) / math.sqrt(len(gains))
    return expanded_uncertainty(std, float(len(gains) - 1))
