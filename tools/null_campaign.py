"""Hold the drawn laws of the diagnosis against full simulations of clean records.

Simulates clean records of one motion, runs the whole diagnosis on each and counts how often any
finding appears, next to the rate that was asked for::

    tools/null_campaign.py --records 2000 --processes 2
    tools/null_campaign.py --records 200 --colour 0.9 --alpha 0.05

Prints one line; exits 1 where the count is above the 99.9 % point of the binomial law.
Needs PYTHONPATH only where hdbench is not installed.
"""

from __future__ import annotations

import argparse
import os
import sys
from concurrent.futures import ProcessPoolExecutor

# one core per process: threads of small matrix products only wait for each other
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402
from scipy.signal import lfilter  # noqa: E402
from scipy.stats import binom  # noqa: E402

from hdbench.diagnosis import diagnose_trace  # noqa: E402
from hdbench.profile import load_profile  # noqa: E402
from hdbench.records import Trace  # noqa: E402

_PERIOD_S = 1e-3
_NOISE_NM = 0.05
# samples until a pole at 0.99 has settled to rounding
_RUN_IN = 4000


def clean_record(seed: int, seconds: float, colour: float) -> Trace:
    """Return a record that holds the baseline and noise alone, on a motion with reversals."""
    rng = np.random.default_rng(seed)
    time = _PERIOD_S * np.arange(round(seconds / _PERIOD_S))
    rate = 2.0 * np.pi / rng.uniform(7.0, 12.0)
    mean, swing = rng.uniform(-20.0, 40.0), rng.uniform(60.0, 150.0)
    speed = mean + swing * np.sin(rate * time)
    drive = swing * rate * np.cos(rate * time)
    angle = mean * time + swing / rate * (1.0 - np.cos(rate * time))
    torque = rng.uniform(-0.3, 0.3) + 1.725e-4 * drive
    for order, size in ((2.0, 0.4), (4.0, 0.2), (0.01, 0.9)):
        torque = torque + size * np.cos(order * angle + rng.uniform(-np.pi, np.pi))
    white = np.sqrt(1.0 - colour**2) * rng.standard_normal(len(time) + _RUN_IN)
    torque += _NOISE_NM * lfilter([1.0], [1.0, -colour], white)[_RUN_IN:]
    return Trace(
        {
            "time_s": time,
            "motor_velocity_rad_s": speed,
            "motor_angle_rad": angle,
            "torque_nm": torque,
        }
    )


def _found(task: tuple[int, float, float, float]) -> tuple[bool, bool]:
    seed, seconds, colour, alpha = task
    record = clean_record(seed, seconds, colour)
    profile = load_profile("cim-tr-97-06")
    answer = diagnose_trace(record, profile, alpha=alpha, materiality=0.0, seed=seed)
    return bool(answer.causes), bool(answer.unexplained)


def main() -> int:
    """Run the campaign and return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--records", type=int, default=2000)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--colour", type=float, default=0.0, help="pole of the noise, in [0, 1)")
    parser.add_argument("--alpha", type=float, default=0.01)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=1)
    args = parser.parse_args()
    seeds = range(args.first_seed, args.first_seed + args.records)
    tasks = [(seed, args.seconds, args.colour, args.alpha) for seed in seeds]
    with ProcessPoolExecutor(args.processes) as pool:
        answers = list(pool.map(_found, tasks, chunksize=8))
    named = sum(a for a, _ in answers)
    nameless = sum(b for _, b in answers)
    either = sum(a or b for a, b in answers)
    limit = int(binom.ppf(0.999, args.records, args.alpha))
    print(
        f"{args.records} clean records: {either} with a finding ({named} named, {nameless} "
        f"unexplained), {either / args.records:.2%} against {args.alpha:.2%}; limit {limit}"
    )
    return 0 if either <= limit else 1


if __name__ == "__main__":
    sys.exit(main())
