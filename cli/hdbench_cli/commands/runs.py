"""`hdbench runs`: list, show, note on, verify and compare run folders."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from hdbench.errors import DataError, LimitError, UsageError
from hdbench.records import (
    RunFolder,
    RunSummary,
    VerifyReport,
    add_note,
    list_runs,
    read_notes,
    select_runs,
    verify_runs,
    write_atomic,
)
from hdbench.records.csvtext import csv_text, safe_cell
from hdbench.records.runfolder import utc_now
from hdbench_cli.inputs import refuse_same_csv
from hdbench_cli.next_step import after_run, next_line
from hdbench_cli.output import Output
from hdbench_cli.text import Lines, styled, table, with_uncertainty

# characters of a hash that tell two files apart at a glance; --json has all
_HASH = 12
_EXPERIMENTS = ("calibration", "misalignment", "ripple")
# options that choose runs by their properties
_FILTERS = ("kind", "profile", "status", "verdict", "drive", "sensor")
_COLUMNS = ("run_id", *(entry.name for entry in fields(RunSummary) if entry.name != "files"))
_ANSWERS = {
    "moved": ("MOVED", "bold red"),
    "within-uncertainty": ("within uncertainty", "green"),
    "cannot-tell": ("cannot tell", "yellow"),
}
# keys shown on the screen: the rest is in --json
_MOST_KEYS = 8


def chosen_runs(parent: Path, options: dict[str, Any]) -> list[RunSummary]:
    """Return the runs in a folder that the filter options choose."""
    typed = click.get_current_context().get_parameter_source("parent")
    if not parent.is_dir() and typed is not ParameterSource.DEFAULT:
        raise DataError(
            "no such folder", where=str(parent), fix="name the folder that --out of the runs named"
        )
    wanted = {name: options[name] for name in _FILTERS}
    return select_runs(list_runs(parent), wanted, options["since"])


def _key(run: RunSummary, name: str) -> str:
    if name == "run":
        return run.path.name
    return str(getattr(run, "started_utc" if name == "started" else name))


def list_command(
    output: Output, /, parent: Path, sort: str, reverse: bool, csv_file: str | None, **options: Any
) -> None:
    """List the runs in a folder, oldest first."""
    if csv_file == "-" and output.json:
        raise UsageError("both want stdout", where="--csv, --json", fix="give --csv a file")
    runs = sorted(chosen_runs(parent, options), key=lambda run: _key(run, sort), reverse=reverse)
    if csv_file is not None:
        _write_csv(csv_file, runs)
        if csv_file == "-":
            return
    output.result({"runs": [run.to_dict() for run in runs]}, _lines(parent, runs), kind="runs")


def _lines(parent: Path, runs: list[RunSummary]) -> str:
    if not runs:
        return f"no such runs in {parent.resolve()}\n{next_line('hdbench demo')}\n"
    lines = (
        f"{r.path}  {r.status:10}  {r.verdict:13}  {r.profile}  {r.drive:8}  {r.exit_reason}"
        for r in runs
    )
    return "".join(f"{line.rstrip()}\n" for line in lines)


def _write_csv(file: str, runs: list[RunSummary]) -> None:

    bodies = (run.to_dict() for run in runs)
    text = csv_text(_COLUMNS, ([safe_cell(body[name]) for name in _COLUMNS] for body in bodies))
    if file == "-":
        click.echo(text, nl=False)
    else:
        write_atomic(Path(file), text.encode())


def note_command(output: Output, run: Path, text: str) -> None:
    """Note on a run what was done before it, such as service or a new clamping."""
    add_note(run, text, utc_now())
    notes = [asdict(one) for one in read_notes(run)]
    output.result(
        {"run": str(run), "notes": notes},
        [f"{n['utc'][:19]}Z  {n['text']}" for n in notes],
        kind="notes",
    )


def show_command(output: Output, run: Path) -> None:
    """Show the entries of a run: kind, status, times, profile, drive, verdict."""
    folder = RunFolder.open(run)
    notes = [asdict(one) for one in read_notes(run)]
    body = {**folder.manifest, "status": folder.status(), "notes": notes}
    output.result(body, _shown(body, run))


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


def verify_command(output: Output, runs: tuple[Path, ...], recover: bool) -> int:
    """Read runs in full and compare them with their hashes; exit 4 if one is invalid."""
    reports = verify_runs(runs, recover=recover)
    ok = all(report.ok for report in reports)
    told = [report.to_dict() for report in reports]
    output.result({"ok": ok, "runs": told}, _checks(runs, reports), kind="verify")
    return 0 if ok else 4


def _checks(runs: Sequence[Path], reports: Sequence[VerifyReport]) -> Lines:
    for run, report in zip(runs, reports, strict=True):
        word = ("ok", "green") if report.ok else ("INVALID", "bold red")
        yield styled(
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


def compare_command(
    output: Output,
    a: Path,
    b: Path,
    same_origin: bool,
    independent: bool,
    confidence: float,
    check: bool,
    csv_file: Path | None,
    html_file: Path | None,
) -> None:
    """Compare two runs of one kind: B minus A, in units of its uncertainty."""
    from hdbench.comparison import compare_runs, comparison_csv

    refuse_same_csv(csv_file, html_file)
    found = compare_runs(
        a, b, confidence=confidence, same_origin=same_origin, independent=independent
    )
    body = found.to_dict()
    files: dict[str, str] = {}
    if csv_file is not None:
        write_atomic(csv_file, comparison_csv(found).encode())
        files["csv"] = str(csv_file)
    if html_file is not None:
        from hdbench.report.comparison import write_comparison

        files["html"] = str(write_comparison(body, html_file).html)
    body["files"] = files
    output.result(body, _compared(body))
    if check and found.verdict != "within-uncertainty":
        output.end(
            LimitError(
                f"{body['verdict'].replace('-', ' ')}: {body['sentence']}",
                where=f"{body['a']['path']}, {body['b']['path']}",
                fix="look at the differences of profile and environment, then measure again",
            )
        )


def _compared(body: Mapping[str, Any]) -> Lines:
    """Yield a comparison on one screen."""
    word, style = _ANSWERS[body["verdict"]]
    yield styled((f"{word}  ", style), body["sentence"])
    for side in ("a", "b"):
        one = body[side]
        when = f", measured {one['measured_utc'][:19]}Z" if one["measured_utc"] else ""
        doubts = [*one["doubts"], *one["flags"]]
        doubtful = f", doubtful: {'; '.join(doubts)}" if doubts else ""
        yield f"{side.upper()}  {one['run_id']}{when}{doubtful}"
    yield from _quantities(body["quantities"])
    if body["orders"] is not None:
        yield from _orders(body["orders"])
    for name in ("only_a", "only_b"):
        if body[name]:
            yield f"only in {name[-1].upper()}: {', '.join(body[name])}"
    yield f"common     {body['assumption']}"
    yield from _changes("profile", body["profile_changes"])
    yield from _changes("around it", body["environment_changes"])
    yield from (f"{name:10} {path}" for name, path in body["files"].items())


def _number(body: Any) -> str:
    if body is None:
        return "-"
    if not isinstance(body, Mapping):
        return f"{body:.4g}"
    return with_uncertainty({**body, "dof": None}, "").strip()


def _quantities(rows: list[dict[str, Any]]) -> Lines:
    cells = []
    for row in rows:
        score = row["score"]
        told = "" if score is None else f"{score:.2f}{' !' if row['moved'] else ''}"
        label = row["label"] + (f" ({row['unit']})" if row["unit"] else "")
        expanded = "" if row["expanded"] is None else f"{row['expanded']:.2g}"
        change = "" if row["difference"] is None else f"{row['difference']['value']:+.4g}"
        words = (label, _number(row["a"]), _number(row["b"]), change, expanded, told)
        cells.append([styled((word, "" if row["decides"] else "dim")) for word in words])
    yield table(("", "A", "B", "B - A", "expanded", "score"), cells)
    score = "score: |B - A| over its expanded uncertainty; above 1 (!) it has moved"
    yield styled((f"{score}; dim: for information", "dim"))


def _orders(orders: Mapping[str, Any]) -> Iterator[str]:
    if orders["score"] is None and len(orders["orders"]) == 1:
        yield (
            "vectors    phase not compared: the angle has no common origin "
            "(--same-origin says it has)"
        )
        return
    how = "one angle origin"
    if not orders["same_origin"]:
        how = f"B turned back by {orders['shift_rad']:.4f} rad: no common angle origin is known"
    yield f"vectors    {how}"
    for row in orders["orders"]:
        told = "" if row["score"] is None else f", score {row['score']:.2f}"
        step = _number(row["difference"]["amplitude_nm"])
        yield f"  order {row['order']:g}: difference {step} N m{told}"
    if orders["score"] is not None:
        yield f"  together: score {orders['score']:.2f}{' !' if orders['moved'] else ''}"


def _changes(name: str, changes: list[dict[str, Any]] | None) -> Iterator[str]:
    if changes is None:
        yield f"{name:10} not known: a result file alone does not tell"
        return
    if not changes:
        yield f"{name:10} the same"
    for index, change in enumerate(changes[:_MOST_KEYS]):
        head = name if index == 0 else ""
        a, b = ("absent" if change["only"] not in ("", s) else change[s] for s in "ab")
        yield f"{head:10} {change['key']}: {a!s:.40} -> {b!s:.40}"
    if len(changes) > _MOST_KEYS:
        yield f"{'':10} and {len(changes) - _MOST_KEYS} more: see --json"
