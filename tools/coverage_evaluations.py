"""Count how often the 95 % intervals of the evaluations cover a truth drawn outside the product.

Usage: python tools/coverage_evaluations.py [--runs 400] [--first 0] [--workers 1]

Each run draws the gains of four flexspline positions with 2 % between them, loads them in both
directions, and scales a reversing run of 12 s and two output turns both ways by the calibration
that comes out of it; white noise, and noise with a pole at 0.9. The traces are those of the tests.
Prints the share covered, in per cent.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections import Counter
from pathlib import Path

# one core: threads of small matrix products only wait for each other
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "ripple"))

import numpy as np
from known_traces import (
    Truth,
    bench,
    both_ways_velocity,
    known_trace,
    reversing_velocity,
)

from hdbench.batch import Workers, run_tasks
from hdbench.calibration import evaluate_calibration
from hdbench.filter import preset
from hdbench.misalignment import evaluate_misalignment
from hdbench.records import LoadReading, Loads, Quantity, TorqueScale
from hdbench.ripple import evaluate_ripple

# gain of the traces, spread between positions, noise of a reading
_GAIN_NM_PER_V, _BETWEEN_POSITIONS, _READING_V = 6.6, 0.02, 0.001
_BENCH = bench()
_FILTER = preset("report-6", _BENCH)


def drawn_loads(rng: np.random.Generator) -> Loads:
    """Return readings of four positions, both directions, loading and unloading."""
    readings = []
    for position in range(4):
        gain = _GAIN_NM_PER_V * (1.0 + _BETWEEN_POSITIONS * rng.normal())
        for direction, sign in (("cw", 1.0), ("ccw", -1.0)):
            for series, loads in (("up", (0, 10, 20, 30, 40)), ("down", (40, 30, 20, 10, 0))):
                readings += [
                    LoadReading(
                        f"{position}-{direction}",
                        position * math.pi / 2.0,
                        "full",
                        direction,
                        series,
                        sign * load,
                        sign * load / gain + _READING_V * rng.normal(),
                    )
                    for load in loads
                ]
    return Loads(tuple(readings))


def covered(seed: int, colour: float) -> list[str]:
    """Return the names of the quantities whose interval holds the truth, in one run."""
    rng, truth = np.random.default_rng([seed, round(10 * colour)]), Truth()
    gain = evaluate_calibration(drawn_loads(rng), max_consistency=0.05).gain_nm_per_v
    scale = TorqueScale(gain, "calibration drawn")
    moving = known_trace(rng, reversing_velocity(), colour=colour)
    turning = known_trace(rng, both_ways_velocity(), colour=colour)
    two, four = evaluate_ripple(moving, _BENCH, scale=scale, filter_model=_FILTER).ripple
    output = evaluate_misalignment(turning, _BENCH, scale=scale, filter_model=_FILTER)
    pairs: dict[str, tuple[Quantity, float]] = {
        "gain": (gain, _GAIN_NM_PER_V),
        "order 2": (two.amplitude_nm, truth.order_2[0]),
        "order 4": (four.amplitude_nm, truth.order_4[0]),
        "misalignment": (output.amplitude_nm, truth.misalignment[0]),
        "phase 2": (two.phase_rad, truth.order_2[1]),
        "phase 4": (four.phase_rad, truth.order_4[1]),
        "phase misalignment": (output.phase_rad, truth.misalignment[1]),
    }
    found = []
    for name, (quantity, true) in pairs.items():
        low, high = quantity.interval(0.95)
        if low <= true <= high:
            found.append(name)
    return found


def _covered(task: tuple[int, float]) -> list[str]:
    return covered(*task)


def main() -> None:
    """Run the campaign and print a line per noise and quantity."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    arguments = parser.parse_args()
    for label, colour in (("white", 0.0), ("pole at 0.9", 0.9)):
        counts: Counter[str] = Counter()
        seeds = range(arguments.first, arguments.first + arguments.runs)
        tasks = ((seed, colour) for seed in seeds)
        for outcome in run_tasks(_covered, tasks, Workers(arguments.workers)):
            counts.update(outcome.value or ())
        for name, count in counts.items():
            print(f"{label:12} {name:20} {100.0 * count / arguments.runs:5.1f} %", flush=True)


if __name__ == "__main__":
    main()
