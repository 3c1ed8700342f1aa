"""How often the 95 % interval of a calibration's gain covers the truth.

    python tools/calibration_coverage.py [--runs 1000] [--seed 0]

Simulated calibrations: positions and repetitions are random effects, the direction is a fixed one;
the truth is the mean of both directions. Beside the interval of the product stands the naive one,
which takes every experiment as independent. Designs: balanced; one experiment lost; both
directions, two repetitions at the first position. Numbers are drawn here, outside the product.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hdbench.calibration import evaluate_calibration
from hdbench.records import LoadReading, Loads

GAIN = 6.6
# relative sizes: between positions, within a position, half the difference of the directions
POSITION, REPEAT, DIRECTION = 0.02, 0.004, 0.0035
TORQUES = (0.0, 10.0, 20.0, 30.0, 40.0)
DESIGNS = ("balanced", "one lost", "repeated at one position")


@dataclass(frozen=True, slots=True)
class Count:
    """Intervals that covered the truth, and their mean relative half width."""

    covered: int
    naive: int
    half_width: float
    naive_half_width: float


def experiments(design: str, positions: int) -> Iterator[tuple[int, str]]:
    """Yield position and direction of every experiment of a design."""
    for position in range(positions):
        for direction in ("cw", "ccw"):
            if design == "one lost" and (position, direction) == (positions - 1, "ccw"):
                continue
            yield position, direction
            if design == "repeated at one position" and position == 0:
                yield position, direction


def drawn(rng: np.random.Generator, design: str, positions: int) -> Loads:
    """Return the readings of one simulated calibration."""
    places = GAIN * POSITION * rng.normal(size=positions)
    readings = []
    for number, (position, direction) in enumerate(experiments(design, positions)):
        sign = 1.0 if direction == "cw" else -1.0
        gain = GAIN * (1.0 + sign * DIRECTION + REPEAT * rng.normal()) + places[position]
        angle = 2.0 * math.pi * position / positions
        for series, torques in (("up", TORQUES), ("down", TORQUES[::-1])):
            for torque in torques:
                volts = sign * torque / gain + 0.01 + 1e-4 * rng.normal()
                readings.append(
                    LoadReading(str(number), angle, "full", direction, series, sign * torque, volts)
                )
    return Loads(tuple(readings))


def count(runs: int, seed: int, design: str, positions: int = 4) -> Count:
    """Return how many of `runs` intervals cover the truth."""
    rng = np.random.default_rng(seed)
    hits = naive = 0
    widths, naive_widths = [], []
    for _ in range(runs):
        result = evaluate_calibration(drawn(rng, design, positions), max_consistency=1.0)
        low, high = result.gain_nm_per_v.interval()
        hits += low <= GAIN <= high
        simple = result.uncertainty.naive
        if simple is None:
            raise SystemExit("a calibration of several experiments has a naive interval")
        naive += abs(result.gain_nm_per_v.value - GAIN) <= simple.expanded
        widths.append((high - low) / 2.0 / GAIN)
        naive_widths.append(simple.expanded / GAIN)
    return Count(hits, naive, float(np.mean(widths)), float(np.mean(naive_widths)))


def main() -> None:
    """Print one line for each design."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--positions", type=int, default=4)
    asked = parser.parse_args()
    print(f"{asked.runs} calibrations each, {asked.positions} positions, seed {asked.seed}")
    for design in DESIGNS:
        found = count(asked.runs, asked.seed, design, asked.positions)
        print(
            f"{design:26s} covers {100 * found.covered / asked.runs:5.1f} % "
            f"(half width {100 * found.half_width:.2f} %); naive "
            f"{100 * found.naive / asked.runs:5.1f} % ({100 * found.naive_half_width:.2f} %)"
        )


if __name__ == "__main__":
    main()
