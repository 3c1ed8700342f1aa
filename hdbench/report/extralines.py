"""Lines and tones that a run shows beside the orders that its evaluation looks for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdbench.report.numbers import probability, short, with_std
from hdbench.report.pagemodel import Table, Verdict, filled, make_table

__all__ = ["extra_line_tables", "extra_line_words", "with_extra_lines"]


def extra_line_words(result: Mapping[str, Any]) -> str:
    """Return each line and tone with its place and size; nothing where there is none."""
    places = [(x, f"motor order {short(float(x['order']))}") for x in result.get("lines", ())]
    places += [(x, f"{short(float(x['frequency_hz']))} Hz") for x in result.get("tones", ())]
    return "; ".join(
        f"{with_std(line['amplitude_nm'])} N·m at {place}" if "amplitude_nm" in line else place
        for line, place in places
    )


def with_extra_lines(verdict: Verdict, result: Mapping[str, Any]) -> Verdict:
    """Return a verdict that says when more stands out than was looked for."""
    words = extra_line_words(result)
    if not words:
        return verdict
    level = "look" if verdict.level == "good" else verdict.level
    return Verdict(level, f"{verdict.text} More stands out ({words}): diagnose this run.")


def extra_line_tables(result: Mapping[str, Any]) -> tuple[Table, ...]:
    """Return the table of lines and tones; empty where there are none."""
    return filled(
        make_table(
            "Beyond the known orders",
            (
                ("motor order", lambda line: line.get("order")),
                ("frequency (Hz)", lambda line: line.get("frequency_hz")),
                ("amplitude (N·m)", lambda line: line.get("amplitude_nm")),
                (
                    "false-alarm probability",
                    lambda line: line.get("false_alarm_probability"),
                    probability,
                ),
            ),
            (*result.get("lines", ()), *result.get("tones", ())),
            "Found in the residual of the evaluation and fitted together with the rest.",
        )
    )
