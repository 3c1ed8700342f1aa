"""Quantities that can be followed over runs, and where each kind of result holds them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdbench.records import Quantity
from hdbench.results import CalibrationResult, DiagnosisResult, MisalignmentResult, RippleResult

# orders of two runs are one series where they agree to so many decimals
_ORDER_DECIMALS = 3


@dataclass(frozen=True, slots=True)
class Reading:
    """One number of one run.

    Parameters
    ----------
    series : str
        What tells it from other numbers of the same quantity, such as ``order 2``.
    value : float
        The number.
    std : float or None
        Its standard uncertainty, same unit; None where the result has none.
    """

    series: str
    value: float
    std: float | None


@dataclass(frozen=True, slots=True)
class TrendQuantity:
    """One quantity.

    Parameters
    ----------
    label, unit : str
        For a person.
    readers : mapping of str to callable
        By the kind of run, how to read it from the result.
    """

    label: str
    unit: str
    readers: Mapping[str, Callable[[Any], Iterable[Reading]]]


def _told(series: str, quantity: Quantity) -> list[Reading]:
    return [Reading(series, quantity.value, quantity.std)]


def _mean(series: str, values: Sequence[float]) -> Iterator[Reading]:
    """Return the mean of several numbers of one run, with the scatter among them."""
    if values:
        std = float(np.std(values, ddof=1)) / math.sqrt(len(values)) if len(values) > 1 else None
        yield Reading(series, float(np.mean(values)), std)


def _rms(series: str, value: float | None, n_samples: int | None) -> Iterator[Reading]:
    """Return an rms value of n samples: its sampling std is value / sqrt(2 n)."""
    if value is not None:
        yield Reading(series, value, value / math.sqrt(2.0 * n_samples) if n_samples else None)


def _consistency(result: CalibrationResult) -> Iterator[Reading]:
    value = result.consistency
    if value is not None:
        # sampling std of a std of n normal values
        yield Reading("", value, value / math.sqrt(2.0 * (result.n_experiments - 1)))


def _moving_zero(result: MisalignmentResult) -> Iterator[Reading]:
    zeros = [part.offset_nm for part in result.stretches]
    if zeros:
        std = math.hypot(*(zero.std for zero in zeros)) / len(zeros)
        yield Reading("in motion", float(np.mean([zero.value for zero in zeros])), std)


def _ripple(result: RippleResult) -> Iterator[Reading]:
    for row in result.ripple:
        yield from _told(f"order {round(row.order, _ORDER_DECIMALS):g}", row.amplitude_nm)


_FRICTION = {
    "coulomb-friction": "coulomb_nm",
    "viscous-friction": "viscous_nm_s_per_rad",
    "stribeck-friction": "excess_nm",
}


def _friction(diagnosis: DiagnosisResult) -> Iterator[Reading]:
    for cause in (*diagnosis.causes, *diagnosis.minor):
        key = _FRICTION.get(cause.name, "")
        if key in cause.parameters:
            found = cause.parameters[key]
            yield Reading(key, found.value, found.std)


QUANTITIES: Mapping[str, TrendQuantity] = {
    "gain": TrendQuantity(
        "torque gain", "N m/V", {"calibration": lambda r: _told("", r.gain_nm_per_v)}
    ),
    "consistency": TrendQuantity("consistency of the gain", "1", {"calibration": _consistency}),
    "hysteresis": TrendQuantity(
        "hysteresis over range",
        "1",
        {"calibration": lambda r: _mean("", [abs(x.relative) for x in r.hysteresis.values()])},
    ),
    "zero": TrendQuantity(
        "zero",
        "N m",
        {
            "calibration": lambda r: _mean("at rest", [x.intercept_nm for x in r.experiments]),
            "misalignment": _moving_zero,
        },
    ),
    "misalignment": TrendQuantity(
        "misalignment amplitude", "N m", {"misalignment": lambda r: _told("", r.amplitude_nm)}
    ),
    "ripple": TrendQuantity("ripple amplitude", "N m", {"ripple": _ripple}),
    "friction": TrendQuantity("friction", "N m", {"diagnosis": _friction}),
    "noise": TrendQuantity(
        "noise of the torque",
        "N m",
        {
            "ripple": lambda r: _rms("ripple runs", r.noise_std_nm, r.n_samples),
            "misalignment": lambda r: _rms(
                "misalignment runs", r.noise and r.noise.innovation_std, r.n_samples
            ),
            "diagnosis": lambda r: _rms("diagnoses", r.rest and r.rest.noise_rms_nm, None),
        },
    ),
    "residual": TrendQuantity(
        "residual of the torque",
        "N m",
        {
            "ripple": lambda r: _rms("ripple runs", r.residual_rms_nm, r.n_samples),
            "misalignment": lambda r: _rms("misalignment runs", r.residual_rms_nm, r.n_samples),
            "diagnosis": lambda r: _rms("diagnoses", r.rest and r.rest.heldout_rms_nm, None),
        },
    ),
}
