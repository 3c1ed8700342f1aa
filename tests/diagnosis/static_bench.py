"""A calibration bench of its own for the tests: weights on an arm, effects of the blind benchmark.

Nothing of the product is used but the record of a reading, so that what hides an effect shares
nothing with what finds it.
"""

from itertools import product

import numpy as np
from injector.build import reach
from injector.family import effect
from injector.loads import STATIC, Loading

from hdbench.records import LoadReading, Loads

GAIN = 6.6
ARM_M = 0.5
GRAVITY = 9.8065
FAMILIES = {family.name: family for family in STATIC}


def plan(rng, *, positions=4, directions=2, ranges=1, levels=5, interval_s=40.0):
    """Return a plan with masses, offset angle and pace drawn anew."""
    top = rng.uniform(6.0, 9.0)
    start = rng.uniform(0.0, 2.0 * np.pi)
    rows, clock = [], 0.0
    kinds = product(range(positions), (True, False)[:directions], (1.0, 0.25)[:ranges])
    for number, (place, cw, share) in enumerate(kinds):
        angle = (start + 2.0 * np.pi * place / positions) % (2.0 * np.pi)
        masses = np.linspace(0.0, top * share, levels)
        for k, mass in enumerate([*masses, *masses[-2::-1]]):
            rows.append((number, angle, share == 1.0, cw, k < levels, mass, clock))
            clock += interval_s * rng.uniform(0.9, 1.1)
        clock += 3.0 * interval_s
    return Loading(*(np.array(column) for column in zip(*rows, strict=True)))


def effect_of(name, p, rng):
    """Return the torque of an effect by its size, shapes drawn, and a size to begin with."""
    if name in FAMILIES:
        family = FAMILIES[name]
        shape = family.draw(rng, p)
        return lambda size: effect(family, p, shape, size), family.physical[1]
    if name == "side-force":
        unit = np.abs(p.torque) / ARM_M
    elif name == "warm-up":
        lengths = [np.ptp(p.time[p.experiment == e]) for e in np.unique(p.experiment)]
        unit = -np.exp(-p.time / (float(np.median(lengths)) * rng.uniform(0.3, 1.0)))
    else:
        assert name == "zero-step"
        inside = p.time[p.experiment == rng.choice(np.unique(p.experiment))]
        unit = (p.time >= inside[rng.integers(2, len(inside) - 2)]).astype(float)
    return lambda size: size * unit, 0.1


def sized(name, p, sigmas, noise_nm, rng):
    """Return the effect at so many standard deviations of its own best estimate, shapes drawn."""
    torque, start = effect_of(name, p, rng)
    base = p.baseline()

    def measure(size):
        effect = torque(size)
        # what one gain and the zeros leave of it
        left = effect - base @ np.linalg.lstsq(base, effect, rcond=None)[0]
        return float(np.linalg.norm(left)) / noise_nm

    return torque(reach(measure, start, sigmas)) if sigmas else np.zeros(len(p.time))


def readings(p, effect, noise_nm, rng, *, timed=True, clamping=0.0):
    """Return the loads file of a plan with an effect."""
    count = int(p.experiment.max()) + 1
    zeros = rng.normal(0.0, 0.3, count)[p.experiment]
    gains = 1.0 + clamping * rng.standard_normal(count)[p.experiment]
    shown = p.torque * gains + zeros + effect + noise_nm * rng.standard_normal(len(p.torque))
    rows = [
        LoadReading(
            experiment=f"e{p.experiment[i]}",
            position_rad=float(p.position[i]),
            range="full" if p.full[i] else "low",
            direction="cw" if p.cw[i] else "ccw",
            series="up" if p.up[i] else "down",
            torque_nm=float(p.torque[i]),
            reading_v=float(shown[i]) / GAIN,
            time_s=float(p.time[i]) if timed else None,
        )
        for i in range(len(shown))
    ]
    return Loads(tuple(rows))
