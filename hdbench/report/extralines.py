"""Lines and tones that a run shows beside the orders that its evaluation looks for."""

from __future__ import annotations

from hdbench.report.numbers import probability, short, with_std
from hdbench.report.pagemodel import Table, Verdict
from hdbench.results import MisalignmentResult, RippleResult


def extra_line_words(result: MisalignmentResult | RippleResult) -> str:
    """Return each line and tone with its place and size; nothing where there is none."""
    words = [
        f"{with_std(x.amplitude_nm)} N·m at motor order {short(x.order)}" for x in result.lines
    ]
    words += [f"{with_std(x.amplitude_nm)} N·m at {short(x.frequency_hz)} Hz" for x in result.tones]
    return "; ".join(words)


def with_extra_lines(verdict: Verdict, result: MisalignmentResult | RippleResult) -> Verdict:
    """Return a verdict that says when more stands out than was looked for."""
    words = extra_line_words(result)
    if not words:
        return verdict
    level = "look" if verdict.level == "good" else verdict.level
    return Verdict(level, f"{verdict.text} More stands out ({words}): diagnose this run.")


def extra_line_tables(result: MisalignmentResult | RippleResult) -> tuple[Table, ...]:
    """Return the table of lines and tones; empty where there are none."""
    return Table.filled(
        Table.of(
            "Beyond the known orders",
            (
                ("motor order", "order"),
                ("frequency (Hz)", "frequency_hz"),
                ("amplitude (N·m)", "amplitude_nm"),
                ("false-alarm probability", "false_alarm_probability", probability),
            ),
            (*result.lines, *result.tones),
            "Found in the residual of the evaluation and fitted together with the rest.",
        )
    )
