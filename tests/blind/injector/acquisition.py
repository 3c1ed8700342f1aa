"""Faults of the acquisition: they act on channels, not on the torque."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

__all__ = ["ACQUISITION", "Fault"]

_COUNT = 2.0 * np.pi / 4000.0
_BIT_NM = 20.0 / 65536.0 * 6.6


@dataclass(frozen=True)
class Fault:
    """One fault: `apply(channels, scene, shape, size, rng)` changes channels in place.

    `sigmas(scene, white, shape)` is the detectability at size 1 (None: physical sizes only); it
    grows with the size to the `power`.
    """

    name: str
    draw: Callable
    apply: Callable
    physical: tuple
    sigmas: Callable | None = None
    domain: str = "time"
    power: int = 1
    records: tuple = ("mixed", "short", "protocol")


def _late(rng, scene):
    """An instant while the shaft turns."""
    path = scene.path
    busy = np.flatnonzero((np.abs(path.speed) > 20.0) & (path.time > 0.2 * path.seconds))
    busy = busy[path.time[busy] < 0.8 * path.seconds]
    return {"at_s": float(path.time[rng.choice(busy)])}


def _slip(channels, scene, shape, size, rng):
    channels["angle"] += np.where(scene.path.time >= shape["at_s"], round(size) * _COUNT, 0.0)


def _slip_sigmas(scene, white, shape):
    path, bench = scene.path, scene.bench
    slope = sum(o * a * np.cos(o * path.angle + p) for o, a, p in bench.ripple)
    left = white.rest(np.where(path.time >= shape["at_s"], _COUNT * slope, 0.0))
    return float(np.sqrt(left @ left))


def _commutator(scene, shape):
    path = scene.path
    return path.speed * np.cos(shape["segments"] * path.angle + shape["phase_rad"])


def _tacho(channels, scene, shape, size, rng):
    channels["tacho"] += size * _commutator(scene, shape)


def _variance(scene):
    return (scene.path.speed / 400.0) ** 2


def _rough(channels, scene, shape, size, rng):
    grown = np.sqrt(1.0 + size**2 * _variance(scene)) - 1.0
    channels["torque"] += grown * channels["noise"]


def _rough_sigmas(scene, white, shape):
    """Fisher information of a variance 1 + s^2 g, first order in s^2; size is s."""
    g = _variance(scene)
    return float(np.sqrt(0.5 * np.sum((g - g.mean()) ** 2)))


def _spikes(channels, scene, shape, size, rng):
    at = rng.choice(len(channels["torque"]), size=int(shape["spikes"]), replace=False)
    signs = rng.choice([-1.0, 1.0], size=len(at))
    channels["torque"][at] += signs * size * scene.noise.sigma_nm * rng.uniform(0.8, 1.5, len(at))


def _coarse(channels, scene, shape, size, rng):
    channels["step_nm"] = 2.0 ** round(size) * _BIT_NM


def _lost(channels, scene, shape, size, rng):
    """Rows vanish, and the clock column runs on as if nothing had happened."""
    first = int(np.searchsorted(scene.path.time, shape["at_s"]))
    channels["lost"] = (first, first + round(size))


def _segments(rng, scene):
    return {"segments": float(rng.choice([22.0, 26.0])), "phase_rad": float(rng.uniform(-3, 3))}


ACQUISITION = (
    Fault("encoder-slip", _late, _slip, (3.0, 20.0, 400.0), _slip_sigmas),
    Fault("tacho-ripple", _segments, _tacho, (0.005, 0.015, 0.04), None, "velocity"),
    Fault(
        "speed-dependent-noise",
        lambda rng, scene: {},
        _rough,
        (0.5, 1.0, 3.0),
        _rough_sigmas,
        "variance",
        2,
    ),
    Fault(
        "spikes",
        lambda rng, scene: {"spikes": float(rng.choice([10, 40, 150]))},
        _spikes,
        (10.0, 20.0, 60.0),
        None,
        "outliers",
    ),
    Fault("quantisation", lambda rng, scene: {}, _coarse, (5.0, 6.0, 8.0), None, "torque"),
    Fault("missed-samples", _late, _lost, (5.0, 30.0, 150.0), None, "time"),
)
