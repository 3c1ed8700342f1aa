"""Count how often the 95 % intervals of gain, amplitudes and phases cover a known truth.

    python tools/coverage.py loop [--runs 200]
    python tools/coverage.py evaluations [--runs 400]
    python tools/coverage.py calibration [--runs 1000]

`loop`: calibrate, run-misalignment and run-ripple on the embedded bench over Modbus, with the
calibration's gain scaling both dynamic runs; the truth is the profile's. Exits 1 where a count is
outside 182 to 198 of 200 (probability 0.6 % at a coverage of 95 %), or as many standard deviations
of another number of runs. `evaluations`: gains of four positions with 2 % between them, a reversing
run of 12 s and two output turns both ways, in white noise and in noise with a pole at 0.9, drawn
outside the product; the traces are those of the tests. `calibration`: positions and repetitions are
random effects, the direction is a fixed one, and the truth is the mean of both directions; beside
the interval stands the naive one, which takes every experiment as independent.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

# one core per process: threads of small matrix products only wait for each other
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402

from hdbench.batch import Workers, run_tasks  # noqa: E402
from hdbench.calibration import evaluate_calibration  # noqa: E402
from hdbench.profile import load_profile  # noqa: E402
from hdbench.records import LoadReading, Loads, Quantity, TorqueScale  # noqa: E402

GAIN = 6.6
TORQUES = (0.0, 10.0, 20.0, 30.0, 40.0)
DESIGNS = ("balanced", "one lost", "repeated at one position")


def drawn_loads(
    rng: np.random.Generator,
    design: str = "balanced",
    positions: int = 4,
    *,
    repeat: float = 0.0,
    direction: float = 0.0,
    noise_v: float = 1e-3,
) -> Loads:
    """Return the readings of a simulated calibration, 2 % between positions.

    `repeat` is the relative scatter within a position, `direction` half the difference of the
    directions.
    """
    places = 0.02 * rng.normal(size=positions)
    readings = []
    for number, (position, way) in enumerate(experiments(design, positions)):
        sign = 1.0 if way == "cw" else -1.0
        gain = GAIN * (1.0 + sign * direction + repeat * rng.normal() + places[position])
        angle = 2.0 * math.pi * position / positions
        for series, torques in (("up", TORQUES), ("down", TORQUES[::-1])):
            for torque in torques:
                volts = sign * torque / gain + 0.01 + noise_v * rng.normal()
                readings.append(
                    LoadReading(str(number), angle, "full", way, series, sign * torque, volts)
                )
    return Loads(tuple(readings))


def experiments(design: str, positions: int) -> Iterator[tuple[int, str]]:
    """Yield position and direction of every experiment of a design."""
    for position in range(positions):
        for direction in ("cw", "ccw"):
            if design == "one lost" and (position, direction) == (positions - 1, "ccw"):
                continue
            yield position, direction
            if design == "repeated at one position" and position == 0:
                yield position, direction


def covers(found: Quantity, truth: float) -> bool:
    """Say whether the 95 % interval with its own degrees of freedom holds the truth."""
    low, high = found.interval(0.95)
    return low <= truth <= high


# --- loop
def one_loop(seed: int) -> dict[str, bool]:
    """Run the three experiments with one seed and compare with the truth."""
    from hdbench.session import BenchOptions, run_experiment

    profile = load_profile("cim-tr-97-06")
    folder = Path(tempfile.mkdtemp(prefix="hdbench-coverage-"))
    try:
        quiet = lambda _what, _share: None  # noqa: E731 - a callback that says nothing
        calibration = run_experiment("calibration", profile, BenchOptions(folder, seed=seed), quiet)
        options = BenchOptions(folder, seed=seed, calibration=calibration.folder.path)
        output, moved = (
            run_experiment(kind, profile, options, quiet).result
            for kind in ("misalignment", "ripple")
        )
        truth = profile.data
        gain = calibration.result.gain_nm_per_v
        outcome = {
            "gain": covers(gain, truth.sensor.gain_nm_per_v),
            "misalignment": covers(output.amplitude_nm, truth.model.misalignment.amplitude_nm),
        }
        for true, found in zip(truth.model.ripple, moved.ripple, strict=True):
            outcome[f"ripple order {true.order:g}"] = covers(found.amplitude_nm, true.amplitude_nm)
        print(json.dumps({"seed": seed, **outcome}), file=sys.stderr, flush=True)
        return outcome
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def loop_apart(seed: int) -> dict[str, int]:
    """Run one loop as a program: an experiment catches Ctrl-C, which only a main thread can."""
    words = [sys.executable, __file__, "loop", "--runs", "1", "--seed", str(seed)]
    said = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=False).stdout
    covered: dict[str, int] = json.loads(said)["covered"]
    return covered


def loop(asked: argparse.Namespace) -> int:
    """Run the campaign of closed loops and print the table."""
    counts: Counter[str] = Counter()
    if asked.runs == 1:
        counts.update({name: int(hit) for name, hit in one_loop(asked.seed).items()})
    else:
        seeds = range(asked.seed, asked.seed + asked.runs)
        for outcome in run_tasks(loop_apart, seeds, Workers(asked.workers)):
            if outcome.lost:
                raise SystemExit(f"seed {outcome.task}: the worker died {outcome.deaths} times")
            counts.update(outcome.value)
    print(json.dumps({"seeds": asked.runs, "covered": counts}))
    slack, middle = 8.0 * (asked.runs / 200.0) ** 0.5, 0.95 * asked.runs
    return int(any(abs(count - middle) > slack + 1e-9 for count in counts.values()))


# --- evaluations
def covered(task: tuple[int, float]) -> list[str]:
    """Return the names of the quantities whose interval holds the truth, by seed and colour."""
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "ripple"))
    from known_traces import Truth, bench, both_ways_velocity, known_trace, reversing_velocity

    from hdbench.filter import preset
    from hdbench.misalignment import evaluate_misalignment
    from hdbench.ripple import evaluate_ripple

    seed, colour = task
    rng, truth, profile = np.random.default_rng([seed, round(10 * colour)]), Truth(), bench()
    gain = evaluate_calibration(drawn_loads(rng), max_consistency=0.05).gain_nm_per_v
    given = {
        "scale": TorqueScale(gain, "calibration drawn"),
        "filter_model": preset("report-6", profile),
    }
    moving = known_trace(rng, reversing_velocity(), colour=colour)
    turning = known_trace(rng, both_ways_velocity(), colour=colour)
    two, four = evaluate_ripple(moving, profile, **given).ripple
    output = evaluate_misalignment(turning, profile, **given)
    pairs: dict[str, tuple[Quantity, float]] = {
        "gain": (gain, GAIN),
        "order 2": (two.amplitude_nm, truth.order_2[0]),
        "order 4": (four.amplitude_nm, truth.order_4[0]),
        "misalignment": (output.amplitude_nm, truth.misalignment[0]),
        "phase 2": (two.phase_rad, truth.order_2[1]),
        "phase 4": (four.phase_rad, truth.order_4[1]),
        "phase misalignment": (output.phase_rad, truth.misalignment[1]),
    }
    return [name for name, (quantity, true) in pairs.items() if covers(quantity, true)]


def evaluations(asked: argparse.Namespace) -> int:
    """Run the campaign of evaluations and print a line per noise and quantity."""
    for label, colour in (("white", 0.0), ("pole at 0.9", 0.9)):
        counts: Counter[str] = Counter()
        tasks = ((seed, colour) for seed in range(asked.seed, asked.seed + asked.runs))
        for outcome in run_tasks(covered, tasks, Workers(asked.workers)):
            counts.update(outcome.value or ())
        for name, count in counts.items():
            print(f"{label:12} {name:20} {100.0 * count / asked.runs:5.1f} %", flush=True)
    return 0


# --- calibration
@dataclass(frozen=True, slots=True)
class Count:
    """Intervals that covered the truth, and their mean relative half width."""

    covered: int
    naive: int
    half_width: float
    naive_half_width: float


def count(runs: int, seed: int, design: str, positions: int = 4) -> Count:
    """Return how many of `runs` intervals of a gain cover the truth."""
    rng = np.random.default_rng(seed)
    hits = naive = 0
    widths, naive_widths = [], []
    for _ in range(runs):
        loads = drawn_loads(rng, design, positions, repeat=0.004, direction=0.0035, noise_v=1e-4)
        result = evaluate_calibration(loads, max_consistency=1.0)
        low, high = result.gain_nm_per_v.interval()
        hits += low <= GAIN <= high
        simple = result.uncertainty.naive
        if simple is None:
            raise SystemExit("a calibration of several experiments has a naive interval")
        naive += abs(result.gain_nm_per_v.value - GAIN) <= simple.expanded
        widths.append((high - low) / 2.0 / GAIN)
        naive_widths.append(simple.expanded / GAIN)
    return Count(hits, naive, float(np.mean(widths)), float(np.mean(naive_widths)))


def calibration(asked: argparse.Namespace) -> int:
    """Print one line for each design of a calibration."""
    for design in DESIGNS:
        found = count(asked.runs, asked.seed, design)
        shares = [100.0 * hits / asked.runs for hits in (found.covered, found.naive)]
        print(
            f"{design:26s} covers {shares[0]:5.1f} % (half width {100 * found.half_width:.2f} %); "
            f"naive {shares[1]:5.1f} % ({100 * found.naive_half_width:.2f} %)"
        )
    return 0


CAMPAIGNS = {
    "loop": (loop, 200),
    "evaluations": (evaluations, 400),
    "calibration": (calibration, 1000),
}


def main() -> int:
    """Run a campaign and return its exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("campaign", choices=CAMPAIGNS)
    parser.add_argument("--runs", type=int)
    parser.add_argument("--seed", type=int, default=0, help="the first one")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    asked = parser.parse_args()
    run, runs = CAMPAIGNS[asked.campaign]
    asked.runs = asked.runs or runs
    return run(asked)


if __name__ == "__main__":
    sys.exit(main())
