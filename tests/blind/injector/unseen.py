"""Unseen effects: a composer of smooth random functions over random axes, no list."""

import numpy as np

from .family import Family, families, waves

# axis of a function: domains of an answer that mean it
AXES = {
    "speed": "velocity",
    "abs-speed": "velocity",
    "time": "time",
    "output-angle": "output-order",
    "motor-angle": "motor-angle",
    "load": "load",
    "acceleration": "acceleration",
}
_FORMS = ("series", "kink", "root", "threshold", "exponential")
_TURNING = {"output-angle": 100.0, "motor-angle": 1.0}


def axis_values(scene, axis):
    """The axis from -1 to 1, or as an angle, rad."""
    path = scene.path
    raw = {
        "speed": path.speed, "abs-speed": np.abs(path.speed), "time": path.time,
        "load": scene.tau, "acceleration": path.accel,
        "output-angle": path.output, "motor-angle": path.angle,
    }[axis]  # fmt: skip
    if axis in _TURNING:
        return raw
    if axis == "acceleration":
        # some ramps are far steeper than all else: the scale is that of the middle nine tenths
        raw = np.tanh(raw / (np.quantile(np.abs(raw), 0.95) + 1e-9))
    low, high = raw.min(), raw.max()
    return 2.0 * (raw - low) / (high - low) - 1.0


def _curve(values, angle, rng):
    """A random function of an axis, about 1 in size."""
    if angle:
        orders = rng.choice(np.arange(1, 10), 3, replace=False)
        sizes, phases = rng.uniform(0.3, 1.0, 3), rng.uniform(-np.pi, np.pi, 3)
        waved = np.cos(np.outer(values, orders) + phases)
        return waved @ sizes
    form, place = str(rng.choice(_FORMS)), rng.uniform(-0.6, 0.6)
    side = rng.choice([-1.0, 1.0])
    if form == "series":
        sizes, phases = rng.standard_normal(4) / np.arange(1, 5), rng.uniform(-np.pi, np.pi, 4)
        return np.cos(np.outer(values, 0.5 * np.pi * np.arange(1, 5)) + phases) @ sizes
    if form == "kink":
        return np.maximum(0.0, side * (values - place))
    if form == "root":
        away = values - place
        return np.sign(away) * np.sqrt(np.abs(away) + 1e-3)
    if form == "threshold":
        return np.tanh((values - place) / rng.uniform(0.02, 0.1))
    return np.exp(side * rng.uniform(1.0, 3.0) * values) / np.e


def _bursts(scene, rng):
    """Half sines of one sign or both, at random or nearly even instants."""
    time, seconds = scene.path.time, scene.path.seconds
    count, width = int(rng.integers(6, 25)), rng.uniform(0.01, 0.06)
    even = (np.arange(count) + rng.uniform()) / count * seconds
    starts = even if rng.random() < 0.5 else rng.uniform(0.0, seconds, count)
    both = rng.random() < 0.5
    out = np.zeros(len(time))
    for start in starts:
        inside = (time >= start) & (time < start + width)
        sign = rng.choice([-1.0, 1.0]) if both else 1.0
        out[inside] += sign * rng.uniform(0.6, 1.0) * np.sin(np.pi * (time[inside] - start) / width)
    return out


def _law(scene, shape):
    rng = np.random.default_rng(int(shape["seed"]))
    if shape["recipe"] == "bursts":
        return _bursts(scene, rng)
    curve = np.ones(len(scene.path.time))
    for axis in shape["axes"]:
        curve = curve * _curve(axis_values(scene, axis), axis in _TURNING, rng)
    if shape["recipe"] != "order":
        return curve
    return curve[:, None] * waves(shape["order"] * scene.path.angle)


class _Composer(Family):
    def draw(self, rng, scene):
        """Draw a recipe: one axis, two of them, an order with an envelope, or bursts."""
        able = [axis for axis in AXES if axis != "load" or scene.path.loaded]
        recipe = str(rng.choice(["axis", "pair", "order", "bursts"], p=[0.4, 0.2, 0.25, 0.15]))
        count = {"axis": 1, "pair": 2, "order": 1, "bursts": 0}[recipe]
        axes = tuple(str(axis) for axis in rng.choice(able, count, replace=False))
        phase = rng.uniform(-np.pi, np.pi)
        order = float(rng.choice([rng.integers(1, 13), rng.uniform(0.3, 13.0)]))
        shape = {"seed": float(rng.integers(2**31)), "recipe": recipe, "axes": axes}
        if recipe != "order":
            return {**shape, "weights": (1.0,)}
        return {**shape, "order": order, "weights": (float(np.cos(phase)), float(np.sin(phase)))}


(UNSEEN,) = families({"unseen": _law}, kind=_Composer)
