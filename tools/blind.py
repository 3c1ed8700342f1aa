"""Blind benchmark: hide effects in records of an independent bench, diagnose, count.

Usage: python tools/blind.py [--orders 20] [--tones 20] [--frictions 20] [--clean 100]
[--duration 30] [--first-seed 1] [--materiality 0.01] [--json FILE]
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections import defaultdict
from pathlib import Path

# one core: the figures are per core, and threads of small matrix products only wait for each other
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

_TESTS = Path(__file__).resolve().parent.parent / "tests" / "blind"
sys.path.insert(0, str(_TESTS))

import numpy as np  # noqa: E402
from injector import MOTIONS, inject  # noqa: E402
from scorer import score  # noqa: E402

from hdbench.diagnosis import diagnose_trace  # noqa: E402
from hdbench.profile import load_profile  # noqa: E402
from hdbench.records import Trace  # noqa: E402


def _cell(injected: object) -> float:
    """Return one resolution cell: an inverse turn, or an inverse second."""
    columns = injected.columns  # type: ignore[attr-defined]
    if injected.hidden == "tone":  # type: ignore[attr-defined]
        return 1.0 / float(np.ptp(columns["time_s"]))
    return 4000.0 / float(np.ptp(columns["encoder_count"]))


def _cases(args: argparse.Namespace) -> list[tuple[str, str, str, int]]:
    seeds = args.first_seed
    cases = []
    for kind, count in (("order", args.orders), ("tone", args.tones), ("friction", args.frictions)):
        motions = MOTIONS[:2] if kind == "friction" else MOTIONS
        cases += [
            (kind, motion, noise, seeds + k)
            for motion in motions
            for k in range(count)
            for noise in (("white", "coloured")[k % 2],)
        ]
    for k in range(args.clean):
        cases.append(("clean", MOTIONS[k % 3], ("white", "coloured")[(k // 3) % 2], seeds + k))
    return cases


def main() -> int:
    """Run the benchmark and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name, default in (("orders", 20), ("tones", 20), ("frictions", 20), ("clean", 100)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--duration", type=float, default=30.0)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--materiality", type=float, default=0.01)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    profile = load_profile("cim-tr-97-06")
    rows: dict[tuple[str, str], list[tuple[object, float]]] = defaultdict(list)
    log = []
    for kind, motion, noise, seed in _cases(args):
        injected = inject(seed, kind, motion, noise, args.duration)
        trace = Trace(injected.columns, source=f"{kind}-{motion}-{seed}")
        begin = time.perf_counter()
        result = diagnose_trace(trace, profile, materiality=args.materiality, seed=seed)
        took = time.perf_counter() - begin
        answer = result.to_dict({})
        judged = score(injected, answer, _cell(injected))
        rows[kind, motion].append((judged, took))
        entry = {
            "case": [kind, motion, noise, seed],
            "place": injected.place,
            "amplitude_nm": injected.amplitude_nm,
            "score": {n: getattr(judged, n) for n in judged.__dataclass_fields__},
            "seconds": took,
            "verdict": answer["verdict"],
            "names": [c["name"] for c in answer["causes"]],
            "minor": [
                (
                    c["name"],
                    c["false_alarm_probability"],
                    {n: e["value"] for n, e in c["parameters"].items()},
                )
                for c in answer["minor"]
            ],
            "unexplained": answer["unexplained"] + answer["minor_unexplained"],
            "flags": answer["data_flags"],
        }
        log.append(entry)
        bad = (
            judged.extra
            or judged.minor
            or (kind != "clean" and not (judged.right_place and judged.right_name))
        )
        if bad:
            print(json.dumps(entry), file=sys.stderr, flush=True)
    print("kind      motion      n  found place name  second minor  s/record")
    for (kind, motion), judged_rows in rows.items():
        scores = [s for s, _ in judged_rows]
        print(
            f"{kind:9s} {motion:10s} {len(scores):3d} {sum(s.found for s in scores):5d} "
            f"{sum(s.right_place for s in scores):5d} {sum(s.right_name for s in scores):4d} "
            f"{sum(s.extra > 0 for s in scores):6d} {sum(s.minor > 0 for s in scores):5d} "
            f"{np.mean([t for _, t in judged_rows]):9.2f}"
        )
    if args.json:
        args.json.write_text(json.dumps(log, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
