"""Records of a shaft whose speed swings about a mean, in closed form: ripple, inertia and noise."""

import numpy as np
from scipy.signal import lfilter

from hdbench.records import Trace

NOISE_NM = 0.05
COUNT = 2.0 * np.pi / 4000
# of the load at the motor, N m s^2
INERTIA = 1.725e-4
RIPPLE = ((2.0, 0.4, 0.0), (4.0, 0.2, 0.0))
# ripple and misalignment of the bench
BENCH = ((2.0, 0.4, 0.6), (4.0, 0.2, -1.1), (0.01, 0.9, 0.3))


def swing(time, mean=90.0, size=40.0, period_s=9.0, ripple=RIPPLE):
    """Return speed, angle and torque; ripple is order, amplitude and phase of each line."""
    rate = 2.0 * np.pi / period_s
    speed = mean + size * np.sin(rate * time)
    angle = mean * time + size / rate * (1.0 - np.cos(rate * time))
    torque = INERTIA * size * rate * np.cos(rate * time)
    for order, amplitude, phase in ripple:
        torque = torque + amplitude * np.cos(order * angle + phase)
    return speed, angle, torque


def counted(angle, counts=4000):
    """Return an angle as an encoder reads it."""
    step = 2.0 * np.pi / counts
    return np.floor(angle / step) * step


def trace_of(time, speed, angle, torque, **more):
    """Return the trace of these columns."""
    columns = {"time_s": time, "motor_velocity_rad_s": speed, "motor_angle_rad": angle}
    return Trace({**columns, **more, "torque_nm": torque})


def record(
    extra=lambda time, angle, speed: 0.0,
    motion=(90.0, 40.0, 9.0),
    ripple=BENCH,
    *,
    n=10_000,
    period_s=1e-3,
    noise_nm=NOISE_NM,
    pole=0.0,
    seed=0,
):
    """Return a record of a speed that swings: mean, size and period of the swing."""
    time = np.arange(n) * period_s
    speed, angle, torque = swing(time, *motion, ripple)
    white = np.sqrt(1.0 - pole**2) * np.random.default_rng(seed).standard_normal(n + 200)
    torque += noise_nm * lfilter([1.0], [1.0, -pole], white)[200:] + extra(time, angle, speed)
    return trace_of(time, speed, angle, torque)


def read_by_encoder(n=10_000, seed=0, lost=(), extra=lambda t, a, w: 0.0, tacho=0.0, rough=0.0):
    """Return the columns of an encoder, a noisy tacho and a torque.

    `lost`: (first sample, how many) that no stamp tells of.
    """
    rng = np.random.default_rng(seed)
    total = n + sum(count for _, count in lost)
    time = np.arange(total) * 1e-3
    speed, angle, torque = swing(time, ripple=((2.0, 0.4, 0.6), (4.0, 0.2, -1.1), (0.01, 0.5, 0.3)))
    torque = torque + extra(time, angle, speed)
    torque += NOISE_NM * np.sqrt(1.0 + (rough * speed) ** 2) * rng.standard_normal(total)
    read = speed * (1.0 + tacho * np.cos(22 * angle + 0.5)) + 0.056 * rng.standard_normal(total)
    kept = np.ones(total, dtype=bool)
    for first, count in lost:
        kept[first : first + count] = False
    return {
        "time_s": np.arange(n) * 1e-3,
        "torque_nm": torque[kept],
        "motor_velocity_rad_s": read[kept],
        "encoder_count": np.floor(angle[kept] / COUNT),
    }


def slipped(columns, *slips):
    """Return columns whose encoder slips: (first sample, counts) of each."""
    moved = columns["encoder_count"].copy()
    for first, counts in slips:
        moved[first:] += counts
    return {**columns, "encoder_count": moved}


def reversing(
    extra=lambda angle, speed, load: 0.0,
    seed=1,
    noise_nm=NOISE_NM,
    channel=lambda torque: torque,
    n=16_000,
):
    """Return a record at 1 kHz of a speed that reverses under a load of both signs.

    `channel` is what the torque goes through before its noise.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(n) * 1e-3
    speed, angle, torque = swing(time, 0.0, 60.0, 4.0)
    load = 20.0 * np.sin(2.0 * np.pi * time / 9.7)
    torque = channel(torque + load + extra(angle, speed, load)) + noise_nm * rng.standard_normal(n)
    return trace_of(time, speed, angle, torque, load_torque_nm=load)


def is_behind_the_filter(pictures):
    """Whether the extended model stands behind the filter of the torque as what was measured does.

    What is left between them is then the residual, but for what fades at both ends.
    """
    inside = slice(500, -500)
    left = (pictures.measured_nm - pictures.extended_nm)[inside]
    after = pictures.residual_after_nm[inside]
    return np.sqrt(np.nanmean(left**2)) < 1.2 * np.sqrt(np.nanmean(after**2))
