"""Write the stored traces: an independent, seeded simulation that shares no code with hdbench.

Run ``python tests/stored/generate.py`` to write the inputs again (same bytes), then
``hdbench regress tests/stored --update`` and look at what it prints before keeping it.

The bench is that of profile ``cim-tr-97-06``: N = 100, J = 1.725e-2 kg m^2, gain 6.6 N m/V,
tacho 56.2565 rad/s/V, 4000 counts per motor turn, 1 kHz, 16 bit over +-10 V. True values of what
the evaluations estimate stand in `TRUTH`.
"""

import gzip
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
RATIO, INERTIA, GAIN, TACHO, COUNTS = 100.0, 1.725e-2, 6.6, 56.2565, 4000
STEP_V = 20.0 / 2**16
TRUTH = {
    "gain_nm_per_v": GAIN,
    "misalignment": {"amplitude_nm": 0.9, "phase_rad": 0.3},
    "ripple": {"2": (0.4, 0.6), "4": (0.2, -1.1)},
}


def loads_csv(seed: int) -> str:
    """Return readings of 4 positions x 2 directions x 2 ranges, loading and unloading."""
    rng = np.random.default_rng(seed)
    head = "experiment,position_rad,range,direction,series,torque_nm"
    lines = [f"{head},reading_v,reading_std_v,n_samples"]
    spread = rng.normal(0.0, 0.015, 4)
    for i, position in enumerate(np.arange(4) * np.pi / 2.0):
        for sign, direction in ((1.0, "cw"), (-1.0, "ccw")):
            for name, masses in (("low", (0, 0.5, 1, 1.5, 2)), ("full", (0, 2, 4, 6, 8))):
                gain = GAIN * (1.0 + spread[i] + rng.normal(0.0, 0.003))
                zero = rng.normal(0.0, 0.01)
                top = max(masses)
                for series, order in (("up", masses), ("down", masses[-2::-1])):
                    for mass in order:
                        torque = sign * mass * 9.8065 * 0.5
                        lag = 0.004 * mass * (top - mass) / top if series == "down" else 0.0
                        volts = (torque + sign * lag) / gain + zero + rng.normal(0.0, 0.0008)
                        volts = round(volts / STEP_V) * STEP_V
                        where = f"p{i}-{direction}-{name},{position:.6f},{name},{direction}"
                        lines.append(f"{where},{series},{torque:.6f},{volts:.6f},0.0076,1000")
    return "\n".join(lines) + "\n"


def motion(velocity: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return angle and acceleration of the wave generator by the trapezoid rule."""
    angle = np.concatenate(([0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * dt)))
    return angle, np.gradient(velocity, dt)


def trace_csv(velocity: np.ndarray, seed: int, dt: float = 1e-3) -> str:
    """Return a trace in volts: inertia, ripple, misalignment, noise, converter, tacho, encoder."""
    rng = np.random.default_rng(seed)
    angle, acceleration = motion(velocity, dt)
    torque = INERTIA / RATIO * acceleration
    for order, (size, phase) in TRUTH["ripple"].items():
        torque = torque + size * np.cos(float(order) * angle + phase)
    size, phase = TRUTH["misalignment"].values()
    torque = torque + size * np.cos(angle / RATIO + phase)
    volts = torque / GAIN + rng.normal(0.0, 0.05 / GAIN, len(torque))
    tacho = velocity / TACHO + rng.normal(0.0, 0.001, len(torque))
    rows = zip(
        np.arange(len(torque)) * dt,
        np.round(tacho / STEP_V) * STEP_V,
        np.floor(angle * COUNTS / (2.0 * np.pi)).astype(int),
        np.round(volts / STEP_V) * STEP_V,
        strict=True,
    )
    lines = ["time_s,tacho_v,encoder_count,torque_v"]
    lines += [f"{t:.3f},{v:.6f},{n},{u:.6f}" for t, v, n, u in rows]
    return "\n".join(lines) + "\n"


def ramps(times: tuple, values: tuple, dt: float = 1e-3, smooth_s: float = 0.02) -> np.ndarray:
    """Return a velocity through points, s and rad/s, its corners rounded by a moving average."""
    grid = np.arange(0.0, times[-1], dt)
    width = int(smooth_s / dt)
    padded = np.pad(np.interp(grid, times, values), width, mode="edge")
    return np.convolve(padded, np.ones(width) / width, mode="same")[width:-width]


def misalignment_velocity() -> np.ndarray:
    """Return 2.15 output turns at 300 rad/s in each direction, with rest between them."""
    times = (0.0, 0.2, 0.6, 5.1, 5.5, 5.7, 6.1, 10.6, 11.0, 11.2)
    return ramps(times, (0, 0, 300, 300, 0, 0, -300, -300, 0, 0))


def ripple_velocity() -> np.ndarray:
    """Return a trapezoid of 156 rad/s, the speed of the report's figure 8, in both directions."""
    times = (0.0, 0.2, 0.5, 2.6, 3.2, 5.5, 5.8, 6.0)
    return ramps(times, (0, 0, 156, 156, -156, -156, 0, 0))


def write_packed(path: Path, text: str) -> None:
    """Write a gzip file whose bytes do not depend on the time."""
    with path.open("wb") as file, gzip.GzipFile("", "wb", 9, file, mtime=0) as packed:
        packed.write(text.encode())


def write_inputs(folder: Path) -> None:
    """Write the input of every case."""
    (folder / "calibration" / "loads.csv").write_text(loads_csv(11))
    write_packed(folder / "misalignment" / "trace.csv.gz", trace_csv(misalignment_velocity(), 12))
    write_packed(folder / "ripple" / "trace.csv.gz", trace_csv(ripple_velocity(), 13))


if __name__ == "__main__":
    write_inputs(HERE)
