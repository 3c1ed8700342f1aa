"""`hdbench runs`: list, show, note on, verify, resume and compare run folders."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hdbench_cli.commands.runs_compare import compare
from hdbench_cli.commands.runs_list import list_, note
from hdbench_cli.next_step import after_run, next_line
from hdbench_cli.options import declared
from hdbench_cli.output import Output
from hdbench_cli.text import with_uncertainty

if TYPE_CHECKING:
    from rich.text import Text

    from hdbench.records import VerifyReport

# characters of a hash that tell two files apart at a glance; --json has all
_HASH = 12
_EXPERIMENTS = ("calibration", "misalignment", "ripple")


@click.group(name="runs", epilog="Example: hdbench runs verify runs/*")
def command() -> None:
    """List, show, note on, verify, resume and compare run folders."""


@declared("runs show")
def show(output: Output, run: Path) -> None:
    """Show the entries of a run: kind, status, times, profile, drive, verdict."""
    from hdbench.records import RunFolder, read_notes

    folder = RunFolder.open(run)
    notes = [asdict(one) for one in read_notes(run)]
    body = {**folder.manifest, "status": folder.status(), "notes": notes}
    output.result(body, lambda body: _shown(body, run))


def _shown(body: Mapping[str, Any], run: Path) -> Iterator[str]:
    yield from (f"{name:13}{words}" for name, words in _properties(body) if words)
    yield next_line(_then(body, shlex.quote(str(run)), run))


def _properties(body: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the entries of a run, by name."""
    yield "run", str(body.get("run_id", ""))
    yield "kind", str(body.get("kind", ""))
    ended = f", {body['exit_reason']}" if body.get("exit_reason") else ""
    yield "status", f"{body.get('status', '')}{ended}"
    yield "started", str(body.get("started_utc", ""))
    yield "ended", str(body.get("ended_utc") or "not yet")
    profile = _table(body, "profile")
    yield "profile", f"{profile.get('name', '')}, SHA-256 {_short(profile.get('sha256'))}"
    yield "drive", str(body.get("drive") or "")
    yield "sensor", str(body.get("sensor") or "")
    gain = _table(body, "calibration")
    value = _table(gain, "gain_nm_per_v")
    if value.get("value") is not None:
        known = value.get("std") is not None
        words = with_uncertainty(value, "N m/V") if known else f"{value['value']:.6g} N m/V"
        yield "gain", f"{words}, {gain.get('source')}"
    yield "device", _pairs(_table(body, "device"))
    yield "versions", _pairs(_table(body, "versions"))
    yield "filter", str(_table(body, "filter").get("name", ""))
    details = _table(body, "details")
    for step in _table(details, "plan").get("steps", ()):
        yield "plan", str(step)
    yield "simulation", _pairs(_table(details, "simulation"))
    for one in body.get("notes", ()):
        yield "note", f"{one['utc'][:19]}Z  {one['text']}"
    for name, digest in _table(body, "files").items():
        yield "file", f"{name}, SHA-256 {_short(digest)}"


def _table(body: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    found = body.get(key)
    return found if isinstance(found, Mapping) else {}


def _short(digest: object) -> str:
    return str(digest or "unknown")[:_HASH]


def _pairs(table: Mapping[str, Any]) -> str:
    words = {True: "yes", False: "no"}
    return ", ".join(
        f"{key} {words[value] if isinstance(value, bool) else value}"
        for key, value in table.items()
    )


def _then(body: Mapping[str, Any], name: str, run: Path) -> str:
    """Return the next useful command."""
    if body.get("status") == "incomplete":
        return f"hdbench runs resume {name}"
    if body.get("status") == "complete" and body.get("kind") in _EXPERIMENTS:
        return after_run(str(body["kind"]), run, {})
    return f"hdbench report {name} --out report.html"


@declared("runs verify")
def verify(output: Output, runs: tuple[Path, ...], recover: bool) -> int:
    """Read runs in full and compare them with their hashes; exit 4 if one is invalid."""
    from hdbench.records import result_header, verify_runs

    reports = verify_runs(runs, recover=recover)
    ok = all(report.ok for report in reports)
    told = [report.to_dict() for report in reports]
    body = {**result_header("verify", None), "ok": ok, "runs": told}
    output.result(body, lambda _body: _checks(runs, reports))
    return 0 if ok else 4


def _checks(runs: Sequence[Path], reports: Sequence[VerifyReport]) -> Iterator[str | Text]:
    from rich.text import Text

    for run, report in zip(runs, reports, strict=True):
        word = ("ok", "green") if report.ok else ("INVALID", "bold red")
        yield Text.assemble(
            word,
            f" {report.run_id}: {report.status}, {report.files_checked} files checked, "
            f"{report.samples_in_journal} samples and {report.readings_in_journal} readings "
            "acknowledged",
        )
        yield from (f"  {problem}" for problem in report.problems)
        if report.torn_bytes:
            yield f"  {report.torn_bytes} bytes at the end were never acknowledged"
        if report.recoverable:
            recover = f"hdbench runs verify --recover {shlex.quote(str(run))}"
            yield f"  its data can be recovered: {recover}"


@declared("runs resume", "run address control yes no_input check no_report realtime who mistakes")
def resume(output: Output, /, run: Path, realtime: bool, **options: Any) -> None:
    """Go on with a run that was stopped, killed, or lost its bench, in the same folder.

    A calibration goes on at the weight where it stopped; what was accepted is not asked again. A
    run with motion keeps every acquisition that came to its end; one that was broken off is taken
    again from standstill, its first samples kept beside it.
    """
    from hdbench_cli.commands.experiment import resume as go_on

    # without the option the bench keeps time as it did before
    go_on(output, run, realtime=realtime or None, **options)


for child in (show, verify, resume, list_, note, compare):
    command.add_command(child)
