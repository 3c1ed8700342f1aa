"""Family of effects: its torque, shapes and sizes, and the curves that several share."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Family:
    """One kind of effect.

    `columns(scene, shape)` gives the torque per unit of size, N m, (n, k); `draw(rng, scene)` the
    shape: floats by name, and `weights`, how the columns mix. `steps` names the shape parameters
    that a fitter has to find, with the step of their derivative. `grid(scene)` are shapes that
    stand for the family where it is only compared. `physical` are sizes (low, middle, high).
    `stage` is the place in the channel: 0 a torque, 1 a limit, 2 a late reading, each of which
    acts on all torque of the stages before it.
    """

    name: str
    columns: Callable
    draw: Callable
    physical: tuple
    steps: Mapping = field(default_factory=dict)
    grid: Callable = lambda scene: [{}]
    loaded: bool = False
    linear: bool = True
    domain: str = "time"
    reported: Mapping = field(default_factory=dict)
    shape_agrees: bool = True
    records: tuple = ("short", "protocol")
    stage: int = 0


def effect(family, scene, shape, size):
    """Torque of the effect, N m, shape (n,)."""
    if not family.linear:
        return family.columns(scene, {**shape, "size": size})[:, 0]
    columns = family.columns(scene, shape)
    return size * columns @ np.asarray(shape.get("weights", (1.0,)))


def waves(angle):
    """Cosine and sine of `angle` as columns."""
    return np.column_stack([np.cos(angle), np.sin(angle)])


def sign_curve(value, width):
    """A smooth sign by the arctangent."""
    return 2.0 / np.pi * np.arctan(0.5 * np.pi * value / width)


def branch_loop(x, reach, skew):
    """Rate-independent loop of Bouc and Wen, exponent 1, between -1 and 1 over some `reach` of x.

    dz = (1 - (b sgn(dx z) + c) |z|) dx / reach with b + c = 1, c = `skew` below 0.5; with
    s = z sgn(dx): ds/du = 1 - s above zero and 1 - (b - c) s below, exact on every step.
    """
    rate = 1.0 - 2.0 * skew
    step = np.diff(x) / reach
    size = np.abs(step)
    near = np.exp(-size).tolist()
    far = np.exp(-rate * size).tolist()
    right = (step >= 0.0).tolist()
    moves = size.tolist()
    out = [0.0]
    z = 0.0
    for k in range(len(moves)):
        s = z if right[k] else -z
        if s >= 0.0:
            s = 1.0 - (1.0 - s) * near[k]
        else:
            after = 1.0 / rate - (1.0 / rate - s) * far[k]
            if after > 0.0:
                left = moves[k] - np.log(1.0 - rate * s) / rate
                after = 1.0 - np.exp(-left)
            s = after
        z = s if right[k] else -s
        out.append(z)
    return np.array(out)
