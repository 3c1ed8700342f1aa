"""Calibrations for the tests: a published synthetic one, a published torque arm, and drawn ones.

The worked example has four series in three positions, 40 N m, readings to 1 mV.
"""

import csv
import math

import numpy as np
from publicdata import DATA

from hdbench.profile import load_profile
from hdbench.records import LoadReading, Loads

# eight gains at four positions, cw and ccw each, with mean 6.60 and consistency 2.0 %
EIGHT = [[6.43, 6.46], [6.50, 6.56], [6.63, 6.69], [6.75, 6.78]]
FLAT = [gain for pair in EIGHT for gain in pair]
ARM = DATA / "unh_torque_arm_cal"
TORQUES = (0.0, 8.0, 16.0, 24.0, 32.0, 40.0, 32.0, 24.0, 16.0, 8.0, 0.0)
SERIES = {
    "1": (0.0, (0.013, 1.220, 2.432, 3.643, 4.857, 6.073, 4.876, 3.671, 2.460, 1.241, 0.016)),
    "2": (0.0, (0.014, 1.227, 2.436, 3.651, 4.864, 6.079, 4.882, 3.678, 2.464, 1.247, 0.018)),
    "3": (120.0, (0.011, 1.208, 2.407, 3.607, 4.812, 6.015, 4.830, 3.634, 2.436, 1.228, 0.015)),
    "4": (240.0, (0.011, 1.231, 2.447, 3.668, 4.889, 6.114, 4.907, 3.695, 2.475, 1.252, 0.015)),
}


def worked_loads(direction: str = "cw") -> Loads:
    """Return the readings; the reading at 40 N m ends loading and begins unloading."""
    sign = 1.0 if direction == "cw" else -1.0
    readings = []
    for name, (degrees, volts) in SERIES.items():
        given = (name, math.radians(degrees), "full", direction)
        for branch, part in (("up", slice(0, 6)), ("down", slice(5, 11))):
            readings += [
                LoadReading(*given, branch, sign * torque, sign * reading)
                for torque, reading in zip(TORQUES[part], volts[part], strict=True)
            ]
    return Loads(tuple(readings))


def torque_arm(*series: str) -> Loads:
    """Return the published readings of a torque arm."""
    readings = []
    for direction in series:
        with (ARM / f"torque_arm_{direction}.csv").open(newline="") as file:
            for row in csv.DictReader(file):
                volts, torque = float(row["mean_volts_per_volt"]), float(row["mean_torque"])
                branch = "up" if direction == "ascending" else "down"
                readings.append(LoadReading("arm", 0.0, "full", "cw", branch, torque, volts))
    return Loads(tuple(readings), source="torque_arm")


def masses(positions: int = 4, **more: object) -> Loads:
    """Return loads by mass on the arm of the built-in profile, gains 1 % apart."""
    arm = load_profile("cim-tr-97-06").data.arm
    rng = np.random.default_rng(6)
    rows = []
    for place in range(positions):
        gain = 6.6 * (1.0 + 0.01 * rng.normal())
        for way, sign in (("cw", 1.0), ("ccw", -1.0)):
            for series, order in (("up", (0, 2, 4, 6, 8)), ("down", (8, 6, 4, 2, 0))):
                for kilograms in order:
                    torque = sign * kilograms * arm.gravity_m_s2 * arm.length_m
                    rows.append(
                        LoadReading(
                            f"{place}{way}", place * 1.5, "full", way, series, torque,
                            torque / gain + 1e-4 * rng.normal(), mass_kg=float(kilograms),
                            time_s=60.0 * len(rows), **more,
                        )
                    )  # fmt: skip
    return Loads(tuple(rows))


STEPS = (0.0, 10.0, 20.0, 30.0, 40.0)


def experiment(
    name, gain, *, position=0.0, way="cw", steps=STEPS, noise=None, noise_v=0.001, loop=0.0
):
    """Return the readings of one experiment, the loop in N m at half load."""
    sign = 1.0 if way == "cw" else -1.0
    out = []
    for branch, torques in (("up", steps), ("down", steps[::-1])):
        for torque in torques:
            share = torque / max(steps)
            lag = 4.0 * loop * share * (1.0 - share) if branch == "down" else 0.0
            volts = sign * (torque + lag) / gain + 0.01
            volts += 0.0 if noise is None else noise_v * noise.normal()
            out.append(LoadReading(name, position, "full", way, branch, sign * torque, volts))
    return out


def calibration(gains=(6.5, 6.6, 6.7, 6.65), **more):
    """Return the readings of one experiment of each direction at each position."""
    return [
        reading
        for place, gain in enumerate(gains)
        for way in ("cw", "ccw")
        for reading in experiment(f"{place}-{way}", gain, position=1.5 * place, way=way, **more)
    ]
