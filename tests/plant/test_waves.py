"""Plant `as-modelled`: under every reference wave the torque channel holds the model alone."""

import math

import numpy as np
import pytest
from plant_tools import AS_MODELLED, NM_PER_CODE, constant, quiet_profile, run

from hdbench.plant.bench import SimulatedBench
from hdbench.profile.schema import ReferenceWave
from hdbench.profile.waves import reference_voltage

QUIET = quiet_profile()
PERIOD_S, N_SAMPLES, SUBSTEPS = 1e-3, 1200, 20
RATE_PER_S, LIMIT_RAD_S2 = 2.0 * math.pi * 15.0, 2500.0
WAVES = {
    "constant": constant(2.0),
    "sine": ReferenceWave(wave="sine", amplitude_v=2.0, frequency_hz=1.0),
    "square": ReferenceWave(wave="square", amplitude_v=1.0, frequency_hz=2.0),
    "triangle": ReferenceWave(wave="triangle", amplitude_v=2.0, frequency_hz=1.0),
    "trapezoid": ReferenceWave(
        wave="trapezoid", amplitude_v=2.773, frequency_hz=1.0, duty=0.6, rise=0.2, fall=0.2
    ),
    "chirp": ReferenceWave(wave="chirp", amplitude_v=1.0, frequency_hz=0.5, end_frequency_hz=4.0),
}


def _acceleration(command: float, speed: float) -> float:
    return max(-LIMIT_RAD_S2, min(LIMIT_RAD_S2, RATE_PER_S * (command - speed)))


def _integrated(command_rad_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return acceleration, its jump and the angle at the samples, by the midpoint rule.

    Where the held command jumps, the acceleration is the mean of before and after: what a filter
    of linear phase makes of it.
    """
    step = PERIOD_S / SUBSTEPS
    speed = angle = before = 0.0
    rows = []
    for command in command_rad_s.tolist():
        early, late = _acceleration(before, speed), _acceleration(command, speed)
        rows.append((0.5 * (early + late), late - early, angle))
        for _ in range(SUBSTEPS):
            middle = speed + 0.5 * step * _acceleration(command, speed)
            angle += step * middle
            speed += step * _acceleration(command, middle)
        before = command
    acceleration, jump, angles = np.array(rows).T
    return acceleration, jump, angles


@pytest.mark.parametrize("name", WAVES)
def test_torque_is_the_model_alone_under_every_wave(name):
    bench = SimulatedBench(QUIET, AS_MODELLED, 1)
    torque = run(bench, WAVES[name], N_SAMPLES).torque_code * NM_PER_CODE
    times_s = np.arange(N_SAMPLES) * PERIOD_S
    volts = reference_voltage(WAVES[name], times_s, N_SAMPLES * PERIOD_S)
    acceleration, jump, angle = _integrated(56.2565 * volts)
    expected = (
        1.725e-2 / 100.0 * acceleration
        + 0.9 * np.cos(angle / 100.0 + 0.3)
        + 0.4 * np.cos(2.0 * angle + 0.6)
        + 0.2 * np.cos(4.0 * angle - 1.1)
    )
    # the anti-alias filter rings for 8 samples to either side of a step or a corner of the
    # reference; elsewhere the held reference steps evenly, at a rate that the filter takes out;
    # the last samples see the end of the wave
    settled = np.ones(N_SAMPLES, dtype=bool)
    for at in np.flatnonzero(np.abs(np.diff(jump, prepend=0.0)) > 30.0):
        settled[max(0, at - 9) : at + 10] = False
    settled[-9:] = False
    assert settled.mean() > 0.9
    # half a code; the filter's ripple of 0.1 % on 1.4 N m
    error = np.abs(torque - expected)[settled]
    assert error.max() <= 0.5 * NM_PER_CODE + 1.4e-3
