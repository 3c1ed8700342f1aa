"""Channels of a record: what the instruments make of motion and torque."""

import numpy as np

__all__ = ["channels_of", "convert", "drop", "optional"]

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
