"""Families locked to the motor, to the output or to the clock."""

import numpy as np
from scipy.signal import bilinear, lfilter

from .bench import LOAD_INERTIA
from .family import families, waves
from .motion import EVERY, FINE_S

_TEETH = 202.0
_ARCMIN = np.pi / 180.0 / 60.0


def _bearing(rng):
    """Rolling elements, ball ratio and contact angle of a wave-generator bearing."""
    balls, ratio = int(rng.integers(17, 26)), rng.uniform(0.07, 0.13)
    slope = ratio * np.cos(rng.uniform(0.0, 0.3))
    orders = (
        0.5 * balls * (1.0 - slope),
        0.5 * balls * (1.0 + slope),
        (1.0 - slope**2) / (2.0 * ratio),
    )
    return {"order": float(orders[rng.integers(3)])}


def _resonator(hertz, damping):
    pole = 2.0 * np.pi * hertz
    # matched at the resonance itself, where the bilinear map would shift it
    rate = pole / np.tan(0.5 * pole * FINE_S)
    return bilinear([pole**2], [1.0, 2.0 * damping * pole, pole**2], fs=0.5 * rate)


def _resonance(scene, shape):
    over, under = _resonator(shape["resonance_hz"], shape["damping"])
    drive = waves(shape["order"] * scene.path.fine_angle)
    return lfilter(over, under, drive, axis=0)[::EVERY]


def _driven(rng):
    """The order that drives a resonance, and its place within the speeds of the records."""
    order, low, high = (4.0, 150.0, 206.0) if rng.random() < 0.75 else (2.0, 95.0, 115.0)
    hertz = float(rng.uniform(low, high))
    return {"order": order, "resonance_hz": hertz, "damping": float(rng.uniform(0.02, 0.05))}


def _kinematic(scene, shape):
    """The load follows theta_m / N + e through a stiff spring: J times its acceleration."""
    path, k = scene.path, shape["order"]
    c, s = np.cos(k * path.fine_angle), np.sin(k * path.fine_angle)
    square, pull = (k * path.fine_speed) ** 2, k * path.fine_accel
    error = np.column_stack([-square * c - pull * s, -square * s + pull * c])
    over, under = _resonator(1800.0, 0.05)
    return LOAD_INERTIA * _ARCMIN * lfilter(over, under, error, axis=0)[::EVERY]


def _clock(scene, shape):
    return waves(2.0 * np.pi * shape["frequency_hz"] * scene.path.time)


def _mains(rng):
    return {"frequency_hz": float(50.0 + rng.uniform(-0.04, 0.04))}


def _tone(rng):
    """A frequency from 5 to 450 Hz that is no mains line."""
    place = 50.0
    while abs(place - 50.0) < 3.0 or abs(place - 60.0) < 3.0:
        place = float(rng.uniform(5.0, 450.0))
    return {"frequency_hz": place}


def line(order=None, harmonics=(1.0,)):
    """Law of a line at `order` of the motor, or at the one that the shape gives."""

    def law(scene, shape):
        place = shape["order"] if order is None else order
        return np.column_stack([waves(m * place * scene.path.angle) for m in harmonics])

    return law


def _twice_output(scene, shape):
    return waves(2.0 * scene.path.output)


def _beat(scene, shape):
    ripple = waves(2.0 * scene.path.angle)
    return np.column_stack([wave[:, None] * ripple for wave in waves(scene.path.output).T])


def _unbalance(scene, shape):
    return (scene.path.speed[:, None] / 300.0) ** 2 * waves(scene.path.angle)


def _loaded_ripple(scene, shape):
    return np.sqrt(scene.tau[:, None] ** 2 + 0.01) * waves(2.0 * scene.path.angle)


def _gain_ripple(scene, shape):
    return scene.tau[:, None] * waves(2.0 * scene.path.angle)


def _gain_of_position(scene, shape):
    return scene.tau[:, None] * waves(shape["output_order"] * scene.path.output)


LINES = families(
    {
        "ripple-harmonic": line(),
        "wave-generator-eccentricity": line(1.0),
        "motor-unbalance": _unbalance,
        "load-dependent-ripple": _loaded_ripple,
        "torsional-resonance": _resonance,
        "ripple-beat": _beat,
        "kinematic-error": _kinematic,
        "tooth-mesh": line(_TEETH),
        "bearing-defect": line(harmonics=(1.0, 2.0, 3.0)),
        "gain-ripple": _gain_ripple,
        "angular-misalignment": _twice_output,
        "position-dependent-gain": _gain_of_position,
        "mains-hum": _clock,
        "structural-tone": _clock,
        "arm-sag": _twice_output,
    },
    numbers={
        "torsional-resonance": _driven,
        "bearing-defect": _bearing,
        "mains-hum": _mains,
        "structural-tone": _tone,
    },
)
