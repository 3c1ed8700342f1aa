"""Effects that no entry of the catalogue has, or has only nearly."""

import numpy as np

from .family import families, sign_curve, waves
from .lines import line

# the catalogue's lines have a free order: at the right place such a name is no error; and
# a walk of the zero may take any slow course
ACCEPTED = {
    name: ["ripple-harmonic", "bearing-defect"]
    for name in ("order-3.37", "order-8", "subharmonic-0.5")
} | {"zero-swing": ["zero-random-walk"]}


def _bump(scene, shape):
    """A damaged tooth: a bump of 0.03 rad at one angle of the output."""
    away = np.mod(scene.path.output - shape["place_rad"] + np.pi, 2.0 * np.pi) - np.pi
    return np.exp(-0.5 * (away / 0.03) ** 2)


def _chirp(scene, shape):
    time, seconds = scene.path.time, scene.path.seconds
    rate = (shape["to_hz"] - shape["from_hz"]) / seconds
    return waves(2.0 * np.pi * (shape["from_hz"] * time + 0.5 * rate * time**2))


def _windage(scene, shape):
    return scene.path.speed * np.abs(scene.path.speed) / 400.0**2


def _rate_speed(scene, shape):
    rate = np.gradient(scene.tau, scene.path.time)
    return rate * scene.path.speed / 1000.0


def _contact(scene, shape):
    """A loose contact: some fifteen bursts of 5 to 40 ms, of one height each."""
    rng = np.random.default_rng(int(shape["seed"]))
    out = np.zeros(len(scene.path.time))
    for start in rng.integers(0, len(out) - 50, 15):
        out[start : start + int(rng.integers(5, 40))] += rng.uniform(-1.0, 1.0)
    return out


def _wander(scene, shape):
    """A zero that moves in one slow swing of no fixed form."""
    time = scene.path.time / scene.path.seconds
    return np.exp(-0.5 * ((time - shape["place"]) / 0.06) ** 2)


def _friction_of_angle(scene, shape):
    return sign_curve(scene.path.speed, 0.6)[:, None] * waves(2.0 * scene.path.angle)


OUTSIDE = families(
    {
        "order-3.37": line(3.37),
        "order-8": line(8.0),
        "subharmonic-0.5": line(0.5),
        "tooth-damage": _bump,
        "chirp": _chirp,
        "windage": _windage,
        "rate-times-speed": _rate_speed,
        "zero-swing": _wander,
        "loose-contact": _contact,
        "friction-of-angle": _friction_of_angle,
    }
)
