"""Lines and tones that a run shows beyond what its evaluation looks for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdbench.report.elements import Table, Verdict
from hdbench.report.numbers import plain, probability, short, with_std

__all__ = ["beyond_tables", "beyond_words", "with_beyond"]


def beyond_words(result: Mapping[str, Any]) -> list[str]:
    """Return each line and tone beyond the known orders as a few words."""
    lines = [
        (line, f"motor order {short(float(line['order']))}") for line in result.get("lines", ())
    ]
    tones = [(t, f"{short(float(t['frequency_hz']))} Hz") for t in result.get("tones", ())]
    return [
        f"{with_std(body['amplitude_nm'])} N·m at {place}" if "amplitude_nm" in body else place
        for body, place in lines + tones
    ]


def with_beyond(verdict: Verdict, result: Mapping[str, Any]) -> Verdict:
    """Return a verdict that says when more stands out than was looked for."""
    words = beyond_words(result)
    if not words:
        return verdict
    level = "look" if verdict.level == "good" else verdict.level
    text = f"{verdict.text} More stands out ({'; '.join(words)}): diagnose this run."
    return Verdict(level, text)


def beyond_tables(result: Mapping[str, Any]) -> tuple[Table, ...]:
    """Return the table of lines and tones beyond the known orders; empty where there are none."""
    rows = tuple(
        (
            plain(line.get("order")),
            plain(line.get("frequency_hz")),
            plain(line.get("amplitude_nm")),
            probability(line.get("false_alarm_probability")),
        )
        for line in (*result.get("lines", ()), *result.get("tones", ()))
    )
    if not rows:
        return ()
    head = ("motor order", "frequency (Hz)", "amplitude (N·m)", "false-alarm probability")
    note = "Found in the residual of the evaluation and fitted together with the rest."
    return (Table("Beyond the known orders", head, rows, note),)
