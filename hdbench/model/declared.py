"""Causes declared as data: keys, units and domains of an entry, and the cause that it describes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PositiveFloat,
    PositiveInt,
    model_validator,
)

from hdbench.model.causes._parts import (
    REFERENCE_LOAD_NM,
    REFERENCE_SPEED_RAD_S,
    all_of,
    known_torque,
    lasts,
    motor_turns,
    output_turns,
    pair,
    pair_parameters,
    ratio_parameter,
    single,
    speed_varies,
    torque_parameter,
)
from hdbench.model.definition import Cause, Parameter, always
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray


class _Strict(BaseModel):
    """Unknown keys, NaN and infinities are errors; values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


def _range(ends: tuple[float, float]) -> tuple[float, float]:
    if not ends[0] < ends[1]:
        raise ValueError(f"{ends[0]:g} is not below {ends[1]:g}; needed: [lower, upper]")
    return ends


def _different(values: tuple[float, ...]) -> tuple[float, ...]:
    if len(set(values)) != len(values):
        raise ValueError("holds a value twice; needed: different values")
    return values


Range = Annotated[tuple[PositiveFloat, PositiveFloat], AfterValidator(_range)]
Several = Annotated[
    tuple[PositiveFloat, ...], Field(min_length=1, max_length=16), AfterValidator(_different)
]
Turning = Annotated[
    Literal["motor", "output"], Field(description="what turns: the wave generator or the output")
]
Text = Annotated[str, Field(min_length=1, max_length=400)]


class _Named(_Strict):
    """Keys of every declaration."""

    name: Annotated[
        str,
        Field(
            pattern=r"^[a-z][a-z0-9]*(-[a-z0-9]+)*$",
            max_length=64,
            description="name of the cause: small letters, digits and single '-'",
        ),
    ]
    channel: Annotated[
        Literal["sensor", "mechanical", "acquisition", "kinematic"],
        Field(description="where it arises"),
    ] = "mechanical"
    look_alikes: Annotated[
        tuple[str, ...], Field(max_length=16, description="names of causes that can look the same")
    ] = ()
    experiment: Annotated[
        Text, Field(description="the experiment that tells it from its look-alikes")
    ] = "a second run under other speeds, loads and directions"
    source: Annotated[Text, Field(description="where the equation comes from")] = (
        "declared by the user"
    )


class HarmonicsSpec(_Named):
    """A sum of sines at orders of the motor or of the output."""

    kind: Literal["harmonics"]
    of: Turning
    orders: Annotated[
        Several | None, Field(description="fixed orders, cycles per turn; or order_range")
    ] = None
    order_range: Annotated[
        Range | None, Field(description="[lower, upper] of one order that is fitted")
    ] = None
    multiples: Annotated[
        Annotated[tuple[PositiveInt, ...], Field(min_length=1, max_length=16)],
        AfterValidator(_different),
        Field(description="harmonics of the fitted order"),
    ] = (1,)
    grows_with: Annotated[
        Literal["nothing", "speed", "speed-squared", "load", "load-magnitude"],
        Field(description="what the amplitude is proportional to; stated at 100 rad/s or 10 N m"),
    ] = "nothing"

    @model_validator(mode="after")
    def _one_of_both(self) -> HarmonicsSpec:
        if (self.orders is None) == (self.order_range is None):
            raise ValueError("needed: either orders or order_range")
        if self.orders is not None and self.multiples != (1,):
            raise ValueError("multiples belong to order_range; needed: every order in orders")
        return self


class ToneSpec(_Named):
    """A sum of sines over time."""

    kind: Literal["tone"]
    frequencies_hz: Annotated[
        Several | None, Field(description="fixed frequencies, Hz; or frequency_range_hz")
    ] = None
    frequency_range_hz: Annotated[
        Range | None, Field(description="[lower, upper] of one frequency that is fitted, Hz")
    ] = None

    @model_validator(mode="after")
    def _one_of_both(self) -> ToneSpec:
        if (self.frequencies_hz is None) == (self.frequency_range_hz is None):
            raise ValueError("needed: either frequencies_hz or frequency_range_hz")
        return self


class PolynomialSpec(_Named):
    """Powers of velocity, load, time or temperature."""

    kind: Literal["polynomial"]
    over: Annotated[
        Literal["velocity", "load", "time", "temperature"],
        Field(
            description="variable: motor velocity in rad/s, torque through the flexspline in N m, "
            "time since the start in s, temperature against the first sample in degC"
        ),
    ]
    powers: Annotated[
        Annotated[tuple[Annotated[int, Field(ge=1, le=9)], ...], Field(min_length=1, max_length=9)],
        AfterValidator(_different),
        Field(description="powers of the variable, 1 to 9"),
    ]
    scale: Annotated[
        PositiveFloat, Field(description="value of the variable at which coefficients are stated")
    ] = 1.0


class TableSpec(_Named):
    """A torque over one turn of the motor or of the output."""

    kind: Literal["table"]
    of: Turning
    angle_rad: Annotated[
        tuple[Annotated[float, Field(ge=0.0, lt=2.0 * math.pi)], ...],
        Field(min_length=2, max_length=4096, description="angles within a turn, rad, increasing"),
    ]
    torque_nm: Annotated[
        tuple[float, ...],
        Field(min_length=2, max_length=4096, description="torque at each angle, N m"),
    ]

    @model_validator(mode="after")
    def _fits(self) -> TableSpec:
        if len(self.angle_rad) != len(self.torque_nm):
            raise ValueError(
                f"{len(self.angle_rad)} angles and {len(self.torque_nm)} torques; needed: as many"
            )
        pairs = zip(self.angle_rad, self.angle_rad[1:], strict=False)
        if not all(a < b for a, b in pairs):
            raise ValueError("angle_rad does not increase; needed: increasing angles within a turn")
        if len(set(self.torque_nm)) == 1:
            raise ValueError("torque_nm is constant; needed: a torque that changes with the angle")
        return self


Declaration = Annotated[
    HarmonicsSpec | ToneSpec | PolynomialSpec | TableSpec, Field(discriminator="kind")
]


class CauseFile(_Strict):
    """A file of causes."""

    cause: Annotated[
        tuple[Declaration, ...],
        Field(description="the causes, one [[cause]] table each"),
    ]


Spec = HarmonicsSpec | ToneSpec | PolynomialSpec | TableSpec
Columns = Callable[[Motion, Mapping[str, float]], FloatArray]
Applicable = Callable[[Motion], str | None]

_GROWTH: Mapping[str, tuple[str, str, Callable[[Motion], FloatArray | float]]] = {
    "nothing": ("", "does not change with speed or load", lambda _: 1.0),
    "speed": (
        f" abs(w) / {REFERENCE_SPEED_RAD_S:g} rad/s",
        "even in speed",
        lambda m: np.abs(m.velocity_rad_s) / REFERENCE_SPEED_RAD_S,
    ),
    "speed-squared": (
        f" (w / {REFERENCE_SPEED_RAD_S:g} rad/s)^2",
        "even in speed",
        lambda m: (m.velocity_rad_s / REFERENCE_SPEED_RAD_S) ** 2,
    ),
    "load": (
        f" tau / {REFERENCE_LOAD_NM:g} N m",
        "odd in load",
        lambda m: m.applied_nm / REFERENCE_LOAD_NM,
    ),
    "load-magnitude": (
        f" abs(tau) / {REFERENCE_LOAD_NM:g} N m",
        "even in load",
        lambda m: np.abs(m.applied_nm) / REFERENCE_LOAD_NM,
    ),
}


def cause_of(spec: Spec) -> Cause:
    """Return the cause that a declaration describes."""
    if isinstance(spec, HarmonicsSpec):
        return _harmonics(spec)
    if isinstance(spec, ToneSpec):
        return _tone(spec)
    if isinstance(spec, PolynomialSpec):
        return _polynomial(spec)
    return _table(spec)


def _angle(of: str, motion: Motion) -> FloatArray:
    return motion.angle_rad if of == "motor" else motion.output_angle_rad


def _symbol(of: str) -> str:
    return "theta_m" if of == "motor" else "theta_o"


def _pairs(count: int) -> tuple[Parameter, ...]:
    if count == 1:
        return pair_parameters("the torque")
    return tuple(p for k in range(1, count + 1) for p in pair_parameters(f"part {k}", f"_{k}"))


def _sum(words: list[str]) -> str:
    return " + ".join(f"A{i} {word}" for i, word in enumerate(words, 1))


def _harmonics(spec: HarmonicsSpec) -> Cause:
    growth, parity, envelope = _GROWTH[spec.grows_with]
    free = "order" if spec.of == "motor" else "output_order"
    fixed = spec.orders

    def columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        angle, size = _angle(spec.of, motion), envelope(motion)
        orders = fixed or [k * shape[free] for k in spec.multiples]
        return np.hstack([pair(order * angle, size) for order in orders])

    if fixed is not None:
        shape: tuple[Parameter, ...] = ()
        words = [
            f"cos({order:g} {_symbol(spec.of)} + phase{i})" for i, order in enumerate(fixed, 1)
        ]
    else:
        low, high = spec.order_range or (0.0, 0.0)
        shape = (Parameter(free, "1", low, high, f"cycles per {spec.of} turn"),)
        words = [
            f"cos({k:g} {free} {_symbol(spec.of)} + phase{i})"
            for i, k in enumerate(spec.multiples, 1)
        ]
    turns = motor_turns(1.0) if spec.of == "motor" else output_turns(1.0)
    needs = all_of(turns, known_torque) if spec.grows_with.startswith("load") else turns
    equation = f"({_sum(words)}){growth}" if growth else _sum(words)
    return _cause(spec, equation, (spec.of, parity), shape, _pairs(len(words)), columns, needs)


def _tone(spec: ToneSpec) -> Cause:
    fixed = spec.frequencies_hz

    def columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        rates = fixed or (shape["frequency_hz"],)
        return np.hstack([pair(2.0 * math.pi * rate * motion.time_s) for rate in rates])

    if fixed is not None:
        shape: tuple[Parameter, ...] = ()
        words = [f"cos(2 pi {rate:g} Hz t + phase{i})" for i, rate in enumerate(fixed, 1)]
    else:
        low, high = spec.frequency_range_hz or (0.0, 0.0)
        shape = (Parameter("frequency_hz", "Hz", low, high, "frequency of the tone"),)
        words = ["cos(2 pi frequency_hz t + phase1)"]
    law = ("clock", "does not depend on speed or load")
    return _cause(spec, _sum(words), law, shape, _pairs(len(words)), columns, lasts(1.0))


def _warmth(motion: Motion) -> FloatArray:
    if motion.temperature_c is None:
        return np.full(len(motion), np.nan)
    known = motion.temperature_c[np.isfinite(motion.temperature_c)]
    return motion.temperature_c - (known[0] if len(known) else 0.0)


def _has_temperature(motion: Motion) -> str | None:
    if motion.temperature_c is not None and np.isfinite(motion.temperature_c).any():
        return None
    return "the record has no temperature_c; needed: the temperature, degC"


_VARIABLES: Mapping[str, tuple[str, str, Callable[[Motion], FloatArray], Applicable]] = {
    "velocity": ("w", "rad/s", lambda m: m.velocity_rad_s, speed_varies),
    "load": ("tau", "N m", lambda m: m.applied_nm, known_torque),
    "time": ("(t - t_start)", "s", lambda m: m.time_s - m.time_s[:1], always),
    "temperature": ("(T - T_start)", "degC", _warmth, _has_temperature),
}


def _polynomial(spec: PolynomialSpec) -> Cause:
    symbol, unit, variable, needs = _VARIABLES[spec.over]

    def columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        del shape
        ratio = variable(motion) / spec.scale
        return np.column_stack([ratio**power for power in spec.powers])

    linear = tuple(
        torque_parameter(f"power_{p}_nm", f"part with power {p} at {spec.scale:g} {unit}")
        for p in spec.powers
    )
    equation = " + ".join(f"c{p} ({symbol} / {spec.scale:g} {unit})^{p}" for p in spec.powers)
    signs = {"odd" if p % 2 else "even" for p in spec.powers}
    parity = f"{' and '.join(sorted(signs))} in {spec.over}"
    return _cause(spec, equation, (spec.over, parity), (), linear, columns, needs)


def _table(spec: TableSpec) -> Cause:
    at, torque = np.array(spec.angle_rad), np.array(spec.torque_nm)

    def columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        del shape
        angle = np.remainder(_angle(spec.of, motion), 2.0 * math.pi)
        return single(np.interp(angle, at, torque, period=2.0 * math.pi))

    turns = motor_turns(1.0) if spec.of == "motor" else output_turns(1.0)
    law = (spec.of, "does not change with speed or load")
    linear = (ratio_parameter("size", "factor of the table"),)
    equation = f"size f({_symbol(spec.of)}), f linear between {len(at)} places of a turn"
    return _cause(spec, equation, law, (), linear, columns, turns)


def _cause(
    spec: Spec,
    equation: str,
    law: tuple[str, str],
    shape: tuple[Parameter, ...],
    linear: tuple[Parameter, ...],
    columns: Columns,
    applicable: Applicable,
) -> Cause:
    return Cause(
        name=spec.name,
        equation=equation,
        shape=shape,
        linear=linear,
        locked_to=law[0],
        parity=law[1],
        channel=spec.channel,
        look_alikes=spec.look_alikes,
        experiment=spec.experiment,
        source=spec.source,
        columns=columns,
        harmonic=[parameter.name for parameter in linear] == ["cosine_nm", "sine_nm"],
        applicable=applicable,
        channels=("temperature_c",) if law[0] == "temperature" else (),
        definition=spec.model_dump(mode="json", exclude_none=True),
    )
