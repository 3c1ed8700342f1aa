"""Parts T, W, U and the records of others: lines, figures, and their sections of the page."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from scorer.judge import judge
from scorer.levels import WIDE_LEVELS, interval
from scorer.real import Real, judge_real, real_figures
from scorer.tables import one_line
from scorer.wide import judge_wide, wide_figures, wide_line

__all__ = ["BEFORE", "WIDE", "keep_before", "line_of", "report_wide", "wide_numbers", "wide_page"]

WIDE = "TWU"
BEFORE = Path(__file__).resolve().parents[2] / "docs" / "blind-before.json"

_LEVELS = {level.key: level for level in WIDE_LEVELS}
# W: the record with nuisances may stay this much behind its partner
_BEHIND = 0.05


def line_of(truth: dict[str, Any], entry: dict[str, Any]) -> str:
    """Return one line for a record of any part: hidden, answered, scored."""
    if truth["part"] == "R":
        return _real_line(truth, entry)
    line = one_line(truth, entry, judge(truth, entry))
    if truth["part"] in WIDE:
        # the marks of the old parts are replaced by their own
        said, _, machine = line.rsplit(" | ", 2)
        return f"{said} | {wide_line(truth, entry, judge_wide(truth, entry))} | {machine}"
    return line


def _parameter(name: str, told: tuple[Any, ...]) -> str:
    value, std, close, tight = told
    if value is None:
        return f"{name} -"
    marks = ("" if close else " OFF") + ("" if tight else " std")
    return f"{name} {value:.4g}+-{std:.2g}{marks}"


def _order(order: str, told: tuple[bool, float | None]) -> str:
    return f"{order}:{'-' if told[1] is None else format(told[1], '.4f')}{'' if told[0] else '?'}"


def _counted(names: Iterable[str]) -> str:
    said = Counter(names).items()
    return ", ".join(f"{count} x {name}" if count > 1 else name for name, count in said) or "-"


def _real_words(verdict: Real) -> dict[str, str]:
    named = [f"{name}{'' if hit else '?'}" for name, hit in verdict.named.items()]
    held = " -> ".join(f"{value:.2f} %" for value in verdict.heldout)
    return {
        "names": ", ".join(named) or "-",
        "orders": " ".join(_order(*some) for some in verdict.orders.items()) or "-",
        "must not": _counted(verdict.forbidden),
        "other names": _counted(verdict.false_causes),
        "parameters": "; ".join(_parameter(*some) for some in verdict.parameters.items()) or "-",
        "unexplained": str(verdict.unexplained) if verdict.answered else "refused",
        "held out": held or "-",
        "s": f"{verdict.cpu_s:.1f}",
    }


def _real_line(truth: dict[str, Any], entry: dict[str, Any]) -> str:
    words = _real_words(judge_real(truth["known"], entry))
    said = "; ".join(f"{key}: {value}" for key, value in words.items() if value != "-")
    error = entry.get("refused") or entry.get("crashed") or ""
    return f"{truth['key']} {said} {error}".rstrip()


def wide_numbers(rows: Sequence[tuple[dict[str, Any], dict[str, Any]]]) -> dict[str, Any]:
    """Return the figures of parts T, W, U and R from (truth, entry) pairs."""
    wide = [(t, e, judge_wide(t, e)) for t, e in rows if t["part"] in WIDE]
    real = [(t, e, judge_real(t["known"], e)) for t, e in rows if t["part"] == "R"]
    return {**wide_figures(wide), **(real_figures(real) if real else {})}


def report_wide(rows: Sequence[tuple[dict[str, Any], dict[str, Any]]]) -> Iterable[str]:
    """Yield the figures of parts T, W, U and R as lines of text."""
    for key, (value, count) in wide_numbers(rows).items():
        shown = "-" if value is None else f"{value:.3f}"
        yield f"{_LEVELS[key].words:60s} {shown:>8s}  n = {count}"


def keep_before(
    rows: Sequence[tuple[dict[str, Any], dict[str, Any]]], engine: str, path: Path = BEFORE
) -> None:
    """Write the figures of an engine that the page keeps as its column `before`."""
    real = {t["record"]: _real_words(judge_real(t["known"], e)) for t, e in rows
            if t["part"] == "R"}  # fmt: skip
    kept = {"engine": engine, "figures": wide_numbers(rows), "real": real}
    path.write_text(json.dumps(kept, indent=1) + "\n")


def _shown(told: Sequence[Any] | None, percent: bool) -> str:
    if told is None or told[0] is None:
        return "-"
    value, count = told
    if not percent:
        return f"{value:.2f} (n {count})"
    low, high = interval(value, count)
    return f"{100.0 * value:.1f} % ({100.0 * low:.1f}-{100.0 * high:.1f}), n {count}"


def _limits(key: str, numbers: Mapping[str, Any]) -> tuple[float | None, float | None]:
    level = _LEVELS[key]
    least, most = (None, level.needed) if level.low else (level.needed, level.most)
    if key in ("W_detected_rough", "W_named_rough"):
        partner = numbers.get(key.replace("rough", "plain"), (None, 0))[0]
        least = None if partner is None else partner - _BEHIND
    return least, most


def _level(key: str, numbers: Mapping[str, Any]) -> str:
    scale, unit = (100.0, " %") if _LEVELS[key].percent else (1.0, "")
    pairs = zip((">=", "<="), _limits(key, numbers), strict=True)
    said = [f"{sign} {scale * limit:.4g}{unit}" for sign, limit in pairs if limit is not None]
    return " and ".join(said) or "-"


def _mark(key: str, numbers: Mapping[str, Any]) -> str:
    """Return how a figure stands to its level; within chance: a 95 % interval that reaches it."""
    least, most = _limits(key, numbers)
    value, count = numbers.get(key, (None, 0))
    if value is None or (least is None and most is None):
        return "-"
    percent = _LEVELS[key].percent
    for low, high, words in (
        (value, value, "pass"),
        (*(interval(value, count) if percent else (value, value)), "missed, within chance"),
    ):
        if (least is None or high >= least) and (most is None or low <= most):
            return words
    return "**missed**"


def wide_page(rows: Sequence[tuple[dict[str, Any], dict[str, Any]]]) -> Iterable[str]:
    """Yield the page's sections of parts T, W, U and real, the engine before beside."""
    before = json.loads(BEFORE.read_text()) if BEFORE.exists() else {"figures": {}, "real": {}}
    numbers = wide_numbers(rows)
    yield "## Several causes, nuisances, the unseen, and records of others\n"
    yield f"`before`: engine {before.get('engine', '-')} on fewer records of the same parts.\n"
    yield "| figure | level | before | measured (95 % interval) | |"
    yield "|---|---|---|---|---|"
    for key, figure in _LEVELS.items():
        old, new = (_shown(some.get(key), figure.percent) for some in (before["figures"], numbers))
        level, mark = _level(key, numbers), _mark(key, numbers)
        yield f"| {figure.words} | {level} | {old} | {new} | {mark} |"
    yield ""
    yield "### Records of others\n"
    yield "A `?` marks what is known and was not told, `OFF` a value beyond 3 standard deviations,"
    yield "`std` a stated uncertainty of 0 or above 3 times the known one.\n"
    now = {t["record"]: _real_words(judge_real(t["known"], e)) for t, e in rows
           if t["part"] == "R"}  # fmt: skip
    heads = ["names", "orders", "must not", "other names", "parameters", "unexplained", "held out",
             "s"]  # fmt: skip
    yield "| record | engine | " + " | ".join(heads) + " |"
    yield "|---" * (len(heads) + 2) + "|"
    for record in sorted({*now, *before["real"]}):
        for engine, table in (("before", before["real"]), ("now", now)):
            if record in table:
                cells = " | ".join(table[record][head] for head in heads)
                yield f"| {record} | {engine} | {cells} |"
    yield ""
