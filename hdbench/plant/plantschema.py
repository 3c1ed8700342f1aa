"""Schema of a plant file: what an emulated bench has beyond its model, every key checked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PositiveFloat,
    model_validator,
)

__all__ = ["Draw", "EffectSpec", "FixtureSpec", "MotorSpec", "PlantFile"]

NonNegative = Annotated[float, Field(ge=0.0)]


class _Table(BaseModel):
    """A plant table: unknown keys, NaN and infinities are errors; values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


class Draw(_Table):
    """A number that the seed chooses: ``{ min, max }`` uniform, ``{ any_of }``, or a plain one.

    Parameters
    ----------
    min, max : float or None
        Ends of a range, unit of the key.
    any_of : tuple of float
        Values of which one is chosen, unit of the key.
    """

    min: float | None = None
    max: float | None = None
    any_of: Annotated[tuple[float, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _one_form(self) -> Draw:
        by_range = self.min is not None and self.max is not None
        if by_range == bool(self.any_of) or (self.min is None) != (self.max is None):
            raise ValueError("needed: a number, or both min and max, or any_of with one or more")
        if self.min is not None and self.max is not None and not self.min <= self.max:
            raise ValueError(f"min {self.min} is above max {self.max}")
        return self

    @property
    def values(self) -> tuple[float, ...]:
        """Every choice, or both ends of the range."""
        if self.min is not None and self.max is not None:
            return (self.min, self.max)
        return self.any_of


def _plain(value: Any) -> Any:
    """Return a plain number as the range of that one number."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return {"any_of": [value]} if is_number else value


def _domain(low: float, *, open_end: bool) -> Callable[[Draw], Draw]:
    """Return a check that no value of a draw lies below `low` (or at it, with `open_end`)."""

    def check(draw: Draw) -> Draw:
        for value in draw.values:
            if not (value > low if open_end else value >= low):
                raise ValueError(f"{value} is {'not above' if open_end else 'below'} {low}")
        return draw

    return check


def _whole(draw: Draw) -> Draw:
    """Refuse a draw that can give anything but whole numbers of at least 1."""
    for value in draw.values:
        if draw.min != draw.max or not (value >= 1.0 and value == int(value)):
            raise ValueError(f"{value} is not one of several whole numbers of at least 1")
    return draw


def _share(draw: Draw) -> Draw:
    """Refuse a draw that can leave the range from 0 to below 1."""
    for value in draw.values:
        if not 0.0 <= value < 1.0:
            raise ValueError(f"{value} is not in [0, 1)")
    return draw


AnyDraw = Annotated[Draw, BeforeValidator(_plain)]
SizeDraw = Annotated[AnyDraw, AfterValidator(_domain(0.0, open_end=False))]
AboveZeroDraw = Annotated[AnyDraw, AfterValidator(_domain(0.0, open_end=True))]


WholeDraw = Annotated[AnyDraw, AfterValidator(_whole)]
ShareDraw = Annotated[AnyDraw, AfterValidator(_share)]


class _Effect(_Table):
    """What all effects share."""

    probability: Annotated[
        float, Field(ge=0.0, le=1.0, description="how likely the seed chooses this effect")
    ] = 1.0


class FrictionSpec(_Effect):
    """Friction of the output bearing."""

    kind: Literal["output-friction"]
    coulomb_nm: SizeDraw
    viscous_nm_s_per_rad: SizeDraw
    transition_rad_s: AboveZeroDraw


class MotorOrderSpec(_Effect):
    """A component that turns with the wave generator."""

    kind: Literal["motor-order"]
    order: AboveZeroDraw
    amplitude_nm: SizeDraw
    phase_rad: AnyDraw


class OutputOrderSpec(_Effect):
    """A component that turns with the load."""

    kind: Literal["output-order"]
    order: AboveZeroDraw
    amplitude_nm: SizeDraw
    phase_rad: AnyDraw


class ToneSpec(_Effect):
    """A component that follows the clock; without phase a new one in every acquisition."""

    kind: Literal["tone"]
    frequency_hz: AboveZeroDraw
    amplitude_nm: SizeDraw
    phase_rad: AnyDraw | None = None


class GainErrorSpec(_Effect):
    """A share of the transmitted torque that reads too much."""

    kind: Literal["gain-error"]
    fraction: AnyDraw


class ZeroStepSpec(_Effect):
    """A zero that jumps once in every acquisition."""

    kind: Literal["zero-step"]
    at_s: SizeDraw
    size_nm: AnyDraw


class ZeroDriftSpec(_Effect):
    """A zero that runs away steadily."""

    kind: Literal["zero-drift"]
    rate_nm_per_s: AnyDraw


class ToothBumpSpec(_Effect):
    """A bump at one place of every output turn."""

    kind: Literal["tooth-bump"]
    center_rad: AnyDraw
    width_rad: AboveZeroDraw
    height_nm: AnyDraw


class AsymmetricFrictionSpec(_Effect):
    """Friction that the output bearing has more of forward than backward."""

    kind: Literal["asymmetric-friction"]
    coulomb_difference_nm: AnyDraw
    viscous_difference_nm_s_per_rad: AnyDraw
    transition_rad_s: AboveZeroDraw


class CoggingSpec(_Effect):
    """Torque between the magnets and the slots of the motor."""

    kind: Literal["cogging"]
    order: WholeDraw
    amplitude_nm: SizeDraw
    phase_rad: AnyDraw
    decay: ShareDraw


class TransmissionErrorSpec(_Effect):
    """A recorded motor angle that wanders about that of the wave generator."""

    kind: Literal["transmission-error"]
    order: AboveZeroDraw
    amplitude_rad: SizeDraw
    phase_rad: AnyDraw


EffectSpec = Annotated[
    FrictionSpec
    | MotorOrderSpec
    | OutputOrderSpec
    | ToneSpec
    | GainErrorSpec
    | ZeroStepSpec
    | ZeroDriftSpec
    | ToothBumpSpec
    | AsymmetricFrictionSpec
    | CoggingSpec
    | TransmissionErrorSpec,
    Field(discriminator="kind"),
]


class MotorSpec(_Table):
    """Friction at the motor shaft: in the current, not in the torque channel behind the mesh.

    Parameters
    ----------
    coulomb_nm : float
        Dry friction, N m, at least 0.
    viscous_nm_s_per_rad : float
        Slope over the motor speed, N m s/rad, at least 0.
    """

    coulomb_nm: NonNegative = 0.02
    viscous_nm_s_per_rad: NonNegative = 5e-5


class FixtureSpec(_Table):
    """Lock, arm and weights.

    Parameters
    ----------
    repeatability : float
        Standard deviation of the gain between clampings at one place, share.
    bounce_hz, bounce_damping : float
        Frequency, Hz, and damping ratio of arm and weight on the flexspline.
    swing_rad : float
        Angle at which a weight that was just hung starts to swing, rad.
    pendulum_m : float
        Length of the hanger, m.
    swing_decay_s : float
        Time constant of the swing, s.
    """

    repeatability: Annotated[float, Field(ge=0.0, le=0.1)] = 5e-4
    bounce_hz: PositiveFloat = 12.0
    bounce_damping: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.05
    swing_rad: Annotated[float, Field(ge=0.0, le=0.5)] = 0.035
    pendulum_m: PositiveFloat = 0.3
    swing_decay_s: PositiveFloat = 1.0


class PlantFile(_Table):
    """One plant file.

    Parameters
    ----------
    name, description : str
        What it is called, and one line about it.
    minimum_effects : int
        How many effects the seed chooses at least.
    motor : MotorSpec
        Friction at the motor shaft.
    fixture : FixtureSpec
        Lock, arm and weights.
    effects : tuple of EffectSpec
        What may reach the torque channel beyond the model.
    """

    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9._-]{0,63}$")]
    description: str = ""
    minimum_effects: Annotated[int, Field(ge=0)] = 0
    motor: MotorSpec = MotorSpec()
    fixture: FixtureSpec = FixtureSpec()
    effects: Annotated[tuple[EffectSpec, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _enough(self) -> PlantFile:
        possible = sum(effect.probability > 0.0 for effect in self.effects)
        if self.minimum_effects > possible:
            raise ValueError(
                f"minimum_effects {self.minimum_effects} exceeds the {possible} effects that can "
                "be chosen"
            )
        return self
