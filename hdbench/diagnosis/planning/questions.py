"""Which names are to be told apart, and what settles those that no run separates."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from hdbench.diagnosis.planning.signatures import Effect, nominal_shape
from hdbench.model import Cause, catalogue, cause_named

__all__ = ["effects_named", "effects_of_result", "settled_by"]


def effects_named(names: Iterable[str], *, extra: Sequence[Cause] = ()) -> tuple[Effect, ...]:
    """Return effects by name with nominal shapes.

    Parameters
    ----------
    names : iterable of str
        Names of the catalogue.
    extra : sequence of Cause
        Causes beside the catalogue.

    Returns
    -------
    tuple of Effect
        Each name once, in the order given.

    Raises
    ------
    DataError
        If a name is unknown; the nearest one is proposed.
    """
    causes = [cause_named(name, where="cause", extra=extra) for name in dict.fromkeys(names)]
    return tuple(Effect(cause, nominal_shape(cause)) for cause in causes)


def effects_of_result(
    result: Mapping[str, Any], *, extra: Sequence[Cause] = ()
) -> tuple[tuple[Effect, ...], tuple[tuple[str, str], ...]]:
    """Return what a diagnosis leaves open.

    Parameters
    ----------
    result : mapping
        A diagnosis result (``hdbench/diagnosis/1``).
    extra : sequence of Cause
        Causes beside the catalogue.

    Returns
    -------
    effects : tuple of Effect
        Every name in a group or among rivals, with the shapes that were found.
    pairs : tuple of (str, str)
        Both orders of each cause's name with every other name of its group and rivals.
    """
    known = catalogue(extra)
    effects: dict[str, Effect] = {}
    pairs: dict[tuple[str, str], None] = {}
    for entry in result.get("causes", ()):
        names = [str(name) for name in (entry["name"], *entry["group"], *entry["rivals"])]
        names = [name for name in dict.fromkeys(names) if name in known]
        if len(names) < 2:
            continue
        for name in names:
            effects.setdefault(name, _found_effect(known[name], entry["parameters"]))
        for other in names[1:]:
            pairs |= {(names[0], other): None, (other, names[0]): None}
    return tuple(effects.values()), tuple(pairs)


def _found_effect(cause: Cause, parameters: Mapping[str, Any]) -> Effect:
    """Return a cause with the shapes and the amplitude that a diagnosis found."""
    shape = nominal_shape(cause)
    for parameter in cause.shape:
        value = parameters.get(parameter.name, {}).get("value")
        if isinstance(value, int | float) and parameter.contains(float(value)):
            shape[parameter.name] = float(value)
    amplitude = parameters.get("amplitude_nm", {}).get("value")
    return Effect(cause, shape, float(amplitude) if isinstance(amplitude, int | float) else None)


def settled_by(first: Cause, second: Cause) -> str:
    """Return what settles a pair that torque and angle cannot tell apart.

    Parameters
    ----------
    first, second : Cause
        Causes.

    Returns
    -------
    str
        The channel that decides where they arise in different ones, else the experiment of the
        catalogue.
    """
    kinds = {first.channel, second.channel}
    told = {cause.channel: cause.name for cause in (first, second)}
    if len(kinds) == 2 and "mechanical" in kinds:
        return (
            f"motor_current_a: {told['mechanical']} needs motor torque and shows in the current, "
            f"{told[(kinds - {'mechanical'}).pop()]} does not; or {first.experiment}"
        )
    if len(kinds) == 2 and "kinematic" in kinds:
        other = told[(kinds - {"kinematic"}).pop()]
        return f"output_angle_rad: {told['kinematic']} shows in the angles, {other} does not"
    return first.experiment
