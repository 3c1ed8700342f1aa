"""What a plant hides from the model: for demonstrations and tests, never for an evaluation."""

from __future__ import annotations

from collections.abc import Mapping

from hdbench.profile import Profile

__all__ = ["hidden_effects"]


def hidden_effects(profile: Profile, plant: str, seed: int) -> tuple[Mapping[str, object], ...]:
    """Return the effects that a plant adds to the torque with this seed."""
    from hdbench.plant.bench import SimulatedBench
    from hdbench.plant.plantfile import load_plant

    effects = SimulatedBench(profile.data, load_plant(plant), seed).truth()["effects"]
    return tuple(effects) if isinstance(effects, list) else ()
