"""Families locked to the motor, to the output or to the clock."""

import numpy as np
from scipy.signal import bilinear, lfilter

from .bench import LOAD_INERTIA
from .family import families, waves
from .motion import EVERY, FINE_S

_TEETH = 202.0
_ARCMIN = np.pi / 180.0 / 60.0


def _mixed(count):
    def weights(rng):
        phase = rng.uniform(-np.pi, np.pi, count)
        size = 0.5 ** np.arange(count)
        return tuple(np.column_stack([size * np.cos(phase), size * np.sin(phase)]).ravel())

    return weights


def _phase(rng, scene):
    return {"weights": _mixed(1)(rng)}


def _order(rng, scene):
    return {"order": float(rng.choice([3.0, 5.0, 6.0, 7.0, 8.0, 10.0])), **_phase(rng, scene)}


def _bearing(rng, scene):
    """Rolling elements, ball ratio and contact angle of a wave-generator bearing."""
    balls, ratio = int(rng.integers(17, 26)), rng.uniform(0.07, 0.13)
    slope = ratio * np.cos(rng.uniform(0.0, 0.3))
    orders = (
        0.5 * balls * (1.0 - slope),
        0.5 * balls * (1.0 + slope),
        (1.0 - slope**2) / (2.0 * ratio),
    )
    return {"order": float(orders[rng.integers(3)]), "weights": _mixed(3)(rng)}


def _beat(rng, scene):
    beat, phase = rng.uniform(-np.pi, np.pi, 2)
    one = np.array([np.cos(phase), np.sin(phase)])
    return {"weights": tuple(np.concatenate([np.cos(beat) * one, np.sin(beat) * one]))}


def _resonator(hertz, damping):
    pole = 2.0 * np.pi * hertz
    # matched at the resonance itself, where the bilinear map would shift it
    rate = pole / np.tan(0.5 * pole * FINE_S)
    return bilinear([pole**2], [1.0, 2.0 * damping * pole, pole**2], fs=0.5 * rate)


def _resonance(scene, shape):
    over, under = _resonator(shape["resonance_hz"], shape["damping"])
    drive = waves(shape["order"] * scene.path.fine_angle)
    return lfilter(over, under, drive, axis=0)[::EVERY]


def _draw_resonance(rng, scene):
    four = rng.random() < 0.75
    hertz = rng.uniform(150.0, 206.0) if four else rng.uniform(95.0, 115.0)
    damping = float(rng.uniform(0.02, 0.05))
    order = 4.0 if four else 2.0
    return {"order": order, "resonance_hz": float(hertz), "damping": damping, **_phase(rng, scene)}


def _kinematic(scene, shape):
    """The load follows theta_m / N + e through a stiff spring: J times its acceleration."""
    path, k = scene.path, shape["order"]
    c, s = np.cos(k * path.fine_angle), np.sin(k * path.fine_angle)
    square, pull = (k * path.fine_speed) ** 2, k * path.fine_accel
    error = np.column_stack([-square * c - pull * s, -square * s + pull * c])
    over, under = _resonator(1800.0, 0.05)
    return LOAD_INERTIA * _ARCMIN * lfilter(over, under, error, axis=0)[::EVERY]


def _unit(place):
    return lambda scene, shape: waves(place * scene.path.angle)


def _clock(scene, shape):
    return waves(2.0 * np.pi * shape["frequency_hz"] * scene.path.time)


def _at(rng, hertz):
    return {"frequency_hz": float(hertz), **_phase(rng, None)}


def _tone(rng):
    """A frequency from 5 to 450 Hz that is no mains line."""
    place = 50.0
    while abs(place - 50.0) < 3.0 or abs(place - 60.0) < 3.0:
        place = float(rng.uniform(5.0, 450.0))
    return place


LINES = families({
    "ripple-harmonic": (lambda scene, shape: waves(shape["order"] * scene.path.angle), _order),
    "wave-generator-eccentricity": (_unit(1.0), _phase),
    "motor-unbalance": (
        lambda scene, shape: (scene.path.speed[:, None] / 300.0) ** 2 * waves(scene.path.angle),
        _phase,
    ),
    "load-dependent-ripple": (
        lambda scene, shape: (
            np.sqrt(scene.tau[:, None] ** 2 + 0.01) * waves(2.0 * scene.path.angle)
        ),
        _phase,
    ),
    "torsional-resonance": (_resonance, _draw_resonance),
    "ripple-beat": (
        lambda scene, shape: np.column_stack(
            [wave[:, None] * waves(2.0 * scene.path.angle) for wave in waves(scene.path.output).T]
        ),
        _beat,
    ),
    "kinematic-error": (
        _kinematic,
        lambda rng, scene: {"order": float(rng.choice([1.0, 2.0, 2.0, 4.0])), **_phase(rng, scene)},
    ),
    "tooth-mesh": (_unit(_TEETH), _phase),
    "bearing-defect": (
        lambda scene, shape: np.column_stack(
            [waves(m * shape["order"] * scene.path.angle) for m in (1.0, 2.0, 3.0)]
        ),
        _bearing,
    ),
    "gain-ripple": (
        lambda scene, shape: scene.tau[:, None] * waves(2.0 * scene.path.angle), _phase
    ),
    "angular-misalignment": (lambda scene, shape: waves(2.0 * scene.path.output), _phase),
    "position-dependent-gain": (
        lambda scene, shape: scene.tau[:, None] * waves(shape["output_order"] * scene.path.output),
        lambda rng, scene: {"output_order": float(rng.choice([1.0, 2.0])), **_phase(rng, scene)},
    ),
    "mains-hum": (_clock, lambda rng, scene: _at(rng, 50.0 + rng.uniform(-0.04, 0.04))),
    "structural-tone": (_clock, lambda rng, scene: _at(rng, _tone(rng))),
    "arm-sag": (lambda scene, shape: waves(2.0 * scene.path.output), _phase),
})  # fmt: skip
