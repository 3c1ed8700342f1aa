"""`hdbench inspect`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hdbench_cli.options import profile_option
from hdbench_cli.output import Output
from hdbench_cli.parameters import StoredPath

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["command", "finding_lines"]

# channels that are told of one kind of finding: --json has them all
_SHOWN = 3


@click.command(
    "inspect", epilog="Examples: hdbench inspect trace.csv; hdbench inspect runs/RUN --json"
)
@click.argument("source", metavar="FILE_OR_RUN", type=StoredPath())
@click.option("--topic", metavar="NAME", help="Topic, sheet or group of channels to look at.")
@click.option("--joint", metavar="NAME", help="Joint to look at: a name, or the number behind q_.")
@profile_option
@click.option("--check", is_flag=True, help="Exit 3 unless nothing was found.")
@click.pass_obj
def command(
    output: Output,
    source: Path,
    topic: str | None,
    joint: str | None,
    profile_name: str | None,
    check: bool,
) -> None:
    """Say what a log can tell: sampling, bandwidth, resolution, origin and delay of channels.

    Takes a trace, a run folder, or a file of any format that the import reads. Nothing is repaired.
    """
    from hdbench.diagnosis.inspection import inspect_log, read_log
    from hdbench.errors import LimitError
    from hdbench.profile import load_profile
    from hdbench.records import resolve_input, result_header
    from hdbench.records.provenance import input_identity

    profile = load_profile(profile_name or "cim-tr-97-06")
    file = resolve_input(source) if (source / "run.json").is_file() else source
    log = read_log(file, topic=topic, joint=joint)
    found = inspect_log(log, profile.data)
    identity = input_identity(file) if file.is_file() else {"path": str(file)}
    body = {**result_header("inspect", profile), "input": identity, **found.to_dict()}
    output.result(body, lambda console: _show(console, body))
    if check and found.findings:
        error = LimitError(
            f"{len(found.findings)} findings; needed: none",
            where=str(source),
            fix="record again without them, or leave --check out",
        )
        if not output.json:
            raise error
        output.note(str(error))
        raise click.exceptions.Exit(error.exit_code)


def _number(value: float | None, form: str = "{:.4g}") -> str:
    return "-" if value is None else form.format(value)


def _show(console: Console, body: Mapping[str, Any]) -> None:
    """Draw the inspection on one screen: stamps, channels, motion, findings."""
    stamps, lines = body["sampling"], []
    if stamps["median_s"] is None:
        lines.append(f"sampling   {stamps['rows']} rows without a time")
    else:
        lines.append(
            f"sampling   {stamps['rows']} rows, {stamps['span_s']:.6g} s, "
            f"{stamps['rate_hz']:.6g} Hz, jitter {100.0 * stamps['jitter_share']:.2g} %, "
            f"{len(stamps['gaps'])} gaps"
        )
    width = min(max(len(one["name"]) for one in body["channels"]), 40)
    head = (
        f"{'rate':>9} {'bandwidth':>10} {'resolution':>11} {'noise':>10} {'missing':>8} {'held':>6}"
    )
    lines.append(f"{'channel':<{width}} {'unit':<6} {head}")
    for one in body["channels"]:
        lines.append(
            f"{one['name']:<{width}} {one['unit'] or '-':<6} "
            f"{_number(one['rate_hz']):>9} {_number(one['bandwidth_hz']):>10} "
            f"{_number(one['resolution'], '{:.3g}'):>11} {_number(one['noise'], '{:.2g}'):>10} "
            f"{100.0 * one['missing_share']:>7.3g}% {100.0 * one['held_share']:>5.3g}%"
        )
    moved = body["coverage"]
    if moved is not None:
        low, high = moved["velocity"]
        turns = "" if moved["turns"] is None else f", {moved['turns']:.4g} turns"
        lines.append(
            f"motion     {low:.4g} to {high:.4g} {moved['unit'] or '(no unit)'}, "
            f"{moved['reversals']} reversals, {100.0 * moved['rest_share']:.3g} % at rest{turns}"
        )
        lines += [
            f"  {one['name']}: {one['detail']}; {one['consequence']}" for one in moved["limits"]
        ]
    lines += body["notes"]
    for line in lines:
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    console.print(
        f"findings: {len(body['findings'])}" if body["findings"] else "Nothing found.",
        style="bold",
        markup=False,
    )
    for line in finding_lines(body["findings"]):
        console.print(line, markup=False, highlight=False, soft_wrap=True)


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
