"""Figures of a campaign: printed, and as docs/blind-benchmark.md with its picture."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from page import page
from runner import ROOT, read_lines
from scorer.judge import judge, open_truth
from scorer.metrics import Row, figures
from scorer.tables import by_family, by_outside, confusion, shuffled_rows
from wide import WIDE, line_of, report_wide, wide_page

__all__ = ["list_lines", "load_pairs", "load_rows", "report"]


def load_pairs(folder: Path) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Open the truths of a campaign: (truth, answer) of every record."""
    sealed = {entry["key"]: entry for entry in read_lines(folder / "truth.jsonl")}
    return [
        (open_truth(sealed[entry["key"]], entry["seal"]), entry)
        for entry in read_lines(folder / "answers.jsonl")
    ]


def load_rows(folder: Path) -> list[Row]:
    """Judge all answers of a campaign to the parts of single records, A to F, L and P."""
    return [
        Row((truth, entry, judge(truth, entry)))
        for truth, entry in load_pairs(folder)
        if truth["part"] not in (*WIDE, "R")
    ]


def _rivals(folder: Path, rows: list[Row]) -> dict[str, dict[str, Any]]:
    truths = {row.truth["key"]: row for row in rows}
    methods: dict[str, list[Row]] = {}
    for entry in read_lines(folder / "rivals.jsonl"):
        if entry["key"] not in truths:
            continue
        truth = truths[entry["key"]].truth
        methods.setdefault(entry["method"], []).append(Row((truth, entry, judge(truth, entry))))
    keys = {row.truth["key"] for some in methods.values() for row in some}
    if keys:
        methods["hdbench diagnose"] = [row for row in rows if row.truth["key"] in keys]
    return {name: figures(some) for name, some in methods.items()}


def _version() -> str:
    try:
        return version("hdbench")
    except PackageNotFoundError:
        return "0.1.0"


def _printed(numbers: dict[str, Any]) -> Iterable[str]:
    for name, value in numbers.items():
        if isinstance(value, tuple):
            share, count = value
            yield f"{name:28s} {'-' if share is None else format(share, '.3f'):>7s}  n = {count}"
        else:
            yield f"{name}: {json.dumps(value)}"


def list_lines(folder: Path, parts: str) -> None:
    """Print one line for every record of `parts` (all if empty)."""
    for truth, entry in sorted(load_pairs(folder), key=lambda pair: str(pair[0]["key"])):
        if not parts or truth["part"] in parts:
            print(line_of(truth, entry))


def report(folder: Path, write: bool) -> None:
    """Print the figures of the campaign in `folder`; with `write`, write page and picture."""
    rows = load_rows(folder)
    dynamic = [row for row in rows if row.truth["part"] != "L"]
    loads = [row for row in rows if row.truth["part"] == "L"]
    numbers, static = figures(dynamic), figures(_as_single(loads))
    for line in _printed(numbers):
        print(line)
    if loads:
        print("\ncalibration loads")
        for line in _printed(static):
            print(line)
    shuffled = figures(shuffled_rows(dynamic))
    pairs = load_pairs(folder)
    wide = [pair for pair in pairs if pair[0]["part"] in (*WIDE, "R")]
    if wide:
        print("\nseveral causes, nuisances, the unseen, records of others")
        for line in report_wide(wide):
            print(line)
    print("\ntruth shuffled within each part: must fall to chance")
    for line in _printed({key: shuffled[key] for key in ("score", "name_d10", "name_d20")}):
        print(line)
    if not write:
        return
    text = page(
        version=_version(),
        day=date.today().isoformat(),
        rows=dynamic,
        numbers=numbers,
        families=by_family(dynamic),
        outside=by_outside(dynamic),
        loads=loads,
        load_numbers=static,
        load_families=by_family(loads, "L"),
        shuffled=shuffled,
        rivals=_rivals(folder, rows),
        null=read_lines(folder / "null.jsonl"),
        wide=list(wide_page(wide)),
    )
    (ROOT / "docs" / "blind-benchmark.md").write_text(text)
    image = ROOT / "docs" / "images" / "blind-confusion.png"
    image.parent.mkdir(exist_ok=True)
    draw_confusion(confusion(dynamic), image)


def _as_single(rows: list[Row]) -> list[Row]:
    """Calibration records as parts A (clean), B (by sigmas) and P (physical sizes)."""
    out = []
    for row in rows:
        tier = row.tier
        part = "A" if not tier else ("B" if tier.startswith("d") else "P")
        out.append(Row(({**row.truth, "part": part}, row.entry, row.verdict)))
    return out


_REST = ("unexplained", "nothing", "no answer")


def draw_confusion(counts: Counter[tuple[str, str]], path: Path) -> None:
    """Draw true families (rows) against answers (columns), shares of each row, to `path`."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    families = sorted({true for true, _ in counts})
    answers = sorted({said for _, said in counts} - set(_REST) | set(families))
    columns = [*answers, *_REST]
    table = np.zeros((len(families), len(columns)))
    for (true, said), count in counts.items():
        table[families.index(true), columns.index(said)] = count
    totals = table.sum(axis=1, keepdims=True)
    shares = np.divide(table, totals, out=np.zeros_like(table), where=totals > 0)
    figure, axes = plt.subplots(figsize=(13.0, 11.0), layout="constrained")
    image = axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    axes.set_xticks(range(len(columns)), columns, rotation=90, fontsize=8)
    labels = [f"{name} ({int(total)})" for name, total in zip(families, totals[:, 0], strict=True)]
    axes.set_yticks(range(len(families)), labels, fontsize=8)
    axes.set_xlabel("answered first (the true name where the reported set holds its group)")
    axes.set_ylabel("hidden (number of records)")
    axes.set_title("Single effects at 10 and 20 sigma and at middle and high physical sizes")
    for i, j in np.argwhere(shares > 0.0):
        colour = "white" if shares[i, j] > 0.5 else "black"
        axes.text(j, i, f"{int(table[i, j])}", ha="center", va="center", fontsize=6, color=colour)
    figure.colorbar(image, ax=axes, label="share of the row", shrink=0.6)
    figure.savefig(path, dpi=110)
    plt.close(figure)
