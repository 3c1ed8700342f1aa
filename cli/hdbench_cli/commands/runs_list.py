"""`hdbench runs list` and `hdbench runs note`, and how both name runs by their properties."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.core import ParameterSource

from hdbench_cli.next_step import next_line
from hdbench_cli.options import StoredPath, with_options
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from hdbench.records import RunSummary

F = TypeVar("F", bound=Callable[..., Any])
_FILTERS = ("kind", "profile", "status", "verdict", "drive", "sensor")
_SORTS = ("run", "started", "kind", "status", "profile", "drive", "sensor", "verdict")
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


class _Since(click.ParamType):  # type: ignore[type-arg]
    """A date, a moment, or a number of days back."""

    name = "date"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, datetime):
            return value
        try:
            if value.endswith("d"):
                return datetime.now(UTC) - timedelta(days=float(value[:-1]))
            moment = datetime.fromisoformat(value)
        except (ValueError, OverflowError):
            self.fail(f"{value!r}; needed: a date such as 2026-11-21, or 30d", param, ctx)
        return moment if moment.tzinfo else moment.replace(tzinfo=UTC)


def filter_options(function: F) -> F:
    """Add the options that choose runs."""
    words = {
        "kind": "calibration, misalignment, ripple, diagnosis.",
        "profile": "Name of the profile.",
        "status": "running, complete, incomplete, aborted, invalid.",
        "verdict": "ok, doubtful; accepted, not-accepted; nothing-found, named ...",
        "drive": "Identity of the drive, as --drive or the profile gave it.",
        "sensor": "Identity of the sensor, the profile's identity.flexspline_serial.",
    }
    options = [
        click.option(f"--{name}", metavar="WORD", multiple=True, help=f"{text} May be repeated.")
        for name, text in words.items()
    ]
    since = click.option(
        "--since", metavar="DATE|DAYSd", type=_Since(), help="Started then or later (UTC)."
    )
    return with_options(*options, since)(function)


def chosen_runs(ctx: click.Context, parent: Path, options: dict[str, Any]) -> list[RunSummary]:
    """Return the runs in a folder that the filter options choose."""
    from hdbench.errors import DataError
    from hdbench.records import list_runs, select_runs

    if not parent.is_dir() and ctx.get_parameter_source("parent") is not ParameterSource.DEFAULT:
        raise DataError(
            "no such folder", where=str(parent), fix="name the folder that --out of the runs named"
        )
    wanted = {name: options[name] for name in _FILTERS}
    return select_runs(list_runs(parent), wanted, options["since"])


def _key(run: RunSummary, name: str) -> str:
    if name == "run":
        return run.path.name
    return str(getattr(run, "started_utc" if name == "started" else name))


@click.command(
    "list", epilog="Example: hdbench runs list runs --kind calibration --drive A-17 --since 90d"
)
@click.argument(
    "parent", metavar="[DIR]", default="runs", type=click.Path(path_type=Path, file_okay=False)
)
@filter_options
@click.option("--sort", type=click.Choice(_SORTS), default="run", help="Order of the runs.")
@click.option("--reverse", is_flag=True, help="Reverse the order.")
@click.option(
    "--csv",
    "csv_file",
    metavar="[FILE.csv]",
    is_flag=False,
    flag_value="-",
    type=click.Path(dir_okay=False, allow_dash=True),
    help="The list as CSV: on stdout, or in a file.",
)
@click.pass_context
def list_(
    ctx: click.Context,
    /,
    parent: Path,
    sort: str,
    reverse: bool,
    csv_file: str | None,
    **options: Any,
) -> None:
    """List the runs in a folder, oldest first.

    An index beside the runs (.runs-index.sqlite) makes it fast. It may be deleted at any time: the
    folders are the truth, and what has changed there is read again.
    """
    from hdbench.errors import UsageError
    from hdbench.records import result_header

    output: Output = ctx.obj
    if csv_file == "-" and output.json:
        raise UsageError("both want stdout", where="--csv, --json", fix="give --csv a file")
    runs = sorted(
        chosen_runs(ctx, parent, options), key=lambda run: _key(run, sort), reverse=reverse
    )
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
    from hdbench.records.tables import safe_cell

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


@click.command("note", epilog="Example: hdbench runs note runs/RUN 're-clamped, new gauges'")
@click.argument("run", metavar="RUN", type=StoredPath())
@click.argument("text", metavar="TEXT")
@click.pass_obj
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
