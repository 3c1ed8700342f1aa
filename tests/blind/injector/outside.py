"""Effects that no entry of the catalogue has, or has only nearly."""

import numpy as np

from .family import Family, sign_curve, waves

# the catalogue's lines have a free order: at the right place such a name is no error; and
# a walk of the zero may take any slow course
ACCEPTED = {
    name: ["ripple-harmonic", "bearing-defect"]
    for name in ("order-3.37", "order-8", "subharmonic-0.5")
} | {"zero-swing": ["zero-random-walk"]}

_FREE = ("mixed", "short", "protocol")


def _column(curve):
    return lambda scene, shape: np.asarray(curve(scene, shape))[:, None]


def _phase(rng):
    phase = rng.uniform(-np.pi, np.pi)
    return {"weights": (float(np.cos(phase)), float(np.sin(phase)))}


def _order(order):
    return lambda scene, shape: waves(order * scene.path.angle)


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


def _place(name, low, high):
    return lambda rng, scene: {name: float(rng.uniform(low, high)), "weights": (1.0,)}


OUTSIDE = (
    Family("order-3.37", _order(3.37), lambda r, s: _phase(r), (0.02, 0.1, 0.3),
           domain="motor-order", records=_FREE),
    Family("order-8", _order(8.0), lambda r, s: _phase(r), (0.02, 0.1, 0.3),
           domain="motor-order", records=_FREE),
    Family("subharmonic-0.5", _order(0.5), lambda r, s: _phase(r), (0.02, 0.1, 0.3),
           domain="motor-order", records=_FREE),
    Family("tooth-damage", _column(_bump), _place("place_rad", 0.3, 2.5), (0.1, 0.3, 1.0),
           domain="output-order", records=_FREE),
    Family("chirp", _chirp,
           lambda rng, scene: {"from_hz": float(rng.uniform(20.0, 60.0)),
                               "to_hz": float(rng.uniform(90.0, 200.0)), **_phase(rng)},
           (0.05, 0.2, 0.5), domain="frequency", records=_FREE),
    Family("windage", _column(_windage), lambda rng, scene: {"weights": (1.0,)},
           (0.1, 0.3, 1.0), domain="velocity", records=_FREE),
    Family("rate-times-speed", _column(_rate_speed), lambda rng, scene: {"weights": (1.0,)},
           (0.05, 0.2, 0.5), domain="velocity", records=_FREE),
    Family("zero-swing", _column(_wander), _place("place", 0.25, 0.75), (0.02, 0.1, 0.3),
           domain="time", records=_FREE),
    Family("loose-contact", _column(_contact),
           lambda rng, scene: {"seed": float(rng.integers(2**31)), "weights": (1.0,)},
           (0.1, 0.3, 1.0), domain="time", records=_FREE),
    Family("friction-of-angle",
           lambda scene, shape: (
               sign_curve(scene.path.speed, 0.6)[:, None] * waves(2.0 * scene.path.angle)
           ),
           lambda r, s: _phase(r), (0.02, 0.1, 0.3), domain="motor-order", records=_FREE),
)  # fmt: skip
