"""Plant files: schema, every key checked, read and frozen."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from importlib import resources
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args, get_type_hints

import numpy as np
import pydantic
from pydantic import model_validator

from hdbench.plant.effects import EFFECT_KINDS, Effect
from hdbench.profile.loader import TomlFile, all_problems, named_files, named_text
from hdbench.profile.tables import NonNegative, Table
from hdbench.profile.toml_text import Key, read_toml


class Draw(Table):
    """A number that the seed chooses: ``{ min, max }`` uniform, ``{ any_of }``, or a plain one."""

    min: float | None = None
    max: float | None = None
    any_of: Annotated[tuple[float, ...], pydantic.Field(strict=False)] = ()

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

    def draw(self, rng: np.random.Generator) -> float:
        """Return the number that the seed chooses."""
        if self.min is not None and self.max is not None:
            return float(rng.uniform(self.min, self.max))
        return self.any_of[int(rng.integers(len(self.any_of)))]


def _plain(value: Any) -> Any:
    """Return a plain number as the range of that one number."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return {"any_of": [value]} if is_number else value


AnyDraw = Annotated[Draw, pydantic.BeforeValidator(_plain)]
# by the domain of a number: what every value that a draw can give has to be, and what to say if not
_DOMAINS: dict[str, tuple[Callable[[float], bool], str]] = {
    "at least 0": (lambda value: value >= 0.0, "is below 0.0"),
    "above 0": (lambda value: value > 0.0, "is not above 0.0"),
    "at least 0, below 1": (lambda value: 0.0 <= value < 1.0, "is not in [0, 1)"),
    "whole": (
        lambda value: value >= 1.0 and value == int(value),
        "is not one of several whole numbers of at least 1",
    ),
}


def _within(domain: str) -> pydantic.AfterValidator:
    """Return what refuses a draw that can leave a domain."""
    inside, problem = _DOMAINS[domain]

    def check(draw: Draw) -> Draw:
        ranged = domain == "whole" and draw.min != draw.max
        for value in draw.values:
            if ranged or not inside(value):
                raise ValueError(f"{value} {problem}")
        return draw

    return pydantic.AfterValidator(check)


class _Effect(Table):
    """What all effects share."""

    kind: str
    probability: Annotated[
        float, pydantic.Field(ge=0.0, le=1.0, description="how likely the seed chooses this effect")
    ] = 1.0

    def build(self, rng: np.random.Generator) -> Any:
        """Return the effect with its numbers drawn in the order of its keys."""
        given = {name: value for name, value in self if name not in ("kind", "probability")}
        numbers = {name: value and value.draw(rng) for name, value in given.items()}
        effect: Any = EFFECT_KINDS[self.kind]
        return effect(**numbers)


def _effect_table(kind: str, effect: type[Effect]) -> type[_Effect]:
    """Return the table of one kind of effect: a draw for each of its numbers, in its domain."""
    keys: dict[str, Any] = {"kind": (Literal[kind], ...)}
    for name, hint in get_type_hints(effect, include_extras=True).items():
        draw: Any = AnyDraw
        for domain in getattr(hint, "__metadata__", ()):
            draw = Annotated[AnyDraw, _within(domain)]
        # only a phase may be left out: it is then a new one in every acquisition
        keys[name] = (draw | None, None) if type(None) in get_args(hint) else (draw, ...)
    return pydantic.create_model(f"{effect.__name__}Table", __base__=_Effect, **keys)


if TYPE_CHECKING:
    EffectSpec = _Effect
else:
    EffectSpec = Annotated[
        reduce(or_, (_effect_table(*each) for each in EFFECT_KINDS.items())),
        pydantic.Field(discriminator="kind"),
    ]


class MotorSpec(Table):
    """Friction at the motor shaft: in the current, not in the torque channel behind the mesh."""

    coulomb_nm: NonNegative = 0.02
    viscous_nm_s_per_rad: NonNegative = 5e-5


class FixtureSpec(Table):
    """Lock, arm and weights."""

    repeatability: Annotated[float, pydantic.Field(ge=0.0, le=0.1)] = 5e-4
    bounce_hz: pydantic.PositiveFloat = 12.0
    bounce_damping: Annotated[float, pydantic.Field(gt=0.0, lt=1.0)] = 0.05
    swing_rad: Annotated[float, pydantic.Field(ge=0.0, le=0.5)] = 0.035
    pendulum_m: pydantic.PositiveFloat = 0.3
    swing_decay_s: pydantic.PositiveFloat = 1.0


class PlantFile(Table):
    """One plant file."""

    name: Annotated[str, pydantic.Field(pattern=r"^[a-z0-9][a-z0-9._-]{0,63}$")]
    description: str = ""
    minimum_effects: Annotated[int, pydantic.Field(ge=0)] = 0
    motor: MotorSpec = MotorSpec()
    fixture: FixtureSpec = FixtureSpec()
    effects: Annotated[tuple[EffectSpec, ...], pydantic.Field(strict=False)] = ()

    @model_validator(mode="after")
    def _enough(self) -> PlantFile:
        possible = sum(effect.probability > 0.0 for effect in self.effects)
        if self.minimum_effects > possible:
            raise ValueError(
                f"minimum_effects {self.minimum_effects} exceeds the {possible} effects that can "
                "be chosen"
            )
        return self


_PLANTS = resources.files("hdbench_profiles") / "plants"
_HELP = "docs/plant.md lists keys, units and domains"


@dataclass(frozen=True, slots=True)
class PlantSpec:
    """A checked plant file."""

    data: PlantFile
    sha256: str

    @property
    def name(self) -> str:
        """The plant's name."""
        return self.data.name


def list_plants() -> tuple[str, ...]:
    """Return the names of the plants that come with the package, sorted."""
    return named_files(_PLANTS)


def load_plant(name_or_path: str) -> PlantSpec:
    """Return a plant by name or from a file."""
    text, path = named_text(name_or_path, _PLANTS, "plant")
    raw = read_toml(text, path)
    try:
        data = PlantFile.model_validate(raw)
    except pydantic.ValidationError as error:
        file, known = TomlFile(path, text), _known_keys()
        found = [
            file.finding(_key(one), one, known, _HELP) for one in error.errors(include_url=False)
        ]
        raise (found[0] if len(found) == 1 else all_problems(path, found)) from None
    return PlantSpec(data, hashlib.sha256(text.encode()).hexdigest())


def _key(error: Mapping[str, Any]) -> Key:
    """Return the key of a finding; pydantic puts the kind of an effect into its path."""
    return tuple(part for part in error["loc"] if part not in EFFECT_KINDS)


def _known_keys() -> list[str]:
    """Return every key that a plant file may have anywhere."""
    definitions = PlantFile.model_json_schema()["$defs"].values()
    nested = {name for table in definitions for name in table.get("properties", {})}
    return sorted(nested | set(PlantFile.model_fields))


def draw_effects(plant: PlantSpec, rng: np.random.Generator) -> tuple[Effect, ...]:
    """Return the effects that a seed chooses, with their sizes.

    One number u, uniform in [0, 1), is drawn per effect and compared with its probability. Where
    fewer than `minimum_effects` are chosen, those with the smallest u / probability are added.
    Every number of every effect is drawn whether the effect is chosen or not, so that one effect's
    size does not depend on another's choice.
    """
    specs = plant.data.effects
    uniform = [float(rng.random()) for _ in specs]
    # below 1 exactly where an effect is chosen
    ranks = [
        u / spec.probability if spec.probability else math.inf
        for u, spec in zip(uniform, specs, strict=True)
    ]
    built = [spec.build(rng) for spec in specs]
    wanted = max(plant.data.minimum_effects, sum(rank < 1.0 for rank in ranks))
    chosen = sorted(sorted(range(len(specs)), key=lambda i: ranks[i])[:wanted])
    return tuple(built[i] for i in chosen)
