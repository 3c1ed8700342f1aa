"""Causes declared as data: keys, units and domains of one entry of a causes file."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PositiveFloat,
    PositiveInt,
    model_validator,
)

__all__ = [
    "CauseFile",
    "Declaration",
    "HarmonicsSpec",
    "PolynomialSpec",
    "TableSpec",
    "ToneSpec",
]


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
    """What all declarations share."""

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
