"""Families of friction, sensor, stiffness, dynamics and slow changes of the zero."""

import numpy as np
from scipy.signal import lfilter

from .family import branch_loop, column, families, sign_curve, unit
from .motion import EVERY, FINE_S, RATIO


def either_sign(rng, scene):
    return {"weights": (float(rng.choice([1.0, -1.0])),)}


def width(low, high, name="width"):
    return lambda rng, scene: {name: float(rng.uniform(low, high)), "weights": (1.0,)}


def draw_loop(low, high):
    def draw(rng, scene):
        reach, skew = rng.uniform(low, high), rng.uniform(0.0, 0.35)
        return {"reach": float(reach), "skew": float(skew), "weights": (1.0,)}

    return draw


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


_FULL_NM = 25.0


def _loop(scene, shape):
    return branch_loop(scene.tau, shape["reach"], shape["skew"])


def _stiff_cubic(scene, shape):
    """Strain where torque = k (x + c x^3): x by Newton, less the straight line."""
    tau = scene.tau / _FULL_NM
    bend = shape["size"] / _FULL_NM
    x = tau.copy()
    for _ in range(6):
        x -= (x + bend * x**3 - tau) / (1.0 + 3.0 * bend * x**2)
    return _FULL_NM * (x - tau)


def _stiff_pieces(scene, shape):
    """Strain of three stiffnesses joined at T1 and T2, less that of the first."""
    load = np.abs(scene.tau)
    first = np.clip(load - shape["kink_one"], 0.0, shape["kink_two"] - shape["kink_one"])
    second = np.clip(load - shape["kink_two"], 0.0, None)
    return -np.sign(scene.tau) * (first + shape["ratio"] * second)


def _draw_pieces(rng, scene):
    return {
        "kink_one": float(rng.uniform(4.5, 8.0)),
        "kink_two": float(rng.uniform(13.0, 17.0)),
        "ratio": float(rng.uniform(1.2, 1.6)),
        "weights": (1.0,),
    }


def _soft(scene, shape):
    """A soft limit L = 1 / size by an algebraic knee: gentle (power 2) or sharp (power 4).

    It is the channel that has a limit: all of its torque, zero, ripple and other effects too.
    """
    whole, power = scene.signal, shape["power"]
    return whole / (1.0 + np.abs(whole * shape["size"]) ** power) ** (1.0 / power) - whole


def _draw_soft(rng, scene):
    return {"power": float(rng.choice([2.0, 4.0])), "weights": (1.0,)}


def _hard(scene, shape):
    """Counter force of a dead zone of half width `size`, by the arctangent."""
    return -shape["size"] * sign_curve(scene.tau, shape["size"])


def _skew(scene, shape):
    """The channel is read late: all of its torque is that of an earlier instant.

    A spline over the samples would not do: lines above half the sampling rate alias.
    """
    return scene.earlier(shape["size"]).signal - scene.earlier(0.0).signal


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


MECHANICS = families({
    "coulomb-friction": (
        column(lambda scene, shape: sign_curve(scene.path.speed, shape["width"])),
        width(0.3, 1.5),
    ),
    "viscous-friction": (column(lambda scene, shape: scene.path.speed / 400.0), unit),
    "stribeck-friction": (column(_stribeck), _draw_stribeck),
    "load-dependent-friction": (
        column(
            lambda scene, shape: (
                np.sqrt(scene.tau**2 + 0.01) * sign_curve(scene.path.speed, shape["width"])
            )
        ),
        width(0.3, 1.5),
    ),
    "presliding": (
        column(
            lambda scene, shape: branch_loop(scene.path.angle, shape["reach"], shape["skew"])
        ),
        draw_loop(0.08, 0.5),
    ),
    "gain-error": (column(lambda scene, shape: scene.tau), either_sign),
    "cubic-nonlinearity": (
        column(lambda scene, shape: scene.tau**3 / _FULL_NM**3), either_sign
    ),
    "hysteresis": (column(_loop), draw_loop(1.5, 6.0)),
    "backlash": (column(_hard), unit),
    "saturation": (column(_soft), _draw_soft),
    "direction-asymmetry": (
        column(lambda scene, shape: np.sqrt(scene.tau**2 + 0.0025) - 0.05), either_sign
    ),
    "inertia-error": (
        column(lambda scene, shape: scene.bench.inertia / RATIO * scene.path.accel), either_sign
    ),
    "time-skew": (column(_skew), unit),
    "cubic-stiffness": (column(_stiff_cubic), unit),
    "piecewise-stiffness": (column(_stiff_pieces), _draw_pieces),
    "zero-step": (column(_step), _draw_step),
    "zero-drift": (
        column(lambda scene, shape: scene.path.time / scene.path.seconds), either_sign
    ),
    "warm-up": (column(_warm), _draw_warm),
    "creep": (
        column(lambda scene, shape: _relax(scene, shape["constant_s"])),
        lambda rng, scene: {
            "constant_s": float(rng.uniform(0.05, 0.25) * scene.path.seconds),
            **unit(rng, scene),
        },
    ),
    "zero-random-walk": (
        column(_walk),
        lambda rng, scene: {"seed": float(rng.integers(2**31)), **unit(rng, scene)},
    ),
    "crosstalk": (column(lambda scene, shape: scene.current), either_sign),
})  # fmt: skip
