"""`hdbench inspect`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hdbench.diagnosis.inspection import inspect_log, read_log
from hdbench.errors import LimitError
from hdbench.records import resolve_input
from hdbench.records.provenance import input_identity
from hdbench_cli.inputs import choose_profile
from hdbench_cli.output import Output
from hdbench_cli.text import Lines, styled

# channels that are told of one kind of finding: --json has them all
_SHOWN = 3


def inspect_command(
    output: Output,
    source: Path,
    topic: str | None,
    joint: str | None,
    profile_name: str | None,
    check: bool,
) -> None:
    """Say what a log can tell: sampling, bandwidth, resolution, origin and delay of channels."""
    profile = choose_profile(profile_name, None)
    file = resolve_input(source) if (source / "run.json").is_file() else source
    log = read_log(file, topic=topic, joint=joint)
    found = inspect_log(log, profile.data)
    identity = input_identity(file) if file.is_file() else {"path": str(file)}
    body = {"input": identity, **found.to_dict()}
    output.result(body, _lines(body), kind="inspect", profile=profile)
    if check and found.findings:
        output.end(
            LimitError(
                f"{len(found.findings)} findings; needed: none",
                where=str(source),
                fix="record again without them, or leave --check out",
            )
        )


def _number(value: float | None, form: str = "{:.4g}") -> str:
    return "-" if value is None else form.format(value)


def _lines(body: Mapping[str, Any]) -> Lines:
    """Yield the inspection on one screen: stamps, channels, motion, findings."""
    stamps = body["sampling"]
    if stamps["median_s"] is None:
        yield f"sampling   {stamps['rows']} rows without a time"
    else:
        yield (
            f"sampling   {stamps['rows']} rows, {stamps['span_s']:.6g} s, "
            f"{stamps['rate_hz']:.6g} Hz, jitter {100.0 * stamps['jitter_share']:.2g} %, "
            f"{len(stamps['gaps'])} gaps"
        )
    width = min(max(len(one["name"]) for one in body["channels"]), 40)
    head = (
        f"{'rate':>9} {'bandwidth':>10} {'resolution':>11} {'noise':>10} {'missing':>8} {'held':>6}"
    )
    yield f"{'channel':<{width}} {'unit':<6} {head}"
    for one in body["channels"]:
        yield (
            f"{one['name']:<{width}} {one['unit'] or '-':<6} "
            f"{_number(one['rate_hz']):>9} {_number(one['bandwidth_hz']):>10} "
            f"{_number(one['resolution'], '{:.3g}'):>11} {_number(one['noise'], '{:.2g}'):>10} "
            f"{100.0 * one['missing_share']:>7.3g}% {100.0 * one['held_share']:>5.3g}%"
        )
    yield from _motion(body["coverage"])
    yield from body["notes"]
    count = len(body["findings"])
    yield styled((f"findings: {count}" if count else "Nothing found.", "bold"))
    yield from finding_lines(body["findings"])


def _motion(moved: Mapping[str, Any] | None) -> Iterator[str]:
    if moved is None:
        return
    low, high = moved["velocity"]
    turns = "" if moved["turns"] is None else f", {moved['turns']:.4g} turns"
    yield (
        f"motion     {low:.4g} to {high:.4g} {moved['unit'] or '(no unit)'}, "
        f"{moved['reversals']} reversals, {100.0 * moved['rest_share']:.3g} % at rest{turns}"
    )
    for one in moved["limits"]:
        yield f"  {one['name']}: {one['detail']}; {one['consequence']}"


def finding_lines(findings: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return one line for each kind of finding, with the channels that it is about."""
    kinds: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for one in findings:
        kinds.setdefault((one["name"], one["consequence"]), []).append(one)
    lines = []
    for (name, consequence), alike in kinds.items():
        told = [
            f"{one['channel']} {one['detail']}" if one["channel"] else str(one["detail"])
            for one in alike[:_SHOWN]
        ]
        more = f" and {len(alike) - _SHOWN} more" if len(alike) > _SHOWN else ""
        lines.append(f"{name}: {'; '.join(told)}{more}. So {consequence}")
    return lines
