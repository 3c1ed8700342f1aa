"""Traces written from closed forms, with a truth that the tests know."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from hdbench.profile import ProfileData, load_profile
from hdbench.records import Quantity, TorqueScale, Trace

DT = 0.001


def bench(**drive: float) -> ProfileData:
    """Return the report's bench with keys of its drive replaced."""
    data = load_profile("cim-tr-97-06").data
    return data.model_copy(update={"drive": data.drive.model_copy(update=drive)})


@dataclass(frozen=True)
class Truth:
    """Amplitudes in N m and phases in rad."""

    order_2: tuple[float, float] = (0.4, 0.6)
    order_4: tuple[float, float] = (0.2, -1.1)
    misalignment: tuple[float, float] = (0.9, 0.3)


def scale(relative_std: float = 0.0, dof: float | None = None) -> TorqueScale:
    return TorqueScale(Quantity(6.6, 6.6 * relative_std, dof), "calibration run 1")


def covers(quantity: Quantity, truth: float, confidence: float = 0.999) -> bool:
    low, high = quantity.interval(confidence)
    return low <= truth <= high


def reversing_velocity(duration_s: float = 12.0, top_rad_s: float = 156.0) -> np.ndarray:
    """Return a trapezoid of 6 s period in both directions, with rounded corners."""
    phase = (np.arange(round(duration_s / DT)) * DT / 6.0) % 1.0
    half = (phase % 0.5) / 0.5
    shape = np.clip(np.minimum(half, 1.0 - half) / 0.1, 0.0, 1.0)
    return gaussian_filter1d(np.where(phase < 0.5, shape, -shape) * top_rad_s, 15.0)


def both_ways_velocity(turns: float = 2.0, speed_rad_s: float = 60.0) -> np.ndarray:
    """Return constant speed over `turns` output turns of the 100:1 drive, forth and back."""
    n = round((turns * 2.0 * np.pi * 100.0 / speed_rad_s + 0.6) / DT)
    legs = [np.full(n, speed_rad_s), np.zeros(300), np.full(n, -speed_rad_s), np.zeros(300)]
    return gaussian_filter1d(np.concatenate(legs), 20.0)


def known_trace(
    rng: np.random.Generator,
    velocity: np.ndarray,
    *,
    truth: Truth | None = None,
    colour: float = 0.0,
    extra_nm: np.ndarray | float = 0.0,
    encoder: bool = True,
) -> Trace:
    """Return a trace of the bench's model: torque in volts at 6.6 N m/V, tacho, angle."""
    known = truth or Truth()
    time = np.arange(len(velocity)) * DT
    angle = np.concatenate([[0.0], np.cumsum(velocity[:-1] * DT)])
    noise = 0.05 * np.sqrt(1.0 - colour**2) * rng.normal(size=len(time) + 300)
    torque = (
        known.order_2[0] * np.cos(2.0 * angle + known.order_2[1])
        + known.order_4[0] * np.cos(4.0 * angle + known.order_4[1])
        + known.misalignment[0] * np.cos(angle / 100.0 + known.misalignment[1])
        + 1.725e-2 / 100.0 * np.gradient(velocity, DT)
        + lfilter([1.0], [1.0, -colour], noise)[300:]
        + extra_nm
    )
    step = 20.0 / 65536.0
    tacho = velocity / 56.2565 + 0.001 * rng.normal(size=len(time))
    columns = {
        "time_s": time,
        "torque_v": np.round(torque / 6.6 / step) * step,
        "motor_velocity_rad_s": tacho * 56.2565,
    }
    if encoder:
        columns["motor_angle_rad"] = np.round(angle / (2.0 * np.pi) * 4000.0) * 2.0 * np.pi / 4000.0
    return Trace(columns, "known")


def drawn_runs(velocity: np.ndarray, n_runs: int) -> Iterator[tuple[float, TorqueScale, Trace]]:
    """Yield true gains, what a calibration of 1 % and 3 dof says of them, and traces of a motion.

    The torque is what the true gain makes of the volts; noise is white and coloured in turn.
    """
    for seed in range(n_runs):
        rng = np.random.default_rng(100 + seed)
        true_gain = 6.6 * (1.0 + 0.01 * rng.normal())
        found = scale(0.01 * float(np.sqrt(rng.chisquare(3) / 3.0)), 3.0)
        yield true_gain, found, known_trace(rng, velocity, colour=0.9 * (seed % 2))
