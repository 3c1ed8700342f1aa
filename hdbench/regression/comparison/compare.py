"""Two run folders or result files to one comparison."""

from __future__ import annotations

from pathlib import Path

from hdbench.errors import DataError, UsageError
from hdbench.regression.comparison.calibrations import compare_calibrations
from hdbench.regression.comparison.causes import compare_diagnoses
from hdbench.regression.comparison.changes import environment_changes, profile_changes
from hdbench.regression.comparison.dynamic import (
    compare_misalignments,
    compare_ripples,
    gain_words,
)
from hdbench.regression.comparison.moved import Moved
from hdbench.regression.comparison.overlay import overlay
from hdbench.regression.comparison.result import Comparison
from hdbench.regression.comparison.side import Side, load_side

__all__ = ["compare_runs"]


def compare_runs(
    a: Path,
    b: Path,
    *,
    confidence: float = 0.95,
    same_origin: bool = False,
    independent: bool = False,
) -> Comparison:
    """Compare two results of one kind.

    Parameters
    ----------
    a, b : Path
        Run folders or result files: the earlier one first.
    confidence : float
        Of the verdict, in (0.5, 1).
    same_origin : bool
        Angle 0 is one mark on the shaft in both runs: then phases count.
    independent : bool
        Take no standard and no gain as common to both.

    Returns
    -------
    Comparison

    Raises
    ------
    DataError
        If one is damaged, has no result, or they are of different kinds.
    UsageError
        If the confidence is out of its domain.
    """
    if not 0.5 < confidence < 1.0:
        raise UsageError(
            f"confidence {confidence!r}; needed: above 0.5 and below 1",
            where="--confidence",
            fix="take 0.95",
        )
    first, second = load_side(Path(a)), load_side(Path(b))
    if first.kind != second.kind:
        raise DataError(
            f"a {second.kind} result against a {first.kind} result; needed: two of one kind",
            where=second.where,
            fix=f"name two {first.kind} runs; 'hdbench runs list' shows the kinds",
        )
    try:
        found, assumption = _compared(
            first, second, confidence, same_origin=same_origin, independent=independent
        )
    except (AttributeError, KeyError, TypeError) as error:
        raise DataError(
            f"one of the {first.kind} results lacks or misshapes an entry: {error}",
            where=f"{first.where}, {second.where}",
            fix="evaluate the run again with --from",
        ) from error
    return Comparison(
        first.kind,
        first,
        second,
        confidence,
        found.quantities,
        found.pattern,
        found.only_a,
        found.only_b,
        assumption,
        profile_changes(first, second),
        environment_changes(first, second),
        *overlay(first.kind, first, second, found.pattern),
    )


def _compared(
    a: Side, b: Side, confidence: float, *, same_origin: bool, independent: bool
) -> tuple[Moved, str]:
    if a.kind == "calibration":
        gains = compare_calibrations(a, b, confidence=confidence, independent=independent)
        return Moved(gains.quantities), gains.assumption
    if a.kind == "diagnosis":
        return compare_diagnoses(a, b, confidence=confidence), "parameters taken as independent"
    compare = compare_misalignments if a.kind == "misalignment" else compare_ripples
    found = compare(a, b, confidence=confidence, same_origin=same_origin, independent=independent)
    return found, gain_words(a, b, independent=independent)
