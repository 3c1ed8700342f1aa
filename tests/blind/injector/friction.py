"""Families of friction."""

import numpy as np

from .family import Family, branch_loop, sign_curve
from .shapes import column, draw_loop, unit, width

__all__ = ["FRICTION"]

_FREE = ("mixed", "short", "protocol")


def _stribeck(scene, shape):
    speed = scene.path.speed
    fall = np.exp(-((np.abs(speed) / shape["speed"]) ** shape["power"]))
    return fall * sign_curve(speed, shape["width"])


def _draw_stribeck(rng, scene):
    return {
        "speed": float(rng.uniform(7.0, 35.0)),
        "power": float(rng.uniform(1.4, 2.3)),
        "width": float(rng.uniform(0.3, 0.8)),
        "weights": (1.0,),
    }


FRICTION = (
    Family(
        "coulomb-friction",
        column(lambda scene, shape: sign_curve(scene.path.speed, shape["width"])),
        width(0.3, 1.5),
        (0.1, 0.3, 1.0),
        {"width": 1e-3},
        lambda scene: [{"width": 0.7}],
        domain="velocity",
        records=_FREE,
        shape_agrees=False,
    ),
    Family(
        "viscous-friction",
        column(lambda scene, shape: scene.path.speed / 400.0),
        unit,
        (0.1, 0.3, 1.0),
        domain="velocity",
        records=_FREE,
    ),
    Family(
        "stribeck-friction",
        column(_stribeck),
        _draw_stribeck,
        (0.1, 0.3, 0.6),
        {"speed": 0.01, "width": 1e-3},
        lambda scene: [
            {"speed": v, "power": 2.0, "width": 0.5} for v in (8.0, 15.0, 30.0)
        ],
        domain="velocity",
        shape_agrees=False,
        records=_FREE,
    ),
    Family(
        "load-dependent-friction",
        column(
            lambda scene, shape: (
                np.sqrt(scene.tau**2 + 0.01) * sign_curve(scene.path.speed, shape["width"])
            )
        ),
        width(0.3, 1.5),
        (0.02, 0.05, 0.1),
        {"width": 1e-3},
        lambda scene: [{"width": 0.7}],
        loaded=True,
        domain="velocity",
        shape_agrees=False,
    ),
    Family(
        "presliding",
        column(
            lambda scene, shape: branch_loop(scene.path.angle, shape["reach"], shape["skew"])
        ),
        draw_loop(0.08, 0.5),
        (0.1, 0.3, 0.6),
        {"reach": 1e-3},
        lambda scene: [{"reach": r, "skew": 0.0} for r in (0.1, 0.3)],
        domain="velocity",
        shape_agrees=False,
        records=_FREE,
    ),
)  # fmt: skip
