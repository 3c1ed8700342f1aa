"""Records of a speed that reverses under a load of both signs, with ripple, inertia and noise."""

import numpy as np

from hdbench.records import Trace

NOISE_NM = 0.05


def reversing(
    extra=lambda angle, speed, load: 0.0, seed=1, noise_nm=NOISE_NM, channel=lambda torque: torque
):
    """Return 16 s at 1 kHz; `channel` is what the torque goes through before its noise."""
    n, rng = 16_000, np.random.default_rng(seed)
    time = np.arange(n) * 1e-3
    swing = 2.0 * np.pi / 4.0
    speed, angle = 60.0 * np.sin(swing * time), 60.0 / swing * (1.0 - np.cos(swing * time))
    load = 20.0 * np.sin(2.0 * np.pi * time / 9.7)
    torque = 0.4 * np.cos(2 * angle) + 0.2 * np.cos(4 * angle) + load
    torque += 1.725e-4 * 60.0 * swing * np.cos(swing * time)
    torque = channel(torque + extra(angle, speed, load))
    columns = {
        "time_s": time,
        "motor_velocity_rad_s": speed,
        "motor_angle_rad": angle,
        "load_torque_nm": load,
        "torque_nm": torque + noise_nm * rng.standard_normal(n),
    }
    return Trace(columns)
