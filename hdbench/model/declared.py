"""Causes declared as data: keys, units and domains of an entry, and the cause that it describes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, PositiveFloat, PositiveInt, model_validator

from hdbench.model.causes import _parts as parts
from hdbench.model.definition import Cause, Parameter, always, is_harmonic
from hdbench.model.motion import Motion
from hdbench.profile.tables import Table
from hdbench.records.trace import FloatArray


def _range(ends: tuple[float, float]) -> tuple[float, float]:
    if not ends[0] < ends[1]:
        raise ValueError(f"{ends[0]:g} is not below {ends[1]:g}; needed: [lower, upper]")
    return ends


def _different(values: tuple[float, ...]) -> tuple[float, ...]:
    if len(set(values)) != len(values):
        raise ValueError("holds a value twice; needed: different values")
    return values


def _one_given(one: object, other: object, names: str) -> None:
    if (one is None) == (other is None):
        raise ValueError(f"needed: either {names}")


Range = Annotated[tuple[PositiveFloat, PositiveFloat], AfterValidator(_range)]
Several = Annotated[
    tuple[PositiveFloat, ...], Field(min_length=1, max_length=16), AfterValidator(_different)
]
Multiples = Annotated[
    tuple[PositiveInt, ...], Field(min_length=1, max_length=16), AfterValidator(_different)
]
Powers = Annotated[
    tuple[Annotated[int, Field(ge=1, le=9)], ...],
    Field(min_length=1, max_length=9),
    AfterValidator(_different),
]
# within a turn, increasing
Angles = Annotated[
    tuple[Annotated[float, Field(ge=0.0, lt=2.0 * math.pi)], ...],
    Field(min_length=2, max_length=4096),
]
Turning = Literal["motor", "output"]
Text = Annotated[str, Field(min_length=1, max_length=400)]


class _Named(Table):
    """Keys of every declaration."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9]*(-[a-z0-9]+)*$", max_length=64)]
    # where it arises
    channel: Literal["sensor", "mechanical", "acquisition", "kinematic"] = "mechanical"
    look_alikes: Annotated[tuple[str, ...], Field(max_length=16)] = ()
    # the experiment that tells it from its look-alikes
    experiment: Text = "a second run under other speeds, loads and directions"
    # where the equation comes from
    source: Text = "declared by the user"


class HarmonicsSpec(_Named):
    """A sum of sines at orders of the motor or of the output, cycles per turn."""

    kind: Literal["harmonics"]
    of: Turning
    # fixed orders, or the ends of one that is fitted with its harmonics
    orders: Several | None = None
    order_range: Range | None = None
    multiples: Multiples = (1,)
    # what the amplitude is proportional to; stated at 100 rad/s or 10 N m
    grows_with: Literal["nothing", "speed", "speed-squared", "load", "load-magnitude"] = "nothing"

    @model_validator(mode="after")
    def _one_of_both(self) -> HarmonicsSpec:
        _one_given(self.orders, self.order_range, "orders or order_range")
        if self.orders is not None and self.multiples != (1,):
            raise ValueError("multiples belong to order_range; needed: every order in orders")
        return self


class ToneSpec(_Named):
    """A sum of sines over time."""

    kind: Literal["tone"]
    # fixed frequencies, or the ends of one that is fitted
    frequencies_hz: Several | None = None
    frequency_range_hz: Range | None = None

    @model_validator(mode="after")
    def _one_of_both(self) -> ToneSpec:
        _one_given(
            self.frequencies_hz, self.frequency_range_hz, "frequencies_hz or frequency_range_hz"
        )
        return self


class PolynomialSpec(_Named):
    """Powers of velocity, load, time or temperature.

    The variable is the motor velocity in rad/s, the torque through the flexspline in N m, the time
    since the start in s, or the temperature against the first sample in degC.
    """

    kind: Literal["polynomial"]
    over: Literal["velocity", "load", "time", "temperature"]
    powers: Powers
    # value of the variable at which coefficients are stated
    scale: PositiveFloat = 1.0


class TableSpec(_Named):
    """A torque over one turn of the motor or of the output."""

    kind: Literal["table"]
    of: Turning
    angle_rad: Angles
    torque_nm: Annotated[tuple[float, ...], Field(min_length=2, max_length=4096)]

    @model_validator(mode="after")
    def _fits(self) -> TableSpec:
        if len(self.angle_rad) != len(self.torque_nm):
            raise ValueError(
                f"{len(self.angle_rad)} angles and {len(self.torque_nm)} torques; needed: as many"
            )
        if not all(a < b for a, b in pairwise(self.angle_rad)):
            raise ValueError("angle_rad does not increase; needed: increasing angles within a turn")
        if len(set(self.torque_nm)) == 1:
            raise ValueError("torque_nm is constant; needed: a torque that changes with the angle")
        return self


Spec = HarmonicsSpec | ToneSpec | PolynomialSpec | TableSpec
Declaration = Annotated[Spec, Field(discriminator="kind")]


class CauseFile(Table):
    """A file of causes: one [[cause]] table each."""

    cause: tuple[Declaration, ...]


_GROWTH: Mapping[str, tuple[str, str, Callable[[Motion], FloatArray | float]]] = {
    "nothing": ("", "does not change with speed or load", lambda _: 1.0),
    "speed": (
        f" abs(w) / {parts.REFERENCE_SPEED_RAD_S:g} rad/s",
        "even in speed",
        lambda m: np.abs(m.velocity_rad_s) / parts.REFERENCE_SPEED_RAD_S,
    ),
    "speed-squared": (
        f" (w / {parts.REFERENCE_SPEED_RAD_S:g} rad/s)^2",
        "even in speed",
        lambda m: (m.velocity_rad_s / parts.REFERENCE_SPEED_RAD_S) ** 2,
    ),
    "load": (
        f" tau / {parts.REFERENCE_LOAD_NM:g} N m",
        "odd in load",
        lambda m: m.applied_nm / parts.REFERENCE_LOAD_NM,
    ),
    "load-magnitude": (
        f" abs(tau) / {parts.REFERENCE_LOAD_NM:g} N m",
        "even in load",
        lambda m: np.abs(m.applied_nm) / parts.REFERENCE_LOAD_NM,
    ),
}


@dataclass(frozen=True, slots=True)
class _Angle:
    """The angle of the motor or of the output: its values, its symbol, and a turn of it."""

    of: Callable[[Motion], FloatArray]
    symbol: str
    a_turn: parts.Applicable


_ANGLES: Mapping[str, _Angle] = {
    "motor": _Angle(lambda m: m.angle_rad, "theta_m", parts.motor_turns(1.0)),
    "output": _Angle(lambda m: m.output_angle_rad, "theta_o", parts.output_turns(1.0)),
}


def _waves(spec: Spec, factors: list[str], growth: str, law: tuple[str, str], **more: Any) -> Cause:
    """Return a sum of sines; `factors` are the texts of their phases."""
    waves = [f"A{i} cos({factor} + phase{i})" for i, factor in enumerate(factors, 1)]
    total = " + ".join(waves)
    linear: tuple[Parameter, ...] = parts.pair_parameters("the torque")
    if len(waves) > 1:
        numbers = range(1, len(waves) + 1)
        linear = tuple(p for k in numbers for p in parts.pair_parameters(f"part {k}", f"_{k}"))
    equation = f"({total}){growth}" if growth else total
    return _cause(spec, equation, law, linear=linear, **more)


def _harmonics(spec: HarmonicsSpec) -> Cause:
    growth, parity, envelope = _GROWTH[spec.grows_with]
    free = "order" if spec.of == "motor" else "output_order"
    angle, fixed, ends = _ANGLES[spec.of], spec.orders, spec.order_range

    def columns(motion: Motion, shape: parts.Shape) -> FloatArray:
        turned, size = angle.of(motion), envelope(motion)
        orders = fixed or [k * shape[free] for k in spec.multiples]
        return np.hstack([parts.pair(order * turned, size) for order in orders])

    orders = [f"{order:g}" for order in fixed or ()] or [f"{k:g} {free}" for k in spec.multiples]
    needs = angle.a_turn
    if "load" in spec.grows_with:
        needs = parts.all_of(needs, parts.known_torque)
    return _waves(
        spec,
        [f"{order} {angle.symbol}" for order in orders],
        growth,
        (spec.of, parity),
        shape=() if ends is None else (Parameter(free, "1", *ends, f"cycles per {spec.of} turn"),),
        columns=columns,
        applicable=needs,
    )


def _tone(spec: ToneSpec) -> Cause:
    fixed, ends = spec.frequencies_hz, spec.frequency_range_hz

    def columns(motion: Motion, shape: parts.Shape) -> FloatArray:
        rates = fixed or (shape["frequency_hz"],)
        return np.hstack([parts.pair(2.0 * math.pi * rate * motion.time_s) for rate in rates])

    return _waves(
        spec,
        [f"2 pi {rate:g} Hz t" for rate in fixed or ()] or ["2 pi frequency_hz t"],
        "",
        ("clock", "does not depend on speed or load"),
        shape=()
        if ends is None
        else (Parameter("frequency_hz", "Hz", *ends, "frequency of the tone"),),
        columns=columns,
        applicable=parts.lasts(1.0),
    )


def _warmth(motion: Motion) -> FloatArray:
    if motion.temperature_c is None:
        return np.full(len(motion), np.nan)
    known = motion.temperature_c[np.isfinite(motion.temperature_c)]
    return motion.temperature_c - (known[0] if len(known) else 0.0)


def _has_temperature(motion: Motion) -> str | None:
    if motion.temperature_c is not None and np.isfinite(motion.temperature_c).any():
        return None
    return "the record has no temperature_c; needed: the temperature, degC"


_VARIABLES: Mapping[str, tuple[str, str, Callable[[Motion], FloatArray], parts.Applicable]] = {
    "velocity": ("w", "rad/s", lambda m: m.velocity_rad_s, parts.speed_varies),
    "load": ("tau", "N m", lambda m: m.applied_nm, parts.known_torque),
    "time": ("(t - t_start)", "s", lambda m: m.time_s - m.time_s[:1], always),
    "temperature": ("(T - T_start)", "degC", _warmth, _has_temperature),
}


def _polynomial(spec: PolynomialSpec) -> Cause:
    symbol, unit, variable, needs = _VARIABLES[spec.over]

    def columns(motion: Motion, _: parts.Shape) -> FloatArray:
        ratio = variable(motion) / spec.scale
        return np.column_stack([ratio**power for power in spec.powers])

    signs = {"odd" if p % 2 else "even" for p in spec.powers}
    return _cause(
        spec,
        " + ".join(f"c{p} ({symbol} / {spec.scale:g} {unit})^{p}" for p in spec.powers),
        (spec.over, f"{' and '.join(sorted(signs))} in {spec.over}"),
        linear=tuple(
            parts.torque_parameter(f"power_{p}_nm", f"part with power {p} at {spec.scale:g} {unit}")
            for p in spec.powers
        ),
        columns=columns,
        applicable=needs,
        channels=("temperature_c",) if spec.over == "temperature" else (),
    )


def _table(spec: TableSpec) -> Cause:
    at, torque, angle = np.array(spec.angle_rad), np.array(spec.torque_nm), _ANGLES[spec.of]

    def columns(motion: Motion, _: parts.Shape) -> FloatArray:
        place = np.remainder(angle.of(motion), 2.0 * math.pi)
        return parts.single(np.interp(place, at, torque, period=2.0 * math.pi))

    return _cause(
        spec,
        f"size f({angle.symbol}), f linear between {len(at)} places of a turn",
        (spec.of, "does not change with speed or load"),
        linear=(parts.ratio_parameter("size", "factor of the table"),),
        columns=columns,
        applicable=angle.a_turn,
    )


def _cause(
    spec: Spec,
    equation: str,
    law: tuple[str, str],
    *,
    linear: tuple[Parameter, ...],
    shape: tuple[Parameter, ...] = (),
    **more: Any,
) -> Cause:
    """Return a cause by its equation and its law: what it follows, and its parity."""
    return Cause(
        **{name: getattr(spec, name) for name in _Named.model_fields},
        equation=equation,
        shape=shape,
        linear=linear,
        locked_to=law[0],
        parity=law[1],
        harmonic=is_harmonic(linear),
        definition=spec.model_dump(mode="json", exclude_none=True),
        **more,
    )


def cause_of(spec: Spec) -> Cause:
    """Return the cause that a declaration describes."""
    if isinstance(spec, HarmonicsSpec):
        return _harmonics(spec)
    if isinstance(spec, ToneSpec):
        return _tone(spec)
    return _polynomial(spec) if isinstance(spec, PolynomialSpec) else _table(spec)
