"""Curves of both results on one pair of axes, as plain numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from hdbench.errors import DataError
from hdbench.records import FloatArray
from hdbench.regression.comparison.orders import Pattern
from hdbench.regression.comparison.side import Side, number, quantity

__all__ = ["overlay"]

# points per turn: order 4 gets 45 of them
_POINTS = 181


def overlay(
    kind: str, a: Side, b: Side, pattern: Pattern | None
) -> tuple[dict[str, Any] | None, str]:
    """Return what to draw of both."""
    if kind == "calibration":
        try:
            drawn = _calibration(a, b)
        except DataError as error:
            # the numbers stand without the picture: it is left out and said so
            return None, f"the readings of one calibration cannot be read: {error.what}"
        return drawn, "" if drawn else "the readings of one calibration are not beside its result"
    if kind in ("misalignment", "ripple") and pattern is not None:
        return _turn(kind, pattern), ""
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
    gain = quantity(a.result.get("gain_nm_per_v"), f"{a.where}: gain_nm_per_v")
    drawn = [_deviations(side, gain.value) if gain is not None else None for side in (a, b)]
    if drawn[0] is None or drawn[1] is None:
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
    zeros = {
        str(line.get("id")): _zero(line)
        for line in side.result.get("experiments", ())
        if isinstance(line, Mapping)
    }
    points = [
        (r.torque_nm, gain * (r.reading_v - zeros.get(r.experiment, 0.0)) - r.torque_nm)
        for r in loads.readings
    ]
    return {"x": [p[0] for p in points], "y": [p[1] for p in points]}


def _zero(line: Mapping[str, Any]) -> float:
    return number(line.get("zero_v")) or 0.0
