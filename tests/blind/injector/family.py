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

    `law(scene, shape)` gives the torque per unit of size, N m, (n,) or (n, k). A shape has floats
    by name, and `weights`, how the columns mix. Its `numbers` are drawn by the laws of the table,
    or by a function of the generator. A late stage of the channel acts on all torque of the stages
    before it.
    """

    name: str
    law: Callable
    physical: tuple
    domain: str = "time"
    loaded: bool = False
    linear: bool = True
    agrees: bool = True
    stage: int = 0
    steps: Mapping = field(default_factory=dict)
    shapes: tuple = ({},)
    records: tuple = ()
    numbers: Mapping | Callable = field(default_factory=dict)
    weights: str = "one"

    def columns(self, scene, shape):
        """Torque per unit of size, N m, (n, k)."""
        torque = np.asarray(self.law(scene, shape))
        return torque if torque.ndim == 2 else torque[:, None]

    def grid(self, scene):
        """Shapes that stand for the family where it is only compared."""
        return [_in_seconds(scene, shape) for shape in self.shapes]

    def draw(self, rng, scene):
        """Draw a shape."""
        shape = self.numbers(rng) if callable(self.numbers) else draw_numbers(self.numbers, rng)
        return {**_in_seconds(scene, shape), "weights": WEIGHTS[self.weights](rng)}


def _in_seconds(scene, shape):
    return {k: v * scene.path.seconds if k.endswith("_s") else v for k, v in shape.items()}


def families(laws, table=TABLE, numbers=(), kind=Family):
    """The families of laws by name; `numbers` are functions that draw what no table tells."""
    out = []
    for name, law in laws.items():
        entry = {**table[name], **({"numbers": numbers[name]} if name in numbers else {})}
        usual = ("short", "protocol") if entry.get("loaded") else ("mixed", "short", "protocol")
        entry["records"] = tuple(entry.get("records", usual))
        entry["shapes"] = tuple(entry.pop("grid", ({},)))
        out.append(kind(name, law, **entry))
    return tuple(out)


def draw_numbers(laws, rng):
    """Draw numbers by name, each by its law: [low, high], or one of LAWS."""
    out = {}
    for name, law in laws.items():
        ((kind, values),) = law.items() if isinstance(law, dict) else [("even", law)]
        out[name] = LAWS[kind](rng, *values)
    return out


LAWS = {
    "even": lambda rng, low, high: float(rng.uniform(low, high)),
    "signed": lambda rng, low, high: float(rng.uniform(low, high) * rng.choice([-1.0, 1.0])),
    "by ratio": lambda rng, low, high: float(np.exp(rng.uniform(np.log(low), np.log(high)))),
    "near": lambda rng, *values: np.array(values) * rng.uniform(0.93, 1.07, len(values)),
    "one of": lambda rng, *values: float(rng.choice(values)),
    "whole": lambda rng, low, high: int(rng.integers(low, high)),
    "seed": lambda rng: float(rng.integers(2**31)),
    "phases": lambda rng, count: rng.uniform(-np.pi, np.pi, count).tolist(),
}


def _phases(count):
    """Cosine and sine of a random phase for each harmonic, the next half as large."""

    def weights(rng):
        phase, size = rng.uniform(-np.pi, np.pi, count), 0.5 ** np.arange(count)
        return tuple(np.column_stack([size * np.cos(phase), size * np.sin(phase)]).ravel())

    return weights


def _beat(rng):
    beat, phase = rng.uniform(-np.pi, np.pi, 2)
    return tuple(np.outer([np.cos(beat), np.sin(beat)], [np.cos(phase), np.sin(phase)]).ravel())


def _mirrored(rng):
    cosine, sine = _phases(1)(rng)
    return cosine, -sine


WEIGHTS = {
    "one": lambda rng: (1.0,),
    "sign": lambda rng: (float(rng.choice([1.0, -1.0])),),
    "phase": _phases(1),
    "three phases": _phases(3),
    "beat": _beat,
    "mirrored": _mirrored,
}


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
