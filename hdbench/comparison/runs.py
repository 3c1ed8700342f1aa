"""Comparison of two runs of one kind: its numbers, its verdict, and its CSV."""

from __future__ import annotations

import csv
import io
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from hdbench.comparison.calibration import compare_calibrations
from hdbench.comparison.diagnosis import compare_diagnoses
from hdbench.comparison.dynamic import (
    Moved,
    compare_misalignments,
    compare_ripples,
    gain_words,
)
from hdbench.comparison.orders import Pattern
from hdbench.comparison.overlay import overlay
from hdbench.comparison.score import Compared
from hdbench.comparison.side import KeyChange, Side, environment_changes, load_side, profile_changes
from hdbench.errors import DataError, UsageError
from hdbench.records import Quantity
from hdbench.records.jsonfile import result_header
from hdbench.results import CalibrationResult, DiagnosisResult, MisalignmentResult, RippleResult

Answer = Literal["moved", "within-uncertainty", "cannot-tell"]


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two results of one kind.

    Parameters
    ----------
    kind : str
        ``calibration``, ``misalignment``, ``ripple`` or ``diagnosis``.
    a, b : Side
        Both sides.
    confidence : float
        Of the verdict.
    quantities : tuple of Compared
        Their numbers.
    pattern : Pattern or None
        Their orders as vectors.
    only_a, only_b : tuple of str
        Orders or causes that only one side has.
    assumption : str
        What was taken as common to both.
    profile : tuple of KeyChange or None
        Profile keys that differ; None where that is not known.
    environment : tuple of KeyChange or None
        Versions, device, calibration that differ; None where that is not known.
    overlay : dict or None
        Curves of both.
    overlay_reason : str
        Why there are none; empty where there are.
    """

    kind: str
    a: Side
    b: Side
    confidence: float
    quantities: tuple[Compared, ...]
    pattern: Pattern | None
    only_a: tuple[str, ...]
    only_b: tuple[str, ...]
    assumption: str
    profile: tuple[KeyChange, ...] | None
    environment: tuple[KeyChange, ...] | None
    overlay: dict[str, Any] | None
    overlay_reason: str

    @property
    def moved(self) -> tuple[str, ...]:
        """Names of what moved beyond its uncertainty, of all that decides."""
        names = [q.name for q in self.quantities if q.decides and q.moved]
        if self.pattern is not None and self.pattern.score is not None:
            names += [] if self.pattern.score <= 1.0 else ["order vectors"]
        return (*names, *(f"only in A: {x}" for x in self.only_a),
                *(f"only in B: {x}" for x in self.only_b))  # fmt: skip

    @property
    def verdict(self) -> Answer:
        """The answer."""
        if self.moved:
            return "moved"
        deciding = [q for q in self.quantities if q.decides]
        if self.kind == "diagnosis" and not deciding:
            return "within-uncertainty"
        told = deciding and all(q.score is not None for q in deciding)
        return "within-uncertainty" if told else "cannot-tell"

    @property
    def sentence(self) -> str:
        """The answer in words."""
        deciding = [q for q in self.quantities if q.decides and q.score is not None]
        if not deciding:
            return _set_words(self)
        worst = max(deciding, key=lambda q: q.score or 0.0)
        words = f"{worst.label}: {_change_words(worst)}"
        others = [name for name in self.moved if name != worst.name]
        return f"{words}; moved too: {', '.join(others)}" if others else words

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as ``--json`` prints it (schema ``hdbench/comparison/1``)."""
        return {
            **result_header("comparison", self.a.profile),
            "kind": self.kind,
            "a": self.a.identity(),
            "b": self.b.identity(),
            "verdict": self.verdict,
            "moved": list(self.moved),
            "sentence": self.sentence,
            "confidence": self.confidence,
            "assumption": self.assumption,
            "quantities": [q.to_dict() for q in self.quantities],
            "orders": None if self.pattern is None else self.pattern.to_dict(),
            "only_a": list(self.only_a),
            "only_b": list(self.only_b),
            "profile_changes": _listed(self.profile),
            "environment_changes": _listed(self.environment),
            "overlay": self.overlay,
            "overlay_reason": self.overlay_reason,
        }


def _listed(changes: tuple[KeyChange, ...] | None) -> list[dict[str, Any]] | None:
    return None if changes is None else [asdict(change) for change in changes]


def _set_words(found: Comparison) -> str:
    if found.only_a or found.only_b:
        return ", ".join(found.moved)
    if found.kind == "diagnosis":
        return "both name the same causes"
    return "nothing that both results have carries an uncertainty"


def _change_words(item: Compared) -> str:
    first, second = (x.value if isinstance(x, Quantity) else x for x in (item.a, item.b))
    if first is None or second is None or item.expanded is None:
        return "no uncertainty"
    change = second - first
    share = f" ({100.0 * change / first:+.2f} %)" if first else ""
    return (
        f"{first:.4g} to {second:.4g} {item.unit}, a change of {change:+.3g} {item.unit}{share} "
        f"with an expanded uncertainty of {item.expanded:.2g} {item.unit}"
    )


_HEAD = ("quantity", "unit", "a", "a_std", "b", "b_std", "difference", "difference_std",
         "difference_dof", "expanded", "score", "moved", "decides")  # fmt: skip


def comparison_csv(found: Comparison) -> str:
    """Return the quantities as CSV, one per row.

    Parameters
    ----------
    found : Comparison
        The comparison.

    Returns
    -------
    str
        With a header; empty cells where something is not known.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_HEAD)
    for q in found.quantities:
        body = q.to_dict()
        a, b, d = (_cells(body[key]) for key in ("a", "b", "difference"))
        cells = (q.name, q.unit, *a[:2], *b[:2], *d, body["expanded"], q.score, q.moved, q.decides)
        writer.writerow("" if c is None else _cell(c) for c in cells)
    return text.getvalue()


def _cells(body: Any) -> tuple[Any, Any, Any]:
    if isinstance(body, dict):
        return body["value"], body["std"], body["dof"]
    return body, None, None


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, float) else str(value)


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
    found, assumption = _compared(
        first, second, confidence, same_origin=same_origin, independent=independent
    )
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
    match a.result, b.result:
        case CalibrationResult() as x, CalibrationResult() as y:
            _check_gains(a, b, x, y)
            gains, assumption = compare_calibrations(
                x, y, confidence=confidence, independent=independent
            )
            return Moved(gains), assumption
        case MisalignmentResult() as x, MisalignmentResult() as y:
            found = compare_misalignments(
                x, y, confidence=confidence, same_origin=same_origin, independent=independent
            )
            return found, gain_words(x, y, independent=independent)
        case RippleResult() as x, RippleResult() as y:
            found = compare_ripples(
                x, y, confidence=confidence, same_origin=same_origin, independent=independent
            )
            return found, gain_words(x, y, independent=independent)
        case DiagnosisResult() as x, DiagnosisResult() as y:
            found = compare_diagnoses(x, y, confidence=confidence)
            return found, "parameters taken as independent"
    raise AssertionError(a.kind)


def _check_gains(a: Side, b: Side, x: CalibrationResult, y: CalibrationResult) -> None:
    for side, result in ((a, x), (b, y)):
        if result.gain_nm_per_v.value == 0.0:
            raise DataError(
                "gain_nm_per_v is 0 N m/V; needed: a gain other than zero",
                where=f"{side.where}: gain_nm_per_v",
                fix="evaluate the calibration again with --from",
            )
