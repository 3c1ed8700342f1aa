"""Rules between keys of a profile, checked on what can be read even where other keys are wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from hdbench.profile.acquiring_checks import acquiring_problems
from hdbench.profile.conflict import Conflict

__all__ = ["profile_problems", "wave_problems"]

# shares of a period given as decimals add up to 1 within a few roundings
_SHARE_ROUNDING = 1e-12
_SHARES = (("rise", 0.0), ("duty", 0.5), ("fall", 0.0))
_PERIODIC = ("sine", "square", "triangle", "trapezoid", "chirp")


def _get(data: object, *key: str) -> object:
    for part in key:
        data = data.get(part) if isinstance(data, Mapping) else None
    return data


def _finite(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def _number(data: object, *key: str, default: float | None = None) -> float | None:
    value = _get(data, *key)
    return default if value is None else _finite(value)


def _numbers(value: object) -> list[float]:
    if not isinstance(value, Sequence) or isinstance(value, str):
        return []
    return [number for item in value if (number := _finite(item)) is not None]


def wave_problems(wave: object, base: tuple[str, ...] = ()) -> Iterator[Conflict]:
    """Yield what does not go together in a reference wave."""
    kind = _get(wave, "wave")
    shares = [_number(wave, name, default=d) for name, d in _SHARES]
    if kind == "trapezoid" and None not in shares:
        total = math.fsum(share for share in shares if share is not None)
        if not total <= 1.0 + _SHARE_ROUNDING:
            yield Conflict(
                (*base, "duty"),
                f"rise + duty + fall of a trapezoid make {total:g}; needed: at most 1",
                "shorten rise, duty or fall",
            )
    frequency = _number(wave, "frequency_hz", default=0.0)
    periodic = isinstance(kind, str) and kind in _PERIODIC
    if periodic and frequency is not None and not frequency > 0.0:
        yield Conflict(
            (*base, "frequency_hz"),
            f"found {frequency:g} Hz for a {kind}; needed: above 0 Hz",
            "give the wave a frequency",
        )
    end = _number(wave, "end_frequency_hz", default=0.0)
    if kind == "chirp" and end is not None and not end > 0.0:
        yield Conflict(
            (*base, "end_frequency_hz"),
            f"found {end:g} Hz for a chirp; needed: above 0 Hz",
            "give the chirp an end frequency",
        )


def _above(
    value: float | None, limit: float | None, key: tuple[str, ...], limit_key: str, unit: str
) -> Iterator[Conflict]:
    if value is not None and limit is not None and not value <= limit:
        yield Conflict(
            key,
            f"reaches {value:g} {unit}; needed: at most {limit_key} = {limit:g} {unit}",
            f"lower it, or raise {limit_key} if the bench allows that",
        )


def _motion(data: object) -> Iterator[Conflict]:
    yield from _above(
        _number(data, "misalignment", "velocity_rad_s"),
        _number(data, "limits", "velocity_rad_s"),
        ("misalignment", "velocity_rad_s"),
        "limits.velocity_rad_s",
        "rad/s",
    )
    bias = _number(data, "ripple", "reference", "bias_v", default=0.0)
    amplitude = _number(data, "ripple", "reference", "amplitude_v", default=0.0)
    if bias is not None and amplitude is not None:
        constant = _get(data, "ripple", "reference", "wave") == "constant"
        yield from _above(
            abs(bias + amplitude) if constant else abs(bias) + abs(amplitude),
            _number(data, "limits", "reference_v"),
            ("ripple", "reference", "amplitude_v"),
            "limits.reference_v",
            "V",
        )
    yield from _above(
        _number(data, "ripple", "duration_s"),
        _number(data, "limits", "duration_s"),
        ("ripple", "duration_s"),
        "limits.duration_s",
        "s",
    )


def _place(data: object) -> Iterator[Conflict]:
    arm = _get(data, "arm")
    if not isinstance(arm, Mapping) or "gravity_m_s2" in arm:
        return
    if not {"latitude_deg", "altitude_m"} <= set(arm):
        yield Conflict(
            ("arm", "gravity_m_s2"),
            "is missing; needed: local gravity in m/s^2, or latitude_deg and altitude_m",
            "give gravity_m_s2, or where the bench stands",
        )


def _loads(data: object) -> Iterator[Conflict]:
    length = _number(data, "arm", "length_m")
    # without a stated gravity the standard one tells within 0.5 % whether a limit is passed
    gravity = _number(data, "arm", "gravity_m_s2", default=9.80665)
    limit = _number(data, "limits", "torque_nm")
    for name in ("full_masses_kg", "low_masses_kg"):
        masses = _numbers(_get(data, "calibration", name))
        if length is not None and gravity is not None and masses:
            torque_nm = max(masses) * gravity * length
            yield from _above(torque_nm, limit, ("calibration", name), "limits.torque_nm", "N m")
        if len(set(masses)) < 3 <= len(masses):
            yield Conflict(
                ("calibration", name),
                f"holds {len(set(masses))} different masses; needed: at least 3 for a line",
                "use different weights",
            )


def _repeats(data: object) -> Iterator[Conflict]:
    for name in ("directions", "ranges"):
        values = _get(data, "calibration", name)
        if isinstance(values, Sequence) and not isinstance(values, str):
            words = [value for value in values if isinstance(value, str)]
            if len(set(words)) != len(words):
                yield Conflict(
                    ("calibration", name),
                    f"names one entry twice: {', '.join(words)}",
                    "name each once",
                )
    ripple = _get(data, "model", "ripple")
    if isinstance(ripple, Sequence) and not isinstance(ripple, str):
        seen: set[float] = set()
        for index, part in enumerate(ripple):
            order = _number(part, "order")
            if order is not None and order in seen:
                yield Conflict(
                    ("model", "ripple", index, "order"),
                    f"order {order:g} stands twice; needed: each order once",
                    "add the two components up in one",
                )
            if order is not None:
                seen.add(order)


def _deadline(data: object) -> Iterator[Conflict]:
    deadline = _number(data, "daq", "deadline_s", default=0.25)
    watchdog = _number(data, "daq", "watchdog_s", default=0.5)
    if deadline is not None and watchdog is not None and not deadline < watchdog:
        yield Conflict(
            ("daq", "deadline_s"),
            f"found {deadline:g} s; needed: below daq.watchdog_s = {watchdog:g} s, or one late "
            "reply stops the motor",
            "shorten daq.deadline_s",
        )


def profile_problems(data: object) -> list[Conflict]:
    """Return every conflict between keys of a profile."""
    reference: Any = _get(data, "ripple", "reference")
    return [
        *wave_problems(reference, ("ripple", "reference")),
        *_motion(data),
        *_place(data),
        *_loads(data),
        *_repeats(data),
        *_deadline(data),
        *acquiring_problems(data),
    ]
