"""`hdbench runs list` and `hdbench runs note`, and how both name runs by their properties."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from hdbench_cli.next_step import next_line
from hdbench_cli.options import RUN_FILTERS, declared
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from hdbench.records import RunSummary

_COLUMNS = (
    "run_id",
    "path",
    "kind",
    "status",
    "started_utc",
    "profile",
    "drive",
    "sensor",
    "verdict",
    "exit_reason",
)


def chosen_runs(parent: Path, options: dict[str, Any]) -> list[RunSummary]:
    """Return the runs in a folder that the filter options choose."""
    from hdbench.errors import DataError
    from hdbench.records import list_runs, select_runs

    typed = click.get_current_context().get_parameter_source("parent")
    if not parent.is_dir() and typed is not ParameterSource.DEFAULT:
        raise DataError(
            "no such folder", where=str(parent), fix="name the folder that --out of the runs named"
        )
    wanted = {name: options[name] for name in RUN_FILTERS.split()}
    return select_runs(list_runs(parent), wanted, options["since"])


def _key(run: RunSummary, name: str) -> str:
    if name == "run":
        return run.path.name
    return str(getattr(run, "started_utc" if name == "started" else name))


@declared("runs list", f"parent {RUN_FILTERS} since sort reverse csv_file")
def list_(
    output: Output, /, parent: Path, sort: str, reverse: bool, csv_file: str | None, **options: Any
) -> None:
    """List the runs in a folder, oldest first.

    An index beside the runs (.runs-index.sqlite) makes it fast. It may be deleted at any time: the
    folders are the truth, and what has changed there is read again.
    """
    from hdbench.errors import UsageError
    from hdbench.records import result_header

    if csv_file == "-" and output.json:
        raise UsageError("both want stdout", where="--csv, --json", fix="give --csv a file")
    runs = sorted(chosen_runs(parent, options), key=lambda run: _key(run, sort), reverse=reverse)
    if csv_file is not None:
        _write_csv(csv_file, runs)
        if csv_file == "-":
            return
    output.result(
        {**result_header("runs", None), "runs": [run.to_dict() for run in runs]},
        lambda _body: _lines(parent, runs),
    )


def _lines(parent: Path, runs: list[RunSummary]) -> str:
    if not runs:
        return f"no such runs in {parent.resolve()}\n{next_line('hdbench demo')}\n"
    lines = (
        f"{r.path}  {r.status:10}  {r.verdict:13}  {r.profile}  {r.drive:8}  {r.exit_reason}"
        for r in runs
    )
    return "".join(f"{line.rstrip()}\n" for line in lines)


def _write_csv(file: str, runs: list[RunSummary]) -> None:
    import csv
    import io

    from hdbench.records import write_atomic
    from hdbench.records.csvtext import safe_cell

    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for run in runs:
        body = run.to_dict()
        writer.writerow([safe_cell(body[name]) for name in _COLUMNS])
    if file == "-":
        click.echo(text.getvalue(), nl=False)
    else:
        write_atomic(Path(file), text.getvalue().encode())


@declared("runs note")
def note(output: Output, run: Path, text: str) -> None:
    """Note on a run what was done before it, such as service or a new clamping.

    Notes are kept in the run's folder (notes.jsonl); `hdbench trend` marks them.
    """
    from dataclasses import asdict

    from hdbench.records import add_note, read_notes, result_header
    from hdbench.records.runfolder import utc_now

    add_note(run, text, utc_now())
    notes = [asdict(one) for one in read_notes(run)]
    output.result(
        {**result_header("notes", None), "run": str(run), "notes": notes},
        lambda _body: [f"{n['utc'][:19]}Z  {n['text']}" for n in notes],
    )
