"""What the seed makes of a plant file."""

from __future__ import annotations

import numpy as np

from hdbench.plant.effects import EFFECT_KINDS, Effect
from hdbench.plant.plantfile import PlantSpec
from hdbench.plant.plantschema import Draw, EffectSpec

__all__ = ["draw_effects"]


def draw_effects(plant: PlantSpec, rng: np.random.Generator) -> tuple[Effect, ...]:
    """Return the effects that a seed chooses, with their sizes.

    Notes
    -----
    One number u, uniform in [0, 1), is drawn per effect and compared with its probability. Where
    fewer than `minimum_effects` are chosen, those with the smallest u / probability are added.
    Every number of every effect is drawn whether the effect is chosen or not, so that one effect's
    size does not depend on another's choice.
    """
    specs = plant.data.effects
    ranks = [_rank(float(rng.random()), spec.probability) for spec in specs]
    built = [_build(spec, rng) for spec in specs]
    wanted = max(plant.data.minimum_effects, sum(rank < 1.0 for rank in ranks))
    chosen = sorted(sorted(range(len(specs)), key=lambda i: ranks[i])[:wanted])
    return tuple(built[i] for i in chosen)


def _rank(uniform: float, probability: float) -> float:
    """Return what is below 1 exactly where an effect is chosen."""
    return uniform / probability if probability > 0.0 else float("inf")


def _build(spec: EffectSpec, rng: np.random.Generator) -> Effect:
    """Return the record of one effect with its numbers drawn in the order of its keys."""
    numbers: dict[str, float | None] = {}
    for name in type(spec).model_fields:
        value = getattr(spec, name)
        if isinstance(value, Draw):
            numbers[name] = _number(value, rng)
        elif value is None:
            numbers[name] = None
    record: type[Effect] = EFFECT_KINDS[spec.kind]
    return record(**numbers)  # type: ignore[arg-type]


def _number(draw: Draw, rng: np.random.Generator) -> float:
    """Return one value of `draw`."""
    if draw.min is not None and draw.max is not None:
        return float(rng.uniform(draw.min, draw.max))
    return draw.any_of[int(rng.integers(len(draw.any_of)))]
