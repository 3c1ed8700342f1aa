"""The metrological evaluation beside the report's: steps, positions, directions, budget."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdbench.calibration.budget import BudgetRow, ExpandedUncertainty
from hdbench.calibration.curve import Loop, SeriesLackOfFit, series_lack_of_fit
from hdbench.calibration.curve.loops import loading_loops
from hdbench.calibration.curve.odd import OddReading, odd_readings
from hdbench.calibration.gainbudget import (
    expanded_any_one,
    expanded_naive,
    expanded_of,
    gain_rows,
)
from hdbench.calibration.gains import (
    Consensus,
    DirectionEffects,
    GainOutlier,
    MixedFit,
    OneWay,
    PairedDifference,
    consensus,
    direction_effects,
    gain_outliers,
    mixed_fit,
    one_way,
    paired_difference,
)
from hdbench.calibration.lines import ExperimentLine
from hdbench.calibration.readings import TakenReading
from hdbench.calibration.readingsout import reading_resolution
from hdbench.calibration.statistics import by_position, position_numbers
from hdbench.calibration.stepwise import GroupEvaluation, evaluate_group, step_groups
from hdbench.calibration.torque.applied import TorqueAccount
from hdbench.calibration.torque.sideforce import direction_entries
from hdbench.profile.schema import ProfileData
from hdbench.records.quantity import Quantity

__all__ = ["Metrology", "evaluate_metrology"]


@dataclass(frozen=True, slots=True)
class Metrology:
    """What the readings say beyond gain and consistency.

    Parameters
    ----------
    account : TorqueAccount
        The applied torque.
    groups : tuple of GroupEvaluation
        Step by step, for each direction and range.
    lack : tuple of (SeriesLackOfFit or None)
        Straightness of each group.
    loops : dict of str to Loop
        Hysteresis of each experiment that has both branches.
    odd : tuple of OddReading
        Readings that stand off.
    positions : OneWay or None
        Repeatability against spread between positions.
    mixed : MixedFit or None
        The same with directions and ranges as fixed effects.
    direction, ranges : PairedDifference or None
        cw less ccw; low less full.
    effects : DirectionEffects
        What the difference of the directions may be.
    consensus : Consensus or None
        Gains weighted by their own uncertainties.
    outliers : tuple of GainOutlier
        Gains that stand off.
    rows : tuple of BudgetRow
        Budget of the mean gain.
    mean, any_one, naive : ExpandedUncertainty or None
        Of the mean over positions; at any one position; as if all experiments were independent.
    """

    account: TorqueAccount
    groups: tuple[GroupEvaluation, ...]
    lack: tuple[SeriesLackOfFit | None, ...]
    loops: dict[str, Loop]
    odd: tuple[OddReading, ...]
    positions: OneWay | None
    mixed: MixedFit | None
    direction: PairedDifference | None
    ranges: PairedDifference | None
    effects: DirectionEffects
    consensus: Consensus | None
    outliers: tuple[GainOutlier, ...]
    rows: tuple[BudgetRow, ...]
    mean: ExpandedUncertainty
    any_one: ExpandedUncertainty | None
    naive: ExpandedUncertainty | None


def evaluate_metrology(
    readings: Sequence[TakenReading],
    lines: tuple[ExperimentLine, ...],
    gain: Quantity,
    account: TorqueAccount,
    bench: ProfileData | None,
) -> Metrology:
    """Evaluate the readings as a metrologist does."""
    loading = "single" if bench is None else bench.arm.loading
    grouped = step_groups(readings, loading)
    resolution = reading_resolution(readings, bench)
    numbers, gains = position_numbers(lines), [line.gain_nm_per_v.value for line in lines]
    positions = one_way([[x.gain_nm_per_v.value for x in g] for g in by_position(lines)])
    rows = gain_rows(gain, lines, account, bench)
    return Metrology(
        account=account,
        groups=tuple(evaluate_group(group, account, resolution) for group in grouped),
        lack=tuple(
            series_lack_of_fit(g.torque_nm, np.vstack([s.up_v for s in g.series])) for g in grouped
        ),
        loops=loading_loops(readings, lines),
        odd=tuple(reading for group in grouped for reading in odd_readings(group)),
        positions=positions,
        mixed=mixed_fit(gains, numbers, [(x.direction, x.range) for x in lines]),
        direction=_directions(lines),
        ranges=_ranges(lines),
        consensus=consensus(gains, [line.gain_nm_per_v.std for line in lines]),
        outliers=gain_outliers(gains, numbers),
        effects=direction_effects(direction_entries(readings, lines, bench)),
        rows=rows,
        mean=expanded_of(gain.value, rows),
        any_one=expanded_any_one(gain.value, positions, lines, rows),
        naive=expanded_naive(gains),
    )


def _directions(lines: tuple[ExperimentLine, ...]) -> PairedDifference | None:
    entries = [
        ((number, line.range), line.direction, line.gain_nm_per_v.value)
        for number, line in zip(position_numbers(lines), lines, strict=True)
    ]
    return paired_difference(entries, "cw", "ccw")


def _ranges(lines: tuple[ExperimentLine, ...]) -> PairedDifference | None:
    entries = [
        ((number, line.direction), line.range, line.gain_nm_per_v.value)
        for number, line in zip(position_numbers(lines), lines, strict=True)
    ]
    return paired_difference(entries, "low", "full")
