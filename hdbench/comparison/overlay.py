"""Curves of both results on one pair of axes, as plain numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hdbench.comparison.orders import Pattern
from hdbench.comparison.side import Side
from hdbench.errors import DataError
from hdbench.records import FloatArray

# points per turn: order 4 gets 45 of them
_POINTS = 181


def overlay(a: Side, b: Side, pattern: Pattern | None) -> tuple[dict[str, Any] | None, str]:
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
