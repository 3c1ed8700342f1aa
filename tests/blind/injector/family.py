"""Family of effects: its torque, shapes and sizes, and the curves that several share."""

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np


def read_table(name):
    """A table of this folder."""
    return tomllib.loads(Path(__file__).with_name(f"{name}.toml").read_text())


TABLE = read_table("families")


@dataclass(frozen=True)
class Family:
    """One kind of effect; families.toml has what stands beside its law.

    `columns(scene, shape)` gives the torque per unit of size, N m, (n, k); `draw(rng, scene)` the
    shape: floats by name, and `weights`, how the columns mix. A late stage of the channel acts on
    all torque of the stages before it.
    """

    name: str
    columns: Callable
    draw: Callable
    physical: tuple
    domain: str = "time"
    loaded: bool = False
    linear: bool = True
    agrees: bool = True
    stage: int = 0
    steps: Mapping = field(default_factory=dict)
    shapes: tuple = ({},)
    records: tuple = ()

    def grid(self, scene):
        """Shapes that stand for the family where it is only compared."""
        return [
            {k: v * scene.path.seconds if k.endswith("_s") else v for k, v in shape.items()}
            for shape in self.shapes
        ]


def families(laws, table=TABLE):
    """The families of laws: (columns, draw) by name."""
    out = []
    for name, law in laws.items():
        entry = dict(table[name])
        usual = ("short", "protocol") if entry.get("loaded") else ("mixed", "short", "protocol")
        entry["records"] = tuple(entry.get("records", usual))
        entry["shapes"] = tuple(entry.pop("grid", ({},)))
        out.append(Family(name, *law, **entry))
    return tuple(out)


def unit(rng, scene):
    """A shape of one column."""
    return {"weights": (1.0,)}


def column(curve):
    """Columns of a law that has one."""
    return lambda scene, shape: np.asarray(curve(scene, shape))[:, None]


def effect(family, scene, shape, size):
    """Torque of the effect, N m, shape (n,)."""
    if not family.linear:
        return family.columns(scene, {**shape, "size": size})[:, 0]
    columns = family.columns(scene, shape)
    return size * columns @ np.asarray(shape.get("weights", (1.0,)))


def slopes(family, scene, shape, size):
    """Derivatives of the torque over the shape parameters that a fitter has to find."""
    for name, step in family.steps.items():
        ahead = effect(family, scene, {**shape, name: shape[name] + step}, size)
        back = effect(family, scene, {**shape, name: shape[name] - step}, size)
        yield (ahead - back) / (2.0 * step)


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
