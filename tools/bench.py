"""Print one table: filter, trace files and the command's start, beside other libraries.

Usage: python tools/bench.py [--samples N] [--rows N]
"""

from __future__ import annotations

import argparse
import math

import bench_files
import bench_filter


def _line(name: str, cost: float, unit: str, against: float, differs: float | None) -> str:
    took = "" if math.isnan(cost) else f"{cost:12.4g} {unit}"
    ratio = "" if math.isnan(against) else f"{against:10.3g}"
    apart = "" if differs is None else f"{differs:.1e}"
    return f"{name:34} {took:26} {ratio:>10} {apart:>13}"


def main() -> None:
    """Run everything and print it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--samples", type=int, default=1_000_000, help="samples of the long run")
    parser.add_argument("--rows", type=int, default=1_000_000, help="rows of the trace file")
    given = parser.parse_args()
    print(f"{'':34} {'cost':26} {'times ours':>10} {'differs, N m':>13}")
    filters, missing = bench_filter.rows(max(given.samples, 1))
    for row in filters:
        print(_line(row.name, row.cost, "ns per sample", row.against, row.differs_nm))
    rows = max(given.rows, 1)
    for word, found in zip(("read", "write"), bench_files.files(rows), strict=True):
        for name, cost in found.items():
            title = f"{word} CSV of {rows:.0e} x 6, {name}"
            print(_line(title, cost, "s", cost / found["hdbench"], None))
    started = bench_files.start()
    for name, cost in started.items():
        print(_line(name, 1e3 * cost, "ms", cost / started["hdbench --help"], None))
    for name in missing:
        print(f"{name}: not here; pip install 'hdbench[bench]'")


if __name__ == "__main__":
    main()
