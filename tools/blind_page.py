"""The benchmark's page as text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

from blind_words import HOW, LIMITS, METRICS
from scorer.levels import LEVELS, interval, most_by_chance

__all__ = ["page"]


def _number(value: float | None, percent: bool) -> str:
    if value is None:
        return "-"
    return f"{100.0 * value:.1f} %" if percent else f"{value:.2f}"


def _verdict(level: Any, value: float | None) -> str:
    if value is None:
        return "not measured"
    needed, aim = level.holds(value, level.needed), level.holds(value, level.aim)
    if needed is False:
        return "**missed**"
    if aim is False:
        return "pass, aim missed"
    return "-" if needed is None and aim is None else "pass"


def _levels(numbers: dict[str, Any]) -> Iterable[str]:
    shares = {level.key for level in LEVELS} - {"gain_d10_up", "gain_physical"}
    yield "| figure | pass level | aim | measured (95 % interval) | records | |"
    yield "|---|---|---|---|---|---|"
    for level in LEVELS:
        value, count = numbers.get(level.key, (None, 0))
        sign = "<=" if level.low else ">="
        limits = [
            "-" if limit is None else f"{sign} {_number(limit, level.percent)}"
            for limit in (level.needed, level.aim)
        ]
        shown = _number(value, level.percent)
        if value is not None and level.percent and level.key in shares:
            low, high = interval(value, count)
            shown += f" ({100.0 * low:.1f}-{100.0 * high:.1f})"
        yield (
            f"| {level.words} | {limits[0]} | {limits[1]} | {shown} | {count} "
            f"| {_verdict(level, value)} |"
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
    yield "| bad data | flagged, named or refused | names given, per record | crashes |"
    yield "|---|---|---|---|"
    for fault, entry in numbers["faults"].items():
        names = entry["wrong_names"][0]
        flagged, crashed = _share(entry["flagged"]), _share(entry["no_answer"])
        yield f"| {fault} | {flagged} | {names:.2f} | {crashed} |"


def _machine(numbers: dict[str, Any]) -> Iterable[str]:
    yield "| record | records | s, median | s, longest | MB, most |"
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


def _counts(rows: list[Any], numbers: dict[str, Any]) -> Iterable[str]:
    for kind, rate in (("white", 0.01), ("coloured", 0.016)):
        value, count = numbers[f"false_alarms_{kind}"]
        if count:
            yield (
                f"Clean records, {kind} noise: {round(value * count)} alarms in {count}; chance "
                f"passes {most_by_chance(count, rate)} in 0.2 % of campaigns at a rate of "
                f"{100.0 * rate:g} %."
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
) -> str:
    """Return the page: figures beside pass levels and aims, failures included."""
    chance = shuffled["score"][0], shuffled["name_d10"][0], shuffled["name_d20"][0]
    parts = [
        f"# Blind benchmark\n\nhdbench {version}, {day}: {len(rows)} records of dynamic runs and "
        f"{len(loads)} calibrations. Written by `tools/blind.py --report FOLDER --write` from the "
        "sealed truths and the answers; nothing on this page is entered by hand.\n",
        "## Figures\n",
        *_levels(numbers),
        "",
        *_counts(rows, numbers),
        "",
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
        f"Truth shuffled within each part: S {_number(chance[0], False)}, name at 10 sigma "
        f"{_number(chance[1], True)}, at 20 sigma {_number(chance[2], True)}.\n",
        *(_rivals(rivals) if rivals else ["No other method was run on these records."]),
        "",
        "## Time and memory\n",
        *_machine(numbers),
        "",
        HOW,
        METRICS,
        LIMITS,
    ]
    return "\n".join(parts)


def _short(numbers: dict[str, Any]) -> dict[str, Any]:
    """Keep what a calibration can have: no two effects, no duels, no oracle."""
    keys = ("false", "detection", "name", "cover", "set_size", "wrong", "phantoms", "physical",
            "calibration", "crashes", "refusals")  # fmt: skip
    return {key: value for key, value in numbers.items() if key.startswith(keys)}
