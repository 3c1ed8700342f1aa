"""Table of speed: filter, trace files and the command's start, beside other libraries.

Usage: python tools/bench.py [--samples N] [--rows N] [--write PAGE.md]
"""

from __future__ import annotations

import argparse
import math
import platform
import re
from collections.abc import Iterator
from pathlib import Path

import bench_files
import bench_filter

from hdbench import __version__

PAGE = """# Speed

Written by `make bench`, which installs the libraries that stand beside hdbench. A shared computer
allows ratios only: all contenders take turns in one run, and processor time is counted. *times
ours* is the cost of a contender divided by that of hdbench. The matrices of other filters are made
beforehand and not counted; ours starts from velocity and torque.

{machine}

| what | cost | times ours | differs, N m |
|---|---|---|---|
{rows}
"""
Row = tuple[str, str, str, str]


def _row(name: str, cost: float, unit: str, against: float, differs: float | None) -> Row:
    took = "" if math.isnan(cost) else f"{cost:.4g} {unit}"
    ratio = "" if math.isnan(against) else f"{against:.3g}"
    return name, took, ratio, "" if differs is None else f"{differs:.1e}"


def _rows(samples: int, rows: int) -> Iterator[Row]:
    """Yield the rows of the table, each when it is measured."""
    filters, missing = bench_filter.rows(samples)
    for row in filters:
        yield _row(row.name, row.cost, "ns per sample", row.against, row.differs_nm)
    for word, found in zip(("read", "write"), bench_files.files(rows), strict=True):
        for name, cost in found.items():
            title = f"{word} CSV of {rows:.0e} x 6, {name}"
            yield _row(title, cost, "s", cost / found["hdbench"], None)
    started = bench_files.start()
    for name, cost in started.items():
        yield _row(name, 1e3 * cost, "ms", cost / started["hdbench --help"], None)
    for name in missing:
        yield name, "not here", "pip install 'hdbench[bench]'", ""


def _machine() -> str:
    found = Path("/proc/cpuinfo")
    names = re.findall(r"model name\s*: (.*)", found.read_text()) if found.is_file() else []
    chip = names[0] if names else platform.processor() or platform.machine()
    return f"{chip}, {platform.system()}, Python {platform.python_version()}, hdbench {__version__}"


def main() -> None:
    """Run everything, print it, and write the page where one is named."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--samples", type=int, default=1_000_000, help="samples of the long run")
    parser.add_argument("--rows", type=int, default=1_000_000, help="rows of the trace file")
    parser.add_argument("--write", metavar="FILE", type=Path, help="page to write")
    given = parser.parse_args()
    rows = []
    print(f"{'':40} {'cost':24} {'times ours':>10} {'differs, N m':>13}")
    for row in _rows(max(given.samples, 1), max(given.rows, 1)):
        print(f"{row[0]:40} {row[1]:24} {row[2]:>10} {row[3]:>13}", flush=True)
        rows.append(f"| {' | '.join(row)} |")
    if given.write is not None:
        given.write.write_text(PAGE.format(machine=_machine(), rows="\n".join(rows)))


if __name__ == "__main__":
    main()
