"""Families of slow changes of the zero, and creep."""

import numpy as np
from scipy.signal import lfilter

from .family import Family
from .path import EVERY
from .pieces import FINE_S
from .shapes import column, either_sign, unit

__all__ = ["SLOW"]

_FREE = ("mixed", "short", "protocol")
_SLOW = ("mixed", "short", "protocol", "long")


def _relax(scene, seconds):
    """A first-order state that follows the load, integrated exactly on each sample."""
    pole = np.exp(-FINE_S * EVERY / seconds)
    load = scene.path.load
    return lfilter([0.0, 1.0 - pole], [1.0, -pole], load, zi=[0.0])[0]


def _step(scene, shape):
    return (scene.path.time >= shape["at_s"]).astype(float)


def _draw_step(rng, scene):
    at = rng.uniform(0.2, 0.8) * scene.path.seconds
    return {"at_s": float(at), **either_sign(rng, scene)}


def _warm(scene, shape):
    time = scene.path.time
    return 1.0 - np.exp(-time / shape["constant_s"])


def _draw_warm(rng, scene):
    return {
        "constant_s": float(rng.uniform(0.12, 0.4) * scene.path.seconds),
        **either_sign(rng, scene),
    }


def _walk(scene, shape):
    rng = np.random.default_rng(int(shape["seed"]))
    walk = np.cumsum(rng.standard_normal(len(scene.path.time)))
    return walk / np.sqrt(len(walk))


SLOW = (
    Family(
        "zero-step",
        column(_step),
        _draw_step,
        (0.02, 0.1, 0.5),
        grid=lambda scene: [{"at_s": f * scene.path.seconds} for f in (0.25, 0.5, 0.75)],
        records=_FREE,
    ),
    Family(
        "zero-drift",
        column(lambda scene, shape: scene.path.time / scene.path.seconds),
        either_sign,
        (0.02, 0.1, 0.4),
        records=_SLOW,
    ),
    Family(
        "warm-up",
        column(_warm),
        _draw_warm,
        (0.02, 0.1, 0.4),
        {"constant_s": 0.01},
        lambda scene: [{"constant_s": f * scene.path.seconds} for f in (0.15, 0.3, 1.0, 2.5)],
        records=_SLOW,
    ),
    Family(
        "creep",
        column(lambda scene, shape: _relax(scene, shape["constant_s"])),
        lambda rng, scene: {
            "constant_s": float(rng.uniform(0.05, 0.25) * scene.path.seconds),
            **unit(rng, scene),
        },
        (0.0005, 0.002, 0.005),
        {"constant_s": 0.01},
        lambda scene: [{"constant_s": f * scene.path.seconds} for f in (0.06, 0.2)],
        loaded=True,
        records=("short", "protocol", "long"),
    ),
    Family(
        "zero-random-walk",
        column(_walk),
        lambda rng, scene: {"seed": float(rng.integers(2**31)), **unit(rng, scene)},
        (0.02, 0.1, 0.3),
        grid=lambda scene: [],
        shape_agrees=False,
        records=_FREE,
    ),
)  # fmt: skip
