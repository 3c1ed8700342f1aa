"""Faults of the acquisition that act on channels, and bad data that a broken bench hands over."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from .family import TABLE, draw_numbers

_COUNT = 2.0 * np.pi / 4000.0
_BIT_NM = 20.0 / 65536.0 * 6.6


@dataclass(frozen=True)
class Fault:
    """One fault: `apply(channels, scene, shape, size, rng)` changes channels in place.

    `sigmas(scene, white, shape)` is the detectability at size 1 (None: physical sizes only); it
    grows with the size to the `power`. families.toml has the rest.
    """

    name: str
    apply: Callable
    sigmas: Callable | None
    physical: tuple
    domain: str = "time"
    power: int = 1
    numbers: Mapping = field(default_factory=dict)
    late: bool = False
    records: tuple = ("mixed", "short", "protocol")

    def draw(self, rng, scene):
        """Draw a shape; a late one begins while the shaft turns."""
        return _late(rng, scene) if self.late else draw_numbers(self.numbers, rng)


def _late(rng, scene):
    """An instant while the shaft turns."""
    path = scene.path
    busy = np.flatnonzero((np.abs(path.speed) > 20.0) & (path.time > 0.2 * path.seconds))
    busy = busy[path.time[busy] < 0.8 * path.seconds]
    return {"at_s": float(path.time[rng.choice(busy)])}


def _slipped(channels, scene, shape, size, rng):
    channels["angle"] += np.where(scene.path.time >= shape["at_s"], round(size) * _COUNT, 0.0)


def _slip_sigmas(scene, white, shape):
    path, bench = scene.path, scene.bench
    slope = sum(o * a * np.cos(o * path.angle + p) for o, a, p in bench.ripple)
    left = white.rest(np.where(path.time >= shape["at_s"], _COUNT * slope, 0.0))
    return float(np.sqrt(left @ left))


def _tacho(channels, scene, shape, size, rng):
    wave = np.cos(shape["segments"] * scene.path.angle + shape["phase_rad"])
    channels["tacho"] += size * (scene.path.speed * wave)


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


_LAWS = {
    "encoder-slip": (_slipped, _slip_sigmas),
    "tacho-ripple": (_tacho, None),
    "speed-dependent-noise": (_rough, _rough_sigmas),
    "spikes": (_spikes, None),
    "quantisation": (_coarse, None),
    "missed-samples": (_lost, None),
}
ACQUISITION = tuple(Fault(name, *laws, **TABLE["faults"][name]) for name, laws in _LAWS.items())


def _span(columns, rng, low, high):
    count = len(columns["time_s"])
    length = int(rng.uniform(low, high) * 1000)
    first = int(rng.integers(count // 10, count - length - count // 10))
    return first, first + length


def _gaps(columns, rng):
    """Rows are missing; the clock column shows it."""
    keep = np.ones(len(columns["time_s"]), dtype=bool)
    for _ in range(int(rng.integers(2, 6))):
        first, last = _span(columns, rng, 0.05, 1.5)
        keep[first:last] = False
    return {name: values[keep] for name, values in columns.items()}


def _clipping(columns, rng):
    """The amplifier's range ends inside the signal."""
    volts = columns["torque_v"]
    limit = float(np.quantile(np.abs(volts - np.median(volts)), 0.985))
    middle = float(np.median(volts))
    clipped = np.clip(volts, middle - limit, middle + limit)
    return {**columns, "torque_v": clipped}


def _slip(columns, rng):
    """The encoder's disc slips by a tenth to half of a turn."""
    first, _ = _span(columns, rng, 0.1, 0.2)
    name = "encoder_count" if "encoder_count" in columns else "motor_angle_rad"
    one_count = 1.0 if name == "encoder_count" else 2.0 * np.pi / 4000.0
    angle = columns[name].copy()
    angle[first:] += one_count * int(rng.integers(400, 2000))
    return {**columns, name: angle}


def _units(columns, rng):
    """The torque channel is in millivolt."""
    return {**columns, "torque_v": columns["torque_v"] * 1000.0}


def _swapped(columns, rng):
    """Torque and tacho have changed places."""
    return {**columns, "torque_v": columns["tacho_v"], "tacho_v": columns["torque_v"]}


def _stuck(columns, rng):
    """The torque channel stands still for a while."""
    first, last = _span(columns, rng, 0.5, 3.0)
    volts = columns["torque_v"].copy()
    volts[first:last] = volts[first]
    return {**columns, "torque_v": volts}


def _loud_cell(columns, rng):
    """The brake's load cell has 3 mN m of noise of its own: no fault, but no exact load either."""
    if "load_torque_nm" not in columns:
        return columns
    noise = 0.003 * rng.standard_normal(len(columns["time_s"]))
    return {**columns, "load_torque_nm": columns["load_torque_nm"] + noise}


FAULTS = {
    "gaps": _gaps,
    "clipping": _clipping,
    "slip": _slip,
    "wrong-units": _units,
    "swapped-channel": _swapped,
    "stuck": _stuck,
    "noisy-load-cell": _loud_cell,
}
