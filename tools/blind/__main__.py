"""Blind benchmark: hide effects with a bench of its own, diagnose, open the truth, count.

A few records of one family, at once and in one process::

    python tools/blind --part B --family coulomb-friction --record protocol --d 10 --limit 5

prints one line per record: what was hidden, what was answered, how it is scored. `--show` adds
parameters, truth and bounds. Choose with `--part ABPCDEFLTWUR` (A clean, B single effects at 3 to
20 sigma, P physical sizes, C two effects, D outside the catalogue, E look-alike duels, F bad data,
L calibration loads, T three to five causes, W pairs with and without nuisances of real logs, U
unseen effects, R records of others in `HDBENCH_DATA`), `--family NAME`, `--d N`,
`--tier low|mid|high`, `--noise white|ar|flicker`, `--record constant|compact|mixed|short|protocol|
long` (for R the record's name), `--key KEY`, `--limit N`; the grid is mixed, so that any beginning
of it is fair. To try another engine: PYTHONPATH=<its checkout>.

The whole benchmark, resumable (answers already there are kept) and quiet::

    python tools/blind --full --processes 2 --out build/blind
    python tools/blind --report build/blind          # figures; --write: docs/blind-benchmark.md too
    python tools/blind --report build/blind --lines --part B    # a line per record

    python tools/blind --rivals 150 --out build/blind   # simpler methods on 150 records

`--stop-after MINUTES` ends early with what there is; `--fresh` takes seeds from commit and date,
otherwise the public ones. The null of the diagnosis against full simulations:
`python tools/blind/null.py --out build/blind`, whose figures the page takes up. Needs PYTHONPATH
only where hdbench is not installed.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

# one core per process: threads of small matrix products only wait for each other
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

# the runner makes the injector and the scorer importable
from runner import Options, answer_case, fresh_base, run  # noqa: E402, I001
from injector.cases import PUBLIC_SEED, grid  # noqa: E402
from injector.loads import load_cases  # noqa: E402
from real_records import real_cases  # noqa: E402
from scorer.judge import open_truth  # noqa: E402
from wide import line_of, report_wide  # noqa: E402


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--part", default="")
    parser.add_argument("--family", action="append", default=[])
    parser.add_argument("--key", action="append", default=[])
    parser.add_argument("--record", action="append", default=[])
    parser.add_argument("--noise", action="append", default=[])
    parser.add_argument("--d", type=float, action="append", default=[])
    parser.add_argument("--tier", action="append", default=[])
    parser.add_argument("--limit", type=int)
    parser.add_argument("--base", type=int, help="base seed; default the public one")
    parser.add_argument("--fresh", action="store_true", help="base seed from commit and date")
    parser.add_argument("--full", action="store_true")
    parser.add_argument("--scale", type=float, default=1.0, help="records per cell, times this")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--stop-after", type=float, default=float("inf"), metavar="MINUTES")
    parser.add_argument("--show", action="store_true")
    parser.add_argument("--report", type=Path, metavar="FOLDER")
    parser.add_argument("--rivals", type=int, metavar="N", help="simpler methods on N records")
    parser.add_argument(
        "--keep-before",
        metavar="ENGINE",
        help="with --report: keep the figures "
        "of T, W, U and R as those of this engine, the page's column `before`",
    )
    parser.add_argument("--lines", action="store_true", help="with --report: a line per record")
    parser.add_argument("--write", action="store_true", help="with --report: write the page")
    return parser.parse_args()


def _chosen(args: argparse.Namespace) -> list:  # type: ignore[type-arg]
    base = fresh_base() if args.fresh else (args.base or PUBLIC_SEED)
    tiers = {f"d{value:g}" for value in args.d} | set(args.tier)
    parts = args.part or "ABPCDEFLTWUR"
    old = "".join(part for part in parts if part in "ABPCDEF")
    lists = [
        list(grid(base, old, args.scale)),
        load_cases(base) if "L" in parts else [],
        *(list(grid(base, part, args.scale)) for part in parts if part in "TWU"),
        real_cases() if "R" in parts else [],
    ]
    # runs and calibrations side by side, so that an early end has its share of both
    placed = [
        ((k + 0.5) / len(some), n, c) for n, some in enumerate(lists) for k, c in enumerate(some)
    ]
    every = [case for _, _, case in sorted(placed, key=lambda entry: entry[:2])]
    cases = [
        case
        for case in every
        if (not args.record or case.record in args.record)
        and (not args.key or case.key in args.key)
        and (not args.noise or case.noise in args.noise)
        and (not tiers or any(hidden.tier in tiers for hidden in case.hidden))
        and (not args.family or _names(case) & set(args.family))
    ]
    return cases[: args.limit]


def _names(case: object) -> set[str]:
    hidden = {entry.name for entry in case.hidden}  # type: ignore[attr-defined]
    return hidden | {case.fault}  # type: ignore[attr-defined]


def _at_once(args: argparse.Namespace) -> None:
    """Diagnose the chosen cases here and print one line each."""
    done = []
    for case in _chosen(args):
        sealed, entry = answer_case(case)
        truth = open_truth(sealed, entry["seal"])
        done.append((truth, entry))
        print(line_of(truth, entry), flush=True)
        if args.show:
            shown = {key: entry.get("answer", {}).get(key) for key in ("causes", "unexplained")}
            known = truth.get("known") or truth["hidden"]
            print(json.dumps({"truth": known, **shown}, indent=1), flush=True)
    for line in report_wide(done):
        print(line)


def main() -> int:
    """Run what was asked for."""
    args = _arguments()
    if args.report:
        from report import list_lines, report

        if args.lines:
            list_lines(args.report, args.part)
        elif args.keep_before:
            from report import load_pairs
            from wide import keep_before

            keep_before(load_pairs(args.report), args.keep_before)
        else:
            report(args.report, args.write)
        return 0
    if args.rivals:
        from other_methods import run_rivals

        run_rivals(args.out or Path("build") / "blind", args.rivals, args.processes)
        return 0
    if not args.full and args.out is None:
        _at_once(args)
        return 0
    out = args.out or Path("build") / "blind"
    options = Options(out, args.processes, True, 60.0 * args.stop_after)
    answered = run(_chosen(args), options)
    print(f"{answered} answered now; {out / 'answers.jsonl'}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
