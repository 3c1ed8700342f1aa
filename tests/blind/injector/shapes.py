"""Shapes that several families draw, and curves as single columns."""

import numpy as np

__all__ = ["column", "draw_loop", "either_sign", "unit", "width"]


def column(curve):
    return lambda scene, shape: np.asarray(curve(scene, shape))[:, None]


def either_sign(rng, scene):
    return {"weights": (float(rng.choice([1.0, -1.0])),)}


def unit(rng, scene):
    return {"weights": (1.0,)}


def width(low, high, name="width"):
    return lambda rng, scene: {name: float(rng.uniform(low, high)), "weights": (1.0,)}


def draw_loop(low, high):
    def draw(rng, scene):
        reach, skew = rng.uniform(low, high), rng.uniform(0.0, 0.35)
        return {"reach": float(reach), "skew": float(skew), "weights": (1.0,)}

    return draw
