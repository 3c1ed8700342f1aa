"""Effects that no entry of the catalogue has, or has only nearly."""

import numpy as np

from .family import column, families, sign_curve, unit, waves

# the catalogue's lines have a free order: at the right place such a name is no error; and
# a walk of the zero may take any slow course
ACCEPTED = {
    name: ["ripple-harmonic", "bearing-defect"]
    for name in ("order-3.37", "order-8", "subharmonic-0.5")
} | {"zero-swing": ["zero-random-walk"]}


def _phase(rng, scene):
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


OUTSIDE = families({
    "order-3.37": (_order(3.37), _phase),
    "order-8": (_order(8.0), _phase),
    "subharmonic-0.5": (_order(0.5), _phase),
    "tooth-damage": (column(_bump), _place("place_rad", 0.3, 2.5)),
    "chirp": (
        _chirp,
        lambda rng, scene: {"from_hz": float(rng.uniform(20.0, 60.0)),
                            "to_hz": float(rng.uniform(90.0, 200.0)), **_phase(rng, scene)},
    ),
    "windage": (column(_windage), unit),
    "rate-times-speed": (column(_rate_speed), unit),
    "zero-swing": (column(_wander), _place("place", 0.25, 0.75)),
    "loose-contact": (
        column(_contact),
        lambda rng, scene: {"seed": float(rng.integers(2**31)), "weights": (1.0,)},
    ),
    "friction-of-angle": (
        lambda scene, shape: (
            sign_curve(scene.path.speed, 0.6)[:, None] * waves(2.0 * scene.path.angle)
        ),
        _phase,
    ),
})  # fmt: skip
