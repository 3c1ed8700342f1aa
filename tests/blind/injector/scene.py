"""A bench as it happens to be on the day: ripple, misalignment, zero, noise, converter."""

from dataclasses import dataclass

import numpy as np

from .noise import Noise
from .path import RATIO, STIFFNESS, Path, travel
from .records import pieces_of

__all__ = ["LOAD_INERTIA", "Bench", "Scene", "draw_scene"]

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


@dataclass(frozen=True)
class Scene:
    """Path, bench and noise of one record."""

    path: Path
    bench: Bench
    noise: Noise
    bits: int
    clean: np.ndarray

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

    def fine_clean(self):
        """Torque of the sound bench at the fine grid, N m."""
        path = self.path
        twist = path.fine_load / STIFFNESS if path.second_encoder else 0.0
        output = path.fine_angle / RATIO - twist
        return self.bench.torque(path.fine_angle, output, path.fine_accel, path.fine_load)


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
