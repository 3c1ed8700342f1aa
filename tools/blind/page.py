"""Page of the benchmark as text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from null import table
from scorer.levels import LEVELS, counted, interval
from scorer.tables import one_line

__all__ = ["page"]

# how the records are made and judged, in words
METHOD = Path(__file__).with_name("method.md")
# percentages that are no share of records
_NO_SHARES = ("gain_d10_up", "gain_physical")
# kinds of failure that the page lists one by one, and how many of each at most
_LISTED = 40


def _number(value: float | None, percent: bool) -> str:
    if value is None:
        return "-"
    return f"{100.0 * value:.1f} %" if percent else f"{value:.2f}"


def _within_chance(level: Any, value: float, count: int) -> bool:
    """Whether a figure beyond its pass level is what chance does to one that keeps it."""
    limit = counted(level, count) if level.key not in _NO_SHARES else None
    if limit is None:
        return False
    return value * count <= limit + 0.5 if level.low else value * count >= limit - 0.5


def _verdict(level: Any, value: float | None, count: int) -> str:
    if value is None:
        return "not measured"
    needed, aim = level.holds(value, level.needed), level.holds(value, level.aim)
    if needed is False:
        return "missed, within chance" if _within_chance(level, value, count) else "**missed**"
    if aim is False:
        return "pass, aim missed"
    return "-" if needed is None and aim is None else "pass"


def _count(level: Any, value: float | None, count: int) -> str:
    """Return events of records, and the number up to which chance explains them."""
    if value is None or not level.percent or level.key in _NO_SHARES:
        return str(count)
    limit = counted(level, count)
    told = "" if limit is None else f" ({'<=' if level.low else '>='} {limit})"
    return f"{round(value * count)} of {count}{told}"


def _levels(numbers: dict[str, Any]) -> Iterable[str]:
    yield "| figure | pass level | aim | measured (95 % interval) | count (flake-safe) | |"
    yield "|---|---|---|---|---|---|"
    for level in LEVELS:
        value, count = numbers.get(level.key, (None, 0))
        sign = "<=" if level.low else ">="
        limits = [
            "-" if limit is None else f"{sign} {_number(limit, level.percent)}"
            for limit in (level.needed, level.aim)
        ]
        shown = _number(value, level.percent)
        if value is not None and level.percent and level.key not in _NO_SHARES:
            low, high = interval(value, count)
            shown += f" ({100.0 * low:.1f}-{100.0 * high:.1f})"
        yield (
            f"| {level.words} | {limits[0]} | {limits[1]} | {shown} "
            f"| {_count(level, value, count)} | {_verdict(level, value, count)} |"
        )


def _share(cell: tuple[float | None, int]) -> str:
    value, count = cell
    return "-" if value is None else f"{round(value * count)}/{count}"


def _families(table: dict[str, Any]) -> Iterable[str]:
    yield (
        "| hidden | 5-7 sigma: detected | exact | in set | 10-20 sigma: detected | exact | in set "
        "| wrong, no rivals | physical: detected | exact | in set | wrong, no rivals |"
    )
    yield "|---|---|---|---|---|---|---|---|---|---|---|---|"
    for name, (weak, strong, physical) in table.items():
        cells = [*weak[:3], *strong, *physical]
        yield f"| {name} | " + " | ".join(map(_share, cells)) + " |"


def _outside(table: dict[str, Any]) -> Iterable[str]:
    yield "| hidden | alarm | right domain | name with free place | wrong, no rivals | mostly |"
    yield "|---|---|---|---|---|---|"
    for name, (alarm, right, free, wrong, said) in table.items():
        words = "; ".join(f"{text} ({count})" for text, count in said)
        cells = " | ".join(map(_share, (alarm, right, free, wrong)))
        yield f"| {name} | {cells} | {words} |"


def _faults(numbers: dict[str, Any]) -> Iterable[str]:
    yield "| bad data | told by its own name | flagged, named or refused | other causes, per record | crashes |"  # noqa: E501
    yield "|---|---|---|---|---|"
    for fault, entry in numbers["faults"].items():
        names, own = entry["wrong_names"][0], _share(entry["own_name"])
        if fault == "noisy-load-cell":
            own = "no fault"
        flagged, crashed = _share(entry["flagged"]), _share(entry["no_answer"])
        yield f"| {fault} | {own} | {flagged} | {names:.2f} | {crashed} |"


def _machine(numbers: dict[str, Any]) -> Iterable[str]:
    yield "| record | records | s of one core, median | longest | MB, most |"
    yield "|---|---|---|---|---|"
    for record, (middle, longest, memory, count) in numbers["machine"].items():
        yield f"| {record} | {count} | {middle:.1f} | {longest:.1f} | {memory:.0f} |"


def _rivals(rivals: dict[str, Any]) -> Iterable[str]:
    keys = ("false_alarms_white", "false_alarms_coloured", "name_d5", "name_d7", "name_d10",
            "name_d20", "both_d10", "both_d15")  # fmt: skip
    yield "| method | records | S | " + " | ".join(key.replace("_", " ") for key in keys) + " |"
    yield "|---" * (len(keys) + 3) + "|"
    for method, numbers in rivals.items():
        score, count = numbers["score"]
        shown = " | ".join(_number(numbers[key][0], True) for key in keys)
        yield f"| {method} | {count} | {_number(score, False)} | {shown} |"


def _counts(rows: list[Any]) -> Iterable[str]:
    yield (
        "Counts in brackets are flake-safe: a tool that just keeps the pass level (clean records: "
        "1 % of white, 1.6 % of coloured) breaks them in 0.2 % of campaigns."
    )
    parts = Counter(row.truth["part"] for row in rows)
    yield "Records by part: " + ", ".join(f"{k} {v}" for k, v in sorted(parts.items())) + "."


def page(
    *,
    version: str,
    day: str,
    rows: list[Any],
    numbers: dict[str, Any],
    families: dict[str, Any],
    outside: dict[str, Any],
    loads: list[Any],
    load_numbers: dict[str, Any],
    load_families: dict[str, Any],
    shuffled: dict[str, Any],
    rivals: dict[str, Any],
    null: list[Any],
    wide: list[str],
) -> str:
    """Return the page: figures beside pass levels and aims, failures included."""
    chance = shuffled["score"][0], shuffled["name_d10"][0], shuffled["name_d20"][0]
    parts = [
        f"# Blind benchmark\n\nhdbench {version}, {day}: {len(rows)} records of dynamic runs and "
        f"{len(loads)} calibrations. Written by `python tools/blind --report FOLDER --write` from "
        "the sealed truths and the answers; nothing on this page is entered by hand.\n",
        "## Figures\n",
        *_levels(numbers),
        "",
        *_counts(rows),
        "",
        *wide,
        "## By family\n",
        *_families(families),
        "",
        "![Hidden against answered](images/blind-confusion.png)\n",
        "## Outside the catalogue\n",
        *_outside(outside),
        "",
        "## Bad data\n",
        *_faults(numbers),
        "",
        "## Calibration loads\n",
        *(_levels(_short(load_numbers)) if loads else ["No calibration was diagnosed."]),
        "",
        *(_families(load_families) if loads else []),
        "",
        "## Controls and other methods\n",
        f"Truth shuffled within each part (must fall to chance, 1 of 40): S "
        f"{_number(chance[0], False)}, name at 10 sigma {_number(chance[1], True)}, at 20 sigma "
        f"{_number(chance[2], True)}. An oracle that is told the names has S 1.00, one that is "
        "always silent 0.00.\n",
        *(_rivals(rivals) if rivals else ["No other method was run on these records."]),
        "",
        "## Records that failed\n",
        *_failures([*rows, *loads]),
        "",
        "## The null against full simulations\n",
        "Short clean records (8 s), the whole diagnosis on each: "
        "`python tools/blind/null.py --out FOLDER`.\n",
        *(table(null, null[0]["alpha"])[0] if null else ["Not run with this campaign."]),
        "",
        "## Time and memory\n",
        *_machine(numbers),
        "",
        METHOD.read_text(),
    ]
    return "\n".join(parts)


def _failures(rows: list[Any]) -> Iterable[str]:
    """List every false alarm, wrong certain name, crash and refusal with what was answered."""
    kinds = {
        "false alarms": lambda r: r.truth["part"] in "AL" and not r.truth["hidden"]
        and r.verdict.alarm,
        "wrong names without rivals": lambda r: r.verdict.wrong_certain and r.truth["hidden"],
        "missed at 10 sigma and more": lambda r: r.tier in ("d10", "d15", "d20")
        and r.verdict.answered and not r.verdict.alarm,
        "no answer": lambda r: "crashed" in r.entry or "refused" in r.entry,
    }  # fmt: skip
    for words, chosen in kinds.items():
        lines = sorted(one_line(*row) for row in rows if chosen(row))
        yield f"{words}: {len(lines)}"
        if lines:
            more = len(lines) - _LISTED
            lines = [line.rsplit(" | ", 2)[0] for line in lines[:_LISTED]]
            yield (
                "\n```\n" + "\n".join(lines) + (f"\n... {more} more" if more > 0 else "") + "\n```"
            )
        yield ""


def _short(numbers: dict[str, Any]) -> dict[str, Any]:
    """Keep what a calibration can have: no two effects, no duels, no oracle."""
    keys = ("false", "detection", "name", "cover", "set_size", "wrong", "phantoms", "physical",
            "calibration", "crashes", "refusals")  # fmt: skip
    return {key: value for key, value in numbers.items() if key.startswith(keys)}
