"""A calibration bench of its own for the tests: weights on an arm, effects by ODE and geometry.

Nothing of the product is used but the record of a reading, so that what hides an effect shares
nothing with what finds it.
"""

from dataclasses import dataclass

import numpy as np

from hdbench.records import LoadReading, Loads

GAIN = 6.6
ARM_M = 0.5
GRAVITY = 9.8065
# the weight hangs this long before a reading
WAIT_S = 20.0


@dataclass(frozen=True)
class Plan:
    """One reading after another: where, which way, how much and when."""

    experiment: np.ndarray
    position: np.ndarray
    direction: np.ndarray
    falling: np.ndarray
    full: np.ndarray
    torque: np.ndarray
    time: np.ndarray


def plan(rng, *, positions=4, directions=2, ranges=1, levels=5, interval_s=40.0):
    """Return a plan with masses, offset angle and pace drawn anew."""
    top = rng.uniform(6.0, 9.0) * GRAVITY * ARM_M
    start = rng.uniform(0.0, 2.0 * np.pi)
    rows = []
    clock = 0.0
    number = 0
    for place in range(positions):
        for way in (1.0, -1.0)[:directions]:
            for share in (1.0, 0.25)[:ranges]:
                up = np.linspace(0.0, top * share, levels)
                series = [(x, False) for x in up] + [(x, True) for x in up[-2::-1]]
                for torque, falling in series:
                    angle = (start + 2.0 * np.pi * place / positions) % (2.0 * np.pi)
                    rows.append((number, angle, way, falling, share == 1.0, way * torque, clock))
                    clock += interval_s * rng.uniform(0.9, 1.1)
                number += 1
                clock += 3.0 * interval_s
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return Plan(*columns)


def by_experiment(p, per_series):
    """Return `per_series(torque, time)` of each experiment on its own."""
    out = np.zeros(len(p.torque))
    for number in np.unique(p.experiment):
        mine = p.experiment == number
        out[mine] = per_series(p.torque[mine], p.time[mine])
    return out


def bouc_wen(p, *, rate, preloads):
    """Bouc-Wen: z' = x' (1 - |z| (b sgn(x' z) + c)), integrated in small steps of the torque."""

    def run(torque, _time):
        far = torque[np.argmax(np.abs(torque))]
        stops = [torque[0], *([far, torque[0]] * preloads), *torque]
        z, seen = 0.0, []
        for before, after in zip(stops[:1] + stops[:-1], stops, strict=True):
            steps = 400
            dx = (after - before) / steps
            for _ in range(steps if dx else 0):
                z += dx * rate * (1.0 - abs(z) * (0.7 * np.sign(dx * z) + 0.3))
            seen.append(z)
        return np.array(seen[-len(torque) :])

    return by_experiment(p, run)


def kelvin_voigt(p, *, constant_s):
    """One viscoelastic element: x' = (tau - x) / T by Runge-Kutta, loads changed in one second."""

    def run(torque, time):
        x, seen, load = 0.0, [], torque[0]
        clock = time[0] - WAIT_S
        for target, moment in zip(torque, time, strict=True):
            change = moment - WAIT_S

            def push(t, x, load=load, change=change, target=target):
                tau = load + (target - load) * np.clip(t - change, 0.0, 1.0)
                return (tau - x) / constant_s

            while clock < moment - 1e-9:
                h = min(0.5, moment - clock)
                k1 = push(clock, x)
                k2 = push(clock + h / 2, x + h * k1 / 2)
                k3 = push(clock + h / 2, x + h * k2 / 2)
                k4 = push(clock + h, x + h * k3)
                x += h * (k1 + 2 * k2 + 2 * k3 + k4) / 6.0
                clock += h
            load = target
            seen.append(x)
        return np.array(seen)

    return by_experiment(p, run)


def sagging_arm(p, *, stiffness, below_m):
    """True torque less the nominal one: the arm tilts by F L / k, the weight hangs off its line."""
    force = np.abs(p.torque) / ARM_M
    tilt = force * ARM_M / stiffness
    for _ in range(30):
        tilt = force * (ARM_M * np.cos(tilt) - below_m * np.sin(tilt)) / stiffness
    true = force * (ARM_M * np.cos(tilt) - below_m * np.sin(tilt))
    return p.direction * (true - force * ARM_M)


def drawn_effect(name, p, rng):
    """Return the effect of unit size that `name` has on a plan, shapes drawn."""
    top = float(np.abs(p.torque).max())
    span = float(np.ptp(p.time))
    length = float(np.median([np.ptp(p.time[p.experiment == e]) for e in np.unique(p.experiment)]))
    if name == "hysteresis":
        return bouc_wen(p, rate=rng.uniform(1.5, 6.0) / top, preloads=int(rng.integers(0, 3)))
    if name == "cubic-nonlinearity":
        return (p.torque / top) ** 3
    if name == "creep":
        return kelvin_voigt(p, constant_s=rng.uniform(60.0, 400.0))
    if name == "arm-sag":
        return sagging_arm(p, stiffness=rng.uniform(800.0, 2000.0), below_m=rng.uniform(0.02, 0.06))
    if name == "position-dependent-gain":
        order = int(rng.integers(1, 3)) if len(np.unique(p.position)) > 2 else 1
        return p.torque * np.cos(order * p.position + rng.uniform(0.0, 2.0 * np.pi))
    if name == "direction-asymmetry":
        return np.where(p.direction > 0.0, p.torque, 0.0)
    if name == "side-force":
        return np.abs(p.torque) / ARM_M
    if name == "zero-drift":
        return p.time / span
    if name == "warm-up":
        return -np.exp(-p.time / (length * rng.uniform(0.3, 1.0)))
    if name == "zero-step":
        number = rng.choice(np.unique(p.experiment))
        inside = p.time[p.experiment == number]
        at = rng.integers(2, len(inside) - 2)
        return np.where(p.time >= inside[at], 1.0, 0.0)
    raise ValueError(name)


def left_by_baseline(p, effect):
    """Return what one gain and the zeros leave of an effect."""
    zeros = (p.experiment[:, None] == np.unique(p.experiment)[None, :]).astype(float)
    base = np.column_stack([p.torque, zeros])
    return effect - base @ np.linalg.lstsq(base, effect, rcond=None)[0]


def scaled(p, effect, sigmas, noise_nm):
    """Return the effect at so many standard deviations of its own best estimate."""
    left = left_by_baseline(p, effect)
    return effect * sigmas * noise_nm / float(np.sqrt(left @ left))


def limited(p, limit):
    """Amplifier with a hard stop behind a soft start: what is lost of the torque."""
    size = np.abs(p.torque) / limit
    return np.sign(p.torque) * limit * np.minimum(size - 0.1 * size**5, 0.9) - p.torque


def loose(p, half):
    """Torque lost in a play of `half`, rounded at its end over a tenth of it."""
    x = np.abs(p.torque)
    soft = half * (1.0 - np.exp(-((x / half) ** 4))) ** 0.25
    return -np.sign(p.torque) * soft


def sized(name, p, sigmas, noise_nm, rng):
    """Return the effect `name` at so many standard deviations, shapes drawn.

    A limit takes all that is above it and a play all that is within: their one size is bisected.
    """
    if name not in ("saturation", "backlash"):
        return scaled(p, drawn_effect(name, p, rng), sigmas, noise_nm)
    top = float(np.abs(p.torque).max())
    weak, strong = (30.0 * top, 0.8 * top) if name == "saturation" else (1e-6 * top, 0.2 * top)
    act = limited if name == "saturation" else loose
    for _ in range(60):
        middle = float(np.sqrt(weak * strong))
        effect = act(p, middle)
        left = left_by_baseline(p, effect)
        if float(np.sqrt(left @ left)) < sigmas * noise_nm:
            weak = middle
        else:
            strong = middle
    return effect


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
            direction="cw" if p.direction[i] > 0.0 else "ccw",
            series="down" if p.falling[i] else "up",
            torque_nm=float(p.torque[i]),
            reading_v=float(shown[i]) / GAIN,
            time_s=float(p.time[i]) if timed else None,
        )
        for i in range(len(shown))
    ]
    return Loads(tuple(rows))
