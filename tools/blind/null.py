"""Hold the drawn laws of the diagnosis against full simulations of clean records.

Simulates short clean records (8 s, reversals, half of them under a measured load) with white noise,
with a pole at 0.9 and with a 1/f rise, runs the whole diagnosis on each and counts how often any
finding appears, next to the rate that was asked for::

    python tools/blind/null.py --records 2100 --processes 2 --out build/blind

2100 records take some 12 minutes of one core. Answers are kept in FOLDER/null.jsonl and not asked
again; `python tools/blind --report FOLDER --write` puts the figures on the benchmark's page.
Exits 1 where a count is above the 99.9 % point of the binomial law at the nominal rate.
Needs PYTHONPATH only where hdbench is not installed.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any

# one core per process: threads of small matrix products only wait for each other
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from runner import end_line, read_lines  # noqa: E402
from scipy.signal import lfilter  # noqa: E402
from scipy.stats import binom, binomtest  # noqa: E402

from hdbench.batch import Workers, run_tasks  # noqa: E402
from hdbench.diagnosis import diagnose_trace  # noqa: E402
from hdbench.profile import load_profile  # noqa: E402
from hdbench.records import Trace  # noqa: E402

NOISES = ("white", "ar", "flicker")
_WORDS = {"white": "white", "ar": "AR(0.9)", "flicker": "1/f"}


def table(entries: Sequence[Mapping[str, Any]], alpha: float) -> tuple[list[str], bool]:
    """Return lines of a Markdown table, and whether all counts keep the nominal rate."""
    lines = [
        "| noise | records | nominal rate | with a finding | rate (95 % interval) "
        "| highest count that chance explains (99.9 %) | named | unexplained |",
        "|---|---|---|---|---|---|---|---|",
    ]
    kept = True
    groups = [(_WORDS[kind], [e for e in entries if e["noise"] == kind]) for kind in NOISES]
    for words, some in (*groups, ("all", list(entries))):
        if not some:
            continue
        events = sum(bool(e["names"] or e["places"]) for e in some)
        named, left = sum(bool(e["names"]) for e in some), sum(bool(e["places"]) for e in some)
        low, high = binomtest(events, len(some)).proportion_ci(0.95, "exact")
        limit = int(binom.ppf(0.999, len(some), alpha))
        kept = kept and events <= limit
        lines.append(
            f"| {words} | {len(some)} | {alpha:.2%} | {events} | {events / len(some):.2%} "
            f"({low:.2%}-{high:.2%}) | {limit} | {named} | {left} |"
        )
    said = Counter(name for e in entries for name in (*e["names"], *e["places"]))
    if said:
        what = ", ".join(f"{name} ({count})" for name, count in said.most_common())
        lines += ["", f"Findings: {what}."]
    return lines, kept


_PERIOD_S = 1e-3
_NOISE_NM = 0.05
_POLE = 0.9
# 1/f below this frequency, white above it, Hz
_CORNER_HZ = 100.0


def noise_of(kind: str, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return noise of standard deviation 1 in the mean over records."""
    if kind == "ar":
        # 400 samples until a pole at 0.9 has settled to rounding
        white = np.sqrt(1.0 - _POLE**2) * rng.standard_normal(count + 400)
        return np.asarray(lfilter([1.0], [1.0, -_POLE], white)[400:])
    white = rng.standard_normal(4 * count)
    if kind == "white":
        return white[:count]
    # four times the length: no period of the transform shows in the part that is kept
    hertz = np.fft.rfftfreq(len(white), _PERIOD_S)
    rise = np.sqrt(1.0 + _CORNER_HZ / np.maximum(hertz, hertz[1]))
    rise[0] = 0.0
    size = np.sqrt(np.mean(rise**2))
    return np.asarray(np.fft.irfft(np.fft.rfft(white) * rise / size, len(white))[:count])


def clean_record(seed: int, seconds: float, kind: str) -> Trace:
    """Return a record that holds the baseline and noise alone, on a motion with reversals."""
    rng = np.random.default_rng([seed, NOISES.index(kind)])
    clock = _PERIOD_S * np.arange(round(seconds / _PERIOD_S))
    rate = 2.0 * np.pi / rng.uniform(0.3 * seconds, 0.6 * seconds)
    mean, swing = rng.uniform(-20.0, 110.0), rng.uniform(120.0, 200.0)
    speed = mean + swing * np.sin(rate * clock)
    angle = mean * clock + swing / rate * (1.0 - np.cos(rate * clock))
    columns = {
        "time_s": clock,
        "motor_velocity_rad_s": speed,
        "motor_angle_rad": angle,
    }
    torque = rng.uniform(-0.3, 0.3) + 1.725e-4 * swing * rate * np.cos(rate * clock)
    for order, size in ((2.0, 0.4), (4.0, 0.2), (0.01, 0.9)):
        torque = torque + size * np.cos(order * angle + rng.uniform(-np.pi, np.pi))
    if rng.random() < 0.5:
        turns = rng.uniform(0.2, 0.7) * clock + rng.uniform(0.0, 1.0)
        columns["load_torque_nm"] = rng.uniform(10.0, 25.0) * np.sin(2.0 * np.pi * turns)
        torque = torque + columns["load_torque_nm"]
    columns["torque_nm"] = torque + _NOISE_NM * noise_of(kind, len(clock), rng)
    return Trace(columns)


def _answer(task: tuple[int, str, float, float]) -> dict[str, object]:
    seed, kind, seconds, alpha = task
    record, profile = clean_record(seed, seconds, kind), load_profile("cim-tr-97-06")
    begin = time.process_time()
    answer = diagnose_trace(record, profile, alpha=alpha, materiality=0.0, seed=seed)
    return {
        "seed": seed,
        "noise": kind,
        "seconds": seconds,
        "alpha": alpha,
        "names": [cause.name for cause in answer.causes],
        "places": [left.domain for left in answer.unexplained],
        "cpu_s": round(time.process_time() - begin, 3),
    }


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--records", type=int, default=2100, help="of all kinds of noise together")
    parser.add_argument("--seconds", type=float, default=8.0, help="length of a record")
    parser.add_argument("--noise", choices=NOISES, action="append", help="default: all three")
    parser.add_argument("--alpha", type=float, default=0.01)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("build") / "blind", metavar="FOLDER")
    parser.add_argument("--stop-after", type=float, default=float("inf"), metavar="MINUTES")
    return parser.parse_args()


def main() -> int:
    """Run the campaign and return the exit code."""
    args = _arguments()
    kinds = args.noise or list(NOISES)
    tasks = [
        (args.first_seed + k // len(kinds), kinds[k % len(kinds)], args.seconds, args.alpha)
        for k in range(args.records)
    ]
    args.out.mkdir(parents=True, exist_ok=True)
    path = args.out / "null.jsonl"
    done = {(e["seed"], e["noise"], e["seconds"], e["alpha"]) for e in read_lines(path)}
    todo = [task for task in tasks if task not in done]
    end = time.monotonic() + 60.0 * args.stop_after
    end_line(path)
    in_time = takewhile(lambda _: time.monotonic() < end, todo)
    with path.open("a") as file:
        for outcome in run_tasks(_answer, in_time, Workers(args.processes)):
            if not outcome.lost:
                file.write(json.dumps(outcome.value) + "\n")
                file.flush()
    wanted = {*tasks}
    entries = [
        e for e in read_lines(path) if (e["seed"], e["noise"], e["seconds"], e["alpha"]) in wanted
    ]
    lines, kept = table(entries, args.alpha)
    print("\n".join(lines))
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
