"""Families of friction, sensor, stiffness, dynamics and slow changes of the zero."""

import numpy as np
from scipy.signal import lfilter

from .family import branch_loop, families, sign_curve
from .motion import EVERY, FINE_S, RATIO

_FULL_NM = 25.0


def _coulomb(scene, shape):
    return sign_curve(scene.path.speed, shape["width"])


def _loaded_friction(scene, shape):
    return np.sqrt(scene.tau**2 + 0.01) * _coulomb(scene, shape)


def _stribeck(scene, shape):
    speed = scene.path.speed
    fall = np.exp(-((np.abs(speed) / shape["speed"]) ** shape["power"]))
    return fall * sign_curve(speed, shape["width"])


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


def _soft(scene, shape):
    """A soft limit L = 1 / size by an algebraic knee: gentle (power 2) or sharp (power 4).

    It is the channel that has a limit: all of its torque, zero, ripple and other effects too.
    """
    whole, power = scene.signal, shape["power"]
    return whole / (1.0 + np.abs(whole * shape["size"]) ** power) ** (1.0 / power) - whole


def _hard(scene, shape):
    """Counter force of a dead zone of half width `size`, by the arctangent."""
    return -shape["size"] * sign_curve(scene.tau, shape["size"])


def _skew(scene, shape):
    """The channel is read late: all of its torque is that of an earlier instant.

    A spline over the samples would not do: lines above half the sampling rate alias.
    """
    return scene.earlier(shape["size"]).signal - scene.earlier(0.0).signal


def _relax(scene, shape):
    """A first-order state that follows the load, integrated exactly on each sample."""
    pole = np.exp(-FINE_S * EVERY / shape["constant_s"])
    load = scene.path.load
    return lfilter([0.0, 1.0 - pole], [1.0, -pole], load, zi=[0.0])[0]


def _walk(scene, shape):
    rng = np.random.default_rng(int(shape["seed"]))
    walk = np.cumsum(rng.standard_normal(len(scene.path.time)))
    return walk / np.sqrt(len(walk))


MECHANICS = families(
    {
        "coulomb-friction": _coulomb,
        "viscous-friction": lambda scene, shape: scene.path.speed / 400.0,
        "stribeck-friction": _stribeck,
        "load-dependent-friction": _loaded_friction,
        "presliding": lambda scene, shape: branch_loop(
            scene.path.angle, shape["reach"], shape["skew"]
        ),
        "gain-error": lambda scene, shape: scene.tau,
        "cubic-nonlinearity": lambda scene, shape: scene.tau**3 / _FULL_NM**3,
        "hysteresis": lambda scene, shape: branch_loop(scene.tau, shape["reach"], shape["skew"]),
        "backlash": _hard,
        "saturation": _soft,
        "direction-asymmetry": lambda scene, shape: np.sqrt(scene.tau**2 + 0.0025) - 0.05,
        "inertia-error": lambda scene, shape: scene.bench.inertia / RATIO * scene.path.accel,
        "time-skew": _skew,
        "cubic-stiffness": _stiff_cubic,
        "piecewise-stiffness": _stiff_pieces,
        "zero-step": lambda scene, shape: (scene.path.time >= shape["at_s"]).astype(float),
        "zero-drift": lambda scene, shape: scene.path.time / scene.path.seconds,
        "warm-up": lambda scene, shape: 1.0 - np.exp(-scene.path.time / shape["constant_s"]),
        "creep": _relax,
        "zero-random-walk": _walk,
        "crosstalk": lambda scene, shape: scene.current,
    }
)
