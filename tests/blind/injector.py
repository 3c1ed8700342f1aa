"""A bench of its own for blind tests: shares no code with the product, and hides an effect.

Everything is integrated at 10 kHz and then sampled at 1 kHz: a servo that follows a speed command,
wave-generator ripple, a misaligned load, inertia, and at most one hidden effect. The torque passes
a 16-bit converter, the angle a counting encoder, the speed a noisy tacho. Amplitudes and phases
are drawn per seed.
"""

from dataclasses import dataclass

import numpy as np

__all__ = ["MOTIONS", "Injected", "inject"]

MOTIONS = ("reversals", "varying", "constant")
_FINE = 1e-4
_EVERY = 10
_RATIO = 100.0
_LOAD_INERTIA = 1.725e-2
_NM_PER_VOLT = 6.6
_SPEED_PER_VOLT = 56.2565
_COUNTS = 4000
_LSB_VOLT = 20.0 / 65536
_NOISE_NM = 0.05
_TACHO_NOISE_VOLT = 0.001


@dataclass(frozen=True)
class Injected:
    """One record and what was hidden in it."""

    columns: dict
    hidden: str
    place: float
    amplitude_nm: float
    motion: str
    noise: str
    seed: int


def _command(motion, time, rng):
    """Speed command, rad/s, at the fine grid."""
    if motion == "constant":
        return np.full(len(time), rng.uniform(40.0, 150.0))
    if motion == "reversals":
        top, period = rng.uniform(60.0, 156.0), rng.uniform(6.0, 12.0)
        within = np.mod(time / period + rng.uniform(0.0, 0.1), 1.0)
        return np.where(within < 0.5, top, -top)
    centre, swing = rng.uniform(60.0, 100.0), rng.uniform(20.0, 55.0)
    slow = centre + swing * np.sin(2.0 * np.pi * time / rng.uniform(7.0, 15.0))
    return np.where(np.mod(time, 30.0) < 24.0, slow, -slow)


def _servo(command, rng):
    """Speed and acceleration of a current-limited servo behind a first-order lag."""
    rate, limit = 2.0 * np.pi * rng.uniform(8.0, 16.0), 2500.0
    speed = np.empty_like(command)
    drive = np.empty_like(command)
    now = 0.0
    for k, wanted in enumerate(command.tolist()):
        pull = min(max(rate * (wanted - now), -limit), limit)
        speed[k], drive[k] = now, pull
        now += pull * _FINE
    return speed, drive


def _coloured(count, rng, noise):
    """Noise, N m: white, or a slow part that a pole at 0.9 leaves."""
    white = rng.standard_normal(count)
    if noise == "white":
        return _NOISE_NM * white
    out = np.empty(count)
    state = 0.0
    for k, draw in enumerate(white.tolist()):
        state = 0.9 * state + draw
        out[k] = state
    return _NOISE_NM * np.sqrt(1.0 - 0.81) * out


def _hidden(kind, time, angle, speed, rng):
    """Torque of the hidden effect, its place and its amplitude."""
    amplitude = float(np.exp(rng.uniform(np.log(0.02), np.log(0.3))))
    phase = rng.uniform(-np.pi, np.pi)
    if kind == "clean":
        return np.zeros(len(time)), 0.0, 0.0
    if kind == "order":
        place = 2.0
        while min(abs(place - k) for k in (2.0, 4.0)) < 0.2:
            place = float(rng.choice([rng.uniform(0.6, 11.0), rng.integers(3, 11)]))
        return amplitude * np.sin(place * angle + phase), place, amplitude
    if kind == "tone":
        place = float(rng.uniform(5.0, 400.0))
        return amplitude * np.sin(2.0 * np.pi * place * time + phase), place, amplitude
    if kind == "friction":
        width = rng.uniform(0.5, 3.0)
        curve = 2.0 / np.pi * np.arctan(np.pi / 2.0 * speed / width)
        return amplitude * curve, width, amplitude
    raise ValueError(kind)


def inject(seed, hidden="clean", motion="reversals", noise="white", duration_s=30.0):
    """Return one record with `hidden` in it: clean, order, tone or friction."""
    rng = np.random.default_rng([seed, MOTIONS.index(motion)])
    steps = round(duration_s / _FINE)
    time = np.arange(steps) * _FINE
    speed, drive = _servo(_command(motion, time, rng), rng)
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * _FINE)])
    torque = _LOAD_INERTIA / _RATIO * drive + rng.uniform(-0.3, 0.3)
    for order, size in ((2.0, 0.4), (4.0, 0.2)):
        scale = size * rng.uniform(0.7, 1.3)
        torque += scale * np.sin(order * angle + rng.uniform(-np.pi, np.pi))
    torque += 0.9 * rng.uniform(0.7, 1.3) * np.sin(angle / _RATIO + rng.uniform(-np.pi, np.pi))
    effect, place, amplitude = _hidden(hidden, time, angle, speed, rng)
    torque += effect
    pick = slice(0, None, _EVERY)
    count = len(time[pick])
    volts = (torque[pick] + _coloured(count, rng, noise)) / _NM_PER_VOLT
    tacho = speed[pick] / _SPEED_PER_VOLT + _TACHO_NOISE_VOLT * rng.standard_normal(count)
    columns = {
        "time_s": np.round(time[pick], 6),
        "torque_v": np.round(volts / _LSB_VOLT) * _LSB_VOLT,
        "tacho_v": np.round(tacho / _LSB_VOLT) * _LSB_VOLT,
        "encoder_count": np.floor(angle[pick] * _COUNTS / (2.0 * np.pi)),
    }
    return Injected(columns, hidden, place, amplitude, motion, noise, seed)
