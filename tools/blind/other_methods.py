"""Simpler methods on the records of a campaign: greedy BIC, SINDy's thresholding, FROLS.

Where pysindy or sysidentpy are installed (extra `benchmark`), theirs run too.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

from injector.build import build
from rivals.installed import INSTALLED
from rivals.plain import METHODS, rival_answer
from runner import case_of, read_lines

from hdbench.batch import Workers, run_tasks

__all__ = ["run_rivals"]


def _one(text: str) -> list[dict[str, Any]]:
    case = case_of(text)
    made = build(case)
    out = []
    for method in (*METHODS, *INSTALLED):
        begin = time.perf_counter()
        answer = rival_answer(method, made)
        spent = round(time.perf_counter() - begin, 3)
        out.append({"key": case.key, "method": method, "answer": answer, "seconds": spent,
                    "peak_mb": 0.0})  # fmt: skip
    return out


def run_rivals(folder: Path, count: int, processes: int) -> int:
    """Let the simple methods answer the first `count` shorter records of parts A to D."""
    path = folder / "rivals.jsonl"
    done = {entry["key"] for entry in read_lines(path)}
    texts = []
    for sealed in read_lines(folder / "truth.jsonl"):
        case = case_of(sealed["case"])
        if case.part in "ABCD" and case.record in ("compact", "mixed", "constant"):
            texts.append((case.key, sealed["case"]))
    todo = [text for key, text in texts[:count] if key not in done]
    with path.open("a") as file:
        outcomes = run_tasks(_one, todo, Workers(processes))
        for number, outcome in enumerate(outcomes, start=1):
            for entry in outcome.value or ():
                file.write(json.dumps(entry) + "\n")
            file.flush()
            if number % 25 == 0:
                print(f"rivals {number}/{len(todo)}", file=sys.stderr, flush=True)
    return len(todo)
