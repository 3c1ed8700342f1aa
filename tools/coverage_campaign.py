"""Count how often the 95 % intervals of the closed loop cover the simulated truth.

Each seed runs calibrate, run-misalignment and run-ripple on the embedded bench over Modbus, with
the calibration's gain scaling both dynamic runs. The truth comes from the profile: gain averaged
over positions, amplitudes as the model describes them. Prints, per quantity, how many of the seeds
are covered. With true coverage 95 %, a count outside 182-198 of 200 has probability 0.6 %.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
from pathlib import Path

from hdbench.batch import Workers, run_tasks
from hdbench.profile import load_profile
from hdbench.records import Quantity
from hdbench.session import BenchOptions, run_experiment


def one_seed(seed: int) -> dict[str, bool]:
    """Run the three experiments with one seed and compare with the truth."""
    profile = load_profile("cim-tr-97-06")
    folder = Path(tempfile.mkdtemp(prefix="hdbench-coverage-"))
    try:
        quiet = lambda _what, _share: None  # noqa: E731 - a callback that says nothing
        calibration = run_experiment("calibration", profile, BenchOptions(folder, seed=seed), quiet)
        options = BenchOptions(folder, seed=seed, calibration=calibration.folder.path)
        misalignment = run_experiment("misalignment", profile, options, quiet)
        ripple = run_experiment("ripple", profile, options, quiet)
        gain, output, moved = (
            run.evaluation.result.to_json() for run in (calibration, misalignment, ripple)
        )
        truth = profile.data
        checks = {
            "gain": (gain["gain_nm_per_v"], truth.sensor.gain_nm_per_v),
            "misalignment": (output["amplitude_nm"], truth.model.misalignment.amplitude_nm),
        }
        for true, found in zip(truth.model.ripple, moved["ripple"], strict=True):
            checks[f"ripple order {true.order:g}"] = (found["amplitude_nm"], true.amplitude_nm)
        outcome = {name: covers(found, value) for name, (found, value) in checks.items()}
        print(json.dumps({"seed": seed, **outcome}), file=sys.stderr, flush=True)
        return outcome
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def covers(found: dict[str, float], truth: float) -> bool:
    """Say whether the 95 % interval with its own degrees of freedom holds the truth."""
    low, high = Quantity(found["value"], found["std"], found.get("dof")).interval(0.95)
    return low <= truth <= high


def main() -> int:
    """Run the campaign and print the table; exit 1 when a count is outside the band."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    found = run_tasks(one_seed, seeds, Workers(arguments.workers))
    outcomes = [outcome.value for outcome in found if not outcome.lost]
    counts = {name: sum(o[name] for o in outcomes) for name in outcomes[0]}
    print(json.dumps({"seeds": len(outcomes), "covered": counts}))
    # 182-198 of 200, and as many standard deviations of a binomial for other numbers of seeds
    slack = 8.0 * (len(outcomes) / 200.0) ** 0.5
    middle = 0.95 * len(outcomes)
    return int(any(abs(count - middle) > slack + 1e-9 for count in counts.values()))


if __name__ == "__main__":
    sys.exit(main())
