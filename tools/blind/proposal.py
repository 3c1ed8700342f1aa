"""Simulate the run that an answer proposes, and say how far it takes two look-alikes apart.

The run is driven by the injector's own bench; nothing of the diagnosis is used to judge it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from injector.bench import Noise, draw_scene
from injector.build import family_of, known_families
from injector.family import effect
from injector.geometry import Whitened, sine_squares
from injector.motion import Piece, hold, sweep, swing

from hdbench.diagnosis.planning import plan_for_causes
from hdbench.diagnosis.planning.planfile import plan_to_dict
from hdbench.errors import HdbenchError
from hdbench.profile import ProfileData
from hdbench.results import DiagnosisResult

__all__ = ["pieces_of_plan", "proposal"]

# the flexspline is turned to the next position within this time, s
_MOVE_S = 2.0
_RATIO = 100.0


def pieces_of_plan(steps: Iterable[Mapping[str, Any]]) -> list[Piece]:
    """Return commands of the injector's bench for the steps of a plan file."""
    speed, load, position, out = 0.0, 0.0, 0.0, []
    for step in steps:
        kind = step["kind"]
        if kind == "load":
            load = float(step["torque_nm"])
            turn = float(step.get("position_rad", position)) - position
            position += turn
            if turn:
                out.append(hold(turn * _RATIO / _MOVE_S, _MOVE_S))
            out.append(hold(0.0, 0.5, load))
            continue
        seconds, target = float(step["duration_s"]), float(step.get("speed_rad_s", 0.0))
        if kind == "ramp":
            out.append(sweep(speed, target, seconds, load))
            speed = target
        elif kind == "sweep":
            out.append(sweep(speed, target, 0.5 * seconds, load))
            out.append(sweep(target, speed, 0.5 * seconds, load))
        elif kind == "sine":
            out.append(swing(target, float(step["frequency_hz"]), seconds, speed, load))
        else:
            speed = target if kind == "hold" else 0.0
            out.append(hold(speed, seconds, load))
    return out


def _as_large(name: str, hidden: Mapping[str, Any], scene: Any) -> tuple[dict[str, Any], float]:
    """Return shape and size of `name` that show on `scene` as much as the hidden effect does."""
    if name == hidden["name"]:
        shape = {k: tuple(v) if isinstance(v, list) else v for k, v in hidden["shape"].items()}
        return shape, float(hidden["size"])
    family, white = family_of(name), Whitened(scene)
    shape = family.draw(np.random.default_rng(1), scene)
    middle = family.physical[1]
    return shape, middle * hidden["d"] / white.detectability(scene, family, shape, middle)


def _sigmas(made: Any, pair: list[str], pieces: list[Piece], noise: Noise, bits: int) -> float:
    """Return by how many sigmas one of the pair stays apart from the other on the new run."""
    hidden = made.truth["hidden"][0]
    scene = draw_scene("proposed", noise, bits, np.random.default_rng(2), pieces)
    # a step of the zero happened once and does not come again: the other would
    shown = [name for name in pair if name != "zero-step"]
    name = hidden["name"] if hidden["name"] in shown else shown[0]
    other = next(entry for entry in pair if entry != name)
    shape, size = _as_large(name, hidden, made.scene)
    family, white = family_of(name), Whitened(scene)
    torque = effect(family, scene, shape, size)
    apart = sine_squares(scene, known_families(), shape, torque).get(other, 1.0)
    return float(white.detectability(scene, family, shape, size) * np.sqrt(apart))


def proposal(
    made: Any, answer: Mapping[str, Any], profile: ProfileData, bits: int
) -> dict[str, Any]:
    """Return the proposed run's length, s, and what it separates, sigmas; why not where none."""
    pair = made.truth["note"].split("|")[:2]
    try:
        found = plan_for_causes(DiagnosisResult.from_json(answer, "the answer").causes, profile)
    except HdbenchError as error:
        return {"none": str(error)}
    if found is None or found.plan is None:
        return {"none": "no run proposed"}
    pieces = pieces_of_plan(plan_to_dict(found.plan)["segments"])
    noise = Noise(made.truth["noise"], made.truth["sigma_nm"])
    return {
        "seconds": found.plan.duration_s,
        "sigmas": round(_sigmas(made, pair, pieces, noise, bits), 2),
    }
