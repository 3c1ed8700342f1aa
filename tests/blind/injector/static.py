"""Families of the sensor's curve, of stiffness, of inertia and delay."""

import numpy as np

from .family import Family, branch_loop, sign_curve
from .path import EVERY, RATIO
from .pieces import FINE_S
from .shapes import column, draw_loop, either_sign, unit

__all__ = ["CROSSTALK", "STATIC"]

_FREE = ("mixed", "short", "protocol")
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

    It is the channel that has a limit: all of its torque, zero and ripple too.
    """
    whole, power = scene.clean, shape["power"]
    return whole / (1.0 + np.abs(whole * shape["size"]) ** power) ** (1.0 / power) - whole


def _draw_soft(rng, scene):
    return {"power": float(rng.choice([2.0, 4.0])), "weights": (1.0,)}


def _hard(scene, shape):
    """Counter force of a dead zone of half width `size`, by the arctangent."""
    return -shape["size"] * sign_curve(scene.tau, shape["size"])


def _skew(scene, shape):
    delay = shape["size"]
    fine = scene.fine_clean()
    time = np.arange(len(fine)) * FINE_S
    return np.interp(time[::EVERY] - delay, time, fine) - fine[::EVERY]


STATIC = (
    Family(
        "gain-error", column(lambda scene, shape: scene.tau), either_sign, (0.005, 0.01, 0.03),
        loaded=True, domain="torque",
    ),
    Family(
        "cubic-nonlinearity",
        column(lambda scene, shape: scene.tau**3 / _FULL_NM**3),
        either_sign,
        (0.05, 0.15, 0.5),
        loaded=True,
        domain="torque",
    ),
    Family(
        "hysteresis",
        column(_loop),
        draw_loop(1.5, 6.0),
        (0.04, 0.2, 1.0),
        {"reach": 1e-2},
        lambda scene: [{"reach": r, "skew": 0.0} for r in (1.5, 3.5, 7.0)],
        loaded=True,
        domain="torque",
        shape_agrees=False,
    ),
    Family(
        "backlash",
        column(_hard),
        unit,
        (0.1, 0.5, 1.5),
        grid=lambda scene: [{"size": b} for b in (0.1, 0.6, 1.5)],
        loaded=True,
        linear=False,
        domain="torque",
        shape_agrees=False,
    ),
    Family(
        "saturation",
        column(_soft),
        _draw_soft,
        (1.0 / 60.0, 1.0 / 40.0, 1.0 / 26.0),
        grid=lambda scene: [{"size": 1.0 / 60.0, "power": 4.0}, {"size": 1.0 / 60.0, "power": 2.0}],
        loaded=True,
        linear=False,
        domain="torque",
        shape_agrees=False,
    ),
    Family(
        "direction-asymmetry",
        column(lambda scene, shape: np.sqrt(scene.tau**2 + 0.0025) - 0.05),
        either_sign,
        (0.002, 0.005, 0.02),
        loaded=True,
        domain="torque",
    ),
    Family(
        "inertia-error",
        column(lambda scene, shape: scene.bench.inertia / RATIO * scene.path.accel),
        either_sign,
        (0.02, 0.05, 0.1),
        domain="torque",
        records=_FREE,
    ),
    Family(
        "time-skew", column(_skew), unit, (0.0002, 0.001, 0.003),
        grid=lambda scene: [{"size": 0.0005}], linear=False, domain="time", records=_FREE,
    ),
    Family(
        "cubic-stiffness", column(_stiff_cubic), unit, (0.05, 0.15, 0.5),
        grid=lambda scene: [{"size": 0.2}], loaded=True, linear=False, domain="torque",
        shape_agrees=False,
    ),
    Family(
        "piecewise-stiffness",
        column(_stiff_pieces),
        _draw_pieces,
        (0.005, 0.02, 0.05),
        {"kink_one": 1e-3, "kink_two": 1e-3},
        lambda scene: [{"kink_one": a, "kink_two": b, "ratio": 1.4}
                       for a, b in ((5.0, 14.0), (7.0, 16.0))],
        loaded=True,
        domain="torque",
        shape_agrees=False,
    ),
)  # fmt: skip

CROSSTALK = (
    Family(
        "crosstalk",
        column(lambda scene, shape: scene.current),
        either_sign,
        (0.005, 0.02, 0.05),
        records=_FREE,
    ),
)
