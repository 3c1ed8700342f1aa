"""Comparison of two runs of one kind: its numbers, its verdict, its curves and its CSV."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hdbench.comparison import dynamic
from hdbench.comparison.calibration import compare_calibrations
from hdbench.comparison.orders import Pattern
from hdbench.comparison.score import Compared, Terms
from hdbench.comparison.side import Side, environment_changes, load_side, profile_changes
from hdbench.errors import DataError
from hdbench.records import FloatArray
from hdbench.records.csvtext import csv_text
from hdbench.records.jsonfile import result_header
from hdbench.results import CalibrationResult

_COMPARED: Mapping[str, Callable[[Any, Any, Terms], dynamic.Moved]] = {
    "calibration": compare_calibrations,
    "misalignment": dynamic.compare_misalignments,
    "ripple": dynamic.compare_ripples,
    "diagnosis": dynamic.compare_diagnoses,
}
# points per turn: order 4 gets 45 of them
_POINTS = 181
Answer = Literal["moved", "within-uncertainty", "cannot-tell"]


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two results of one kind.

    Parameters
    ----------
    a, b : Side
        Both sides.
    terms : Terms
        How they were held against each other.
    outcome : Moved
        What they say of each other.
    overlay : dict or None
        Curves of both.
    overlay_reason : str
        Why there are none; empty where there are.
    """

    a: Side
    b: Side
    terms: Terms
    outcome: dynamic.Moved
    overlay: dict[str, Any] | None
    overlay_reason: str

    @property
    def moved(self) -> tuple[str, ...]:
        """Names of what moved beyond its uncertainty, of all that decides."""
        found = self.outcome
        names = [q.name for q in found.quantities if q.decides and q.moved]
        if found.pattern is not None and found.pattern.moved:
            names.append("order vectors")
        names += [f"only in A: {x}" for x in found.only_a]
        return (*names, *(f"only in B: {x}" for x in found.only_b))

    @property
    def verdict(self) -> Answer:
        """The answer."""
        if self.moved:
            return "moved"
        deciding = [q for q in self.outcome.quantities if q.decides]
        if self.a.kind == "diagnosis" and not deciding:
            return "within-uncertainty"
        told = deciding and all(q.score is not None for q in deciding)
        return "within-uncertainty" if told else "cannot-tell"

    @property
    def sentence(self) -> str:
        """The answer in words."""
        deciding = [q for q in self.outcome.quantities if q.decides and q.score is not None]
        if not deciding and (self.outcome.only_a or self.outcome.only_b):
            return ", ".join(self.moved)
        if not deciding and self.a.kind == "diagnosis":
            return "both name the same causes"
        if not deciding:
            return "nothing that both results have carries an uncertainty"
        worst = max(deciding, key=lambda q: q.score or 0.0)
        words = f"{worst.label}: {_change_words(worst)}"
        others = [name for name in self.moved if name != worst.name]
        return f"{words}; moved too: {', '.join(others)}" if others else words

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as ``--json`` prints it (schema ``hdbench/comparison/1``)."""
        found = self.outcome
        return {
            **result_header("comparison", self.a.profile),
            "kind": self.a.kind,
            "a": self.a.identity(),
            "b": self.b.identity(),
            "verdict": self.verdict,
            "moved": list(self.moved),
            "sentence": self.sentence,
            "confidence": self.terms.confidence,
            "assumption": found.assumption,
            "quantities": [q.to_dict() for q in found.quantities],
            "orders": None if found.pattern is None else found.pattern.to_dict(),
            "only_a": list(found.only_a),
            "only_b": list(found.only_b),
            "profile_changes": profile_changes(self.a, self.b),
            "environment_changes": environment_changes(self.a, self.b),
            "overlay": self.overlay,
            "overlay_reason": self.overlay_reason,
        }


def _change_words(item: Compared) -> str:
    first, second = item.values
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
    words, rows = {True: "true", False: "false", None: None}, []
    for q in found.outcome.quantities:
        body = q.to_dict()
        a, b, d = (_cells(body[key]) for key in ("a", "b", "difference"))
        told = (body["expanded"], q.score, words[q.moved], words[q.decides])
        rows.append((q.name, q.unit, *a[:2], *b[:2], *d, *told))
    return csv_text(_HEAD, rows)


def _cells(body: Any) -> tuple[Any, Any, Any]:
    if isinstance(body, dict):
        return body["value"], body["std"], body["dof"]
    return body, None, None


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
    """
    first, second = load_side(Path(a)), load_side(Path(b))
    if first.kind != second.kind:
        raise DataError(
            f"a {second.kind} result against a {first.kind} result; needed: two of one kind",
            where=second.where,
            fix=f"name two {first.kind} runs; 'hdbench runs list' shows the kinds",
        )
    for side in (first, second):
        if isinstance(side.result, CalibrationResult) and not side.result.gain_nm_per_v.value:
            raise DataError(
                "gain_nm_per_v is 0 N m/V; needed: a gain other than zero",
                where=f"{side.where}: gain_nm_per_v",
                fix="evaluate the calibration again with --from",
            )
    terms = Terms(confidence, same_origin, independent)
    found = _COMPARED[first.kind](first.result, second.result, terms)
    return Comparison(first, second, terms, found, *_overlay(first, second, found.pattern))


def _overlay(a: Side, b: Side, pattern: Pattern | None) -> tuple[dict[str, Any] | None, str]:
    """Return what to draw of both."""
    if a.kind == "calibration":
        try:
            drawn = _calibration(a, b)
        except DataError as error:
            # the numbers stand without the picture: it is left out and said so
            return None, f"the readings of one calibration cannot be read: {error.what}"
        return drawn, "" if drawn else "the readings of one calibration are not beside its result"
    if pattern is not None:
        return _turn(a.kind, pattern), ""
    return None, "nothing to be drawn"


def _turn(kind: str, pattern: Pattern) -> dict[str, Any]:
    angle: FloatArray = np.linspace(0.0, 2.0 * math.pi, _POINTS)
    waves = [np.zeros_like(angle), np.zeros_like(angle)]
    for pair in pattern.pairs:
        for wave, vector in zip(waves, pair.vectors(pattern.shift_rad), strict=True):
            wave += np.real(vector * np.exp(1j * pair.order * angle))
    of = "output" if kind == "misalignment" else "motor"
    name = "misalignment torque" if kind == "misalignment" else "ripple torque, fitted orders"
    return {
        "x": {"label": f"{of} angle", "unit": "rad"},
        "y": {"label": name, "unit": "N m"},
        "a": {"x": angle.tolist(), "y": waves[0].tolist()},
        "b": {"x": angle.tolist(), "y": waves[1].tolist()},
    }


def _calibration(a: Side, b: Side) -> dict[str, Any] | None:
    gain = a.result.gain_nm_per_v.value
    drawn = [_deviations(side, gain) for side in (a, b)]
    if None in drawn:
        return None
    return {
        "x": {"label": "applied torque", "unit": "N m"},
        "y": {"label": "off the line of the first gain", "unit": "N m"},
        "a": drawn[0],
        "b": drawn[1],
    }


def _deviations(side: Side, gain: float) -> dict[str, list[float]] | None:
    """Return applied torque and shown less applied torque, each experiment's zero taken off."""
    loads = side.loads()
    if loads is None:
        return None
    zeros = {line.id: line.zero_v or 0.0 for line in side.result.experiments}
    points = [
        (r.torque_nm, gain * (r.reading_v - zeros.get(r.experiment, 0.0)) - r.torque_nm)
        for r in loads.readings
    ]
    return {"x": [p[0] for p in points], "y": [p[1] for p in points]}
