"""A bench as it happens to be on the day: noise, ripple, misalignment, zero, and its channels."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from .family import effect, waves
from .motion import RATIO, Path, pieces_of, travel

# zeros and poles of the noise at 1 kHz; the last rises like 1/f between 0.3 Hz and 100 Hz
KINDS = {
    "white": ((), ()),
    "ar": ((), (0.9,)),
    "flicker": ((0.9937, 0.937, 0.45), (0.998, 0.98, 0.82)),
}
_RUN_IN = 8000


@dataclass(frozen=True)
class Noise:
    """Noise of standard deviation `sigma_nm`, N m, and spectrum `kind`."""

    kind: str
    sigma_nm: float

    def _law(self):
        zeros, poles = KINDS[self.kind]
        over, under = np.poly(zeros), np.poly(poles)
        kick = np.zeros(_RUN_IN)
        kick[0] = 1.0
        answer = lfilter(over, under, kick)
        return over, under, self.sigma_nm / float(np.sqrt(answer @ answer))

    def draw(self, count, rng):
        """Draw `count` samples, N m, already settled."""
        over, under, scale = self._law()
        white = rng.standard_normal(count + _RUN_IN)
        return scale * lfilter(over, under, white)[_RUN_IN:]

    def whiten(self, columns):
        """Return `columns` (n,) or (n, k), N m, with unit white noise."""
        over, under, scale = self._law()
        if self.kind == "white":
            return columns / scale
        return lfilter(under, over, columns, axis=0) / scale


LOAD_INERTIA = 1.725e-2


@dataclass(frozen=True)
class Bench:
    """Numbers of this bench: amplitudes, N m, and phases, rad."""

    ripple: tuple
    misalignment: tuple
    zero_nm: float
    inertia: float

    def torque(self, angle, output, accel, load):
        """Torque of a sound bench, N m."""
        out = self.inertia / RATIO * accel + load + self.zero_nm
        for order, amplitude, phase in self.ripple:
            out += amplitude * np.sin(order * angle + phase)
        amplitude, phase = self.misalignment
        return out + amplitude * np.sin(output + phase)


def baseline(angle, output):
    """Zero, orders 2 and 4, and output order 1 where the output turns."""
    columns = [np.ones((len(angle), 1)), waves(2.0 * angle), waves(4.0 * angle)]
    if np.ptp(output) >= 2.0 * np.pi:
        columns.append(waves(output))
    return np.column_stack(columns)


@dataclass(frozen=True)
class Scene:
    """Path, bench and noise of one record.

    `acting` are effects, (family, shape, size), that stand in the torque when it enters a stage of
    the channel.
    """

    path: Path
    bench: Bench
    noise: Noise
    bits: int
    clean: np.ndarray
    acting: tuple = ()

    def baseline(self):
        """Columns that any diagnosis fits first."""
        return baseline(self.path.angle, self.path.output)

    @property
    def tau(self):
        """Torque through the flexspline, N m."""
        return self.path.load + self.bench.inertia / RATIO * self.path.accel

    @property
    def current(self):
        """Motor current, A: rotor, motor friction, reflected torque; 0.05 N m/A."""
        path = self.path
        drag = 0.012 * np.tanh(path.speed / 1.5) + 1.2e-5 * path.speed
        return (9e-5 * path.accel + drag + self.tau / (RATIO * 0.8)) / 0.05

    @property
    def signal(self):
        """Torque that enters a stage of the channel: the sound bench and what acts, N m."""
        out = self.clean
        for family, shape, size in self.acting:
            out = out + effect(family, self.before(family, self.acting), shape, size)
        return out

    def before(self, family, entries):
        """The scene at the stage of `family`, where those of `entries` act that come before it."""
        return replace(self, acting=tuple(e for e in entries if e[0].stage < family.stage))

    def earlier(self, delay):
        """The scene as it was `delay` seconds ago at every sample."""
        path = self.path.earlier(delay)
        clean = self.bench.torque(path.angle, path.output, path.accel, path.load)
        return replace(self, path=path, clean=clean)


def draw_scene(record, noise, bits, rng, pieces=None, second_encoder=False):
    """Draw bench and motion of `record`; `pieces` replaces the record's own."""
    path = travel(pieces or pieces_of(record, rng), rng, second_encoder)
    ripple = tuple(
        (order, size * rng.uniform(0.7, 1.3), rng.uniform(-np.pi, np.pi))
        for order, size in ((2.0, 0.4), (4.0, 0.2))
    )
    # on less than a turn of the output no baseline has it: such a bench has none
    whole = np.ptp(path.angle) / RATIO >= 2.0 * np.pi
    misalignment = (0.9 * whole * rng.uniform(0.7, 1.3), rng.uniform(-np.pi, np.pi))
    # the inertia's tolerance stays below what any of the records can show
    inertia = LOAD_INERTIA * (1.0 + rng.uniform(-3e-4, 3e-4))
    bench = Bench(ripple, misalignment, rng.uniform(-0.3, 0.3), inertia)
    clean = bench.torque(path.angle, path.output, path.accel, path.load)
    return Scene(path, bench, noise, bits, clean)


_NM_PER_VOLT = 6.6
_SPEED_PER_VOLT = 56.2565
_COUNTS = 4000


def channels_of(scene, rng):
    path = scene.path
    noise = scene.noise.draw(len(path.time), rng)
    return {
        "torque": scene.clean + noise,
        "noise": noise,
        "tacho": path.speed + 0.05 * rng.standard_normal(len(path.time)),
        "angle": path.angle.copy(),
    }


def optional(scene, rng, always_current):
    """Channels that this bench happens to have."""
    path, count = scene.path, len(scene.path.time)
    out = {}
    if path.loaded:
        # known weights, and a brake whose cell is far quieter than the sensor: what noise it has
        # stands in the difference of the two channels and in every curve over the load
        out["load_torque_nm"] = np.round(path.load, 4)
    if always_current or rng.random() < 0.5:
        out["motor_current_a"] = scene.current + 0.005 * rng.standard_normal(count)
    if rng.random() < 0.3:
        warmth = rng.uniform(0.2, 1.0) * (1.0 - np.exp(-path.time / 300.0))
        out["temperature_c"] = np.round(22.0 + warmth + 0.02 * rng.standard_normal(count), 2)
    if path.second_encoder:
        step = 2.0 * np.pi / 2**18
        out["output_angle_rad"] = np.floor(path.output / step) * step
    return out


def convert(scene, channels, fine):
    """Volts behind the converter, counts behind the counter."""
    step = 20.0 / 2**scene.bits
    coarse = channels.get("step_nm", 0.0) / _NM_PER_VOLT
    volts = channels["torque"] / _NM_PER_VOLT
    volts = np.round(volts / max(step, coarse)) * max(step, coarse)
    tacho = np.round(channels["tacho"] / _SPEED_PER_VOLT / step) * step
    out = {
        "time_s": np.round(scene.path.time, 6),
        "torque_v": np.clip(volts, -10.0, 10.0 - step),
        "tacho_v": np.clip(tacho, -10.0, 10.0 - step),
    }
    if fine:
        width = 2.0 * np.pi / 2**16
        out["motor_angle_rad"] = np.floor(channels["angle"] / width) * width
    else:
        out["encoder_count"] = np.floor(channels["angle"] * _COUNTS / (2.0 * np.pi))
    return out


def drop(columns, first, last):
    keep = np.r_[0:first, last : len(columns["time_s"])]
    out = {name: values[keep] for name, values in columns.items()}
    out["time_s"] = columns["time_s"][: len(keep)]
    return out
