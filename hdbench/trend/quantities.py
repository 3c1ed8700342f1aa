"""What can be followed over runs, and where each kind of result holds it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

__all__ = ["QUANTITIES", "Reading", "TrendQuantity", "unit_of"]

Result = Mapping[str, Any]
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


Reader = Callable[[Result], Iterator[Reading]]


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
    readers: Mapping[str, Reader]


def unit_of(quantity: TrendQuantity, series: str) -> str:
    """Return the unit of a series; a parameter of a cause ends in its own."""
    return "N m s/rad" if series.endswith("_nm_s_per_rad") else quantity.unit


def _number(body: Any) -> tuple[float, float | None]:
    std = body.get("std")
    return float(body["value"]), None if std is None else float(std)


def _mean(series: str, values: Sequence[float]) -> Iterator[Reading]:
    """Return the mean of several numbers of one run, with the scatter among them."""
    if values:
        std = float(np.std(values, ddof=1)) / math.sqrt(len(values)) if len(values) > 1 else None
        yield Reading(series, float(np.mean(values)), std)


def _gain(result: Result) -> Iterator[Reading]:
    yield Reading("", *_number(result["gain_nm_per_v"]))


def _consistency(result: Result) -> Iterator[Reading]:
    if result["consistency"] is not None:
        value, n = float(result["consistency"]), int(result["n_experiments"])
        # sampling std of a std of n normal values
        yield Reading("", value, value / math.sqrt(2.0 * (n - 1)))


def _hysteresis(result: Result) -> Iterator[Reading]:
    return _mean("", [abs(float(loop["relative"])) for loop in result["hysteresis"].values()])


def _calibration_zero(result: Result) -> Iterator[Reading]:
    return _mean("at rest", [float(line["intercept_nm"]) for line in result["experiments"]])


def _moving_zero(result: Result) -> Iterator[Reading]:
    stretches = [_number(part["offset_nm"]) for part in result["stretches"]]
    stds = [0.0 if std is None else std for _, std in stretches]
    if stretches:
        mean = float(np.mean([value for value, _ in stretches]))
        yield Reading("in motion", mean, math.hypot(*stds) / len(stds))


def _misalignment(result: Result) -> Iterator[Reading]:
    yield Reading("", *_number(result["amplitude_nm"]))


def _ripple(result: Result) -> Iterator[Reading]:
    for row in result["ripple"]:
        order = round(float(row["order"]), _ORDER_DECIMALS)
        yield Reading(f"order {order:g}", *_number(row["amplitude_nm"]))


_FRICTION = {
    "coulomb-friction": "coulomb_nm",
    "viscous-friction": "viscous_nm_s_per_rad",
    "stribeck-friction": "excess_nm",
}


def _friction(result: Result) -> Iterator[Reading]:
    for cause in (*result["causes"], *result["minor"]):
        key = _FRICTION.get(cause["name"], "")
        if key in cause["parameters"]:
            yield Reading(key, *_number(cause["parameters"][key]))


def _rms(path: str, series: str) -> Reader:
    """Return a reader of an rms value of n samples: its sampling std is value / sqrt(2 n)."""

    def read(result: Result) -> Iterator[Reading]:
        found: Any = result
        for key in path.split("."):
            found = found[key]
        if found is not None:
            n = result.get("n_samples")
            yield Reading(series, float(found), float(found) / math.sqrt(2.0 * n) if n else None)

    return read


QUANTITIES: Mapping[str, TrendQuantity] = {
    "gain": TrendQuantity("torque gain", "N m/V", {"calibration": _gain}),
    "consistency": TrendQuantity("consistency of the gain", "1", {"calibration": _consistency}),
    "hysteresis": TrendQuantity("hysteresis over range", "1", {"calibration": _hysteresis}),
    "zero": TrendQuantity(
        "zero", "N m", {"calibration": _calibration_zero, "misalignment": _moving_zero}
    ),
    "misalignment": TrendQuantity("misalignment amplitude", "N m", {"misalignment": _misalignment}),
    "ripple": TrendQuantity("ripple amplitude", "N m", {"ripple": _ripple}),
    "friction": TrendQuantity("friction", "N m", {"diagnosis": _friction}),
    "noise": TrendQuantity(
        "noise of the torque",
        "N m",
        {
            "ripple": _rms("noise_std_nm", "ripple runs"),
            "misalignment": _rms("noise.innovation_std", "misalignment runs"),
            "diagnosis": _rms("rest.noise_rms_nm", "diagnoses"),
        },
    ),
    "residual": TrendQuantity(
        "residual of the torque",
        "N m",
        {
            "ripple": _rms("residual_rms_nm", "ripple runs"),
            "misalignment": _rms("residual_rms_nm", "misalignment runs"),
            "diagnosis": _rms("rest.heldout_rms_nm", "diagnoses"),
        },
    ),
}
