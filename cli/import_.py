"""`hdbench import`: other programs' logs as trace or loads."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from hdbench.errors import UsageError
from hdbench_cli.import_staircase import staircase, staircase_plan
from hdbench_cli.next_step import after_import
from hdbench_cli.next_step import line as next_line
from hdbench_cli.options import profile_option
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

    from hdbench.records.importing import ImportPlan, ImportReport
    from hdbench.records.loggers import Logger

__all__ = ["command"]

_DELIMITERS = {"auto": None, "comma": ",", "semicolon": ";", "tab": "\t"}


def _plan(
    kind: str, maps: tuple[str, ...], constants: tuple[str, ...], time: str | None
) -> ImportPlan:
    from hdbench.records.importing import ImportPlan, known_columns
    from hdbench.records.mapping import parse_constant, parse_map

    known = known_columns(kind)
    columns = [parse_map(text, known) for text in maps]
    if time is not None:
        columns.append(parse_map(f"time_s={time}", known))
    return ImportPlan(
        kind, tuple(columns), tuple(parse_constant(text, known) for text in constants)
    )


def _show(console: Console, report: ImportReport) -> None:
    lines = [f"{report.kind}: {report.rows} rows of {', '.join(report.columns)}"]
    if report.lost:
        lines.append(f"{report.lost} cells without a number are marked as lost")
    if report.time_origin_s:
        lines.append(f"time starts at 0; it was {report.time_origin_s!r} s")
    lines += [*report.notes, f"read back and kept as {report.out}"]
    command = after_import(report.kind, report.out, report.columns)
    for line in (*lines, *([next_line(command)] if command else [])):
        console.print(line, markup=False, soft_wrap=True)


@click.command(
    name="import",
    epilog="Examples: hdbench import --kind trace log.csv --time t_ms*0.001 --map "
    "torque_nm=Torque --map motor_velocity_rad_s=rpm*0.10471975511965978 --out "
    "trace.csv; hdbench import --kind trace stream_0.dat --from-logger labjack --map "
    "torque_v=v0 --map tacho_v=v1 --out trace.csv; hdbench import --kind staircase "
    "weights.csv --time t_ms*0.001 --map reading_v=counts --loads 0,1,2,1,0 "
    "--load-unit kg --out loads.csv",
)
@click.argument(
    "files", metavar="FILE...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@click.option(
    "--kind",
    type=click.Choice(["trace", "loads", "staircase"]),
    required=True,
    help="What the files hold; staircase: raw readings while weights were hung one after another.",
)
@click.option(
    "--map",
    "maps",
    metavar="[N:]NAME=COLUMN[*SCALE][+OFFSET]",
    multiple=True,
    help="Fill column NAME from COLUMN (its name, or its number from 1), here only in file N.",
)
@click.option(
    "--set",
    "constants",
    metavar="[N:]NAME=VALUE",
    multiple=True,
    help="Fill column NAME with VALUE, here only in file N.",
)
@click.option("--time", metavar="COLUMN[*SCALE]", help="Time column, in s after scaling.")
@click.option(
    "--rate", type=click.FloatRange(min=0, min_open=True), metavar="HZ", help="Sample rate."
)
@click.option("--keep-time", is_flag=True, help="Keep the time as it is; else it starts at 0.")
@click.option(
    "--delimiter",
    type=click.Choice(list(_DELIMITERS)),
    default="auto",
    show_default=True,
    help="What separates the columns.",
)
@click.option(
    "--from-logger",
    "logger",
    type=click.Choice(["auto", "labjack", "dataq"]),
    help="The files are a data logger's: find the table, its time column and its units.",
)
@click.option("--no-header", is_flag=True, help="The first row holds data, not names.")
@click.option(
    "--skip", type=click.IntRange(min=0), default=0, help="Lines to pass over before the header."
)
@click.option(
    "--loads",
    metavar="A,B,...",
    help="Staircase: the load on each plateau, in the order of time.",
)
@click.option(
    "--load-unit",
    type=click.Choice(["nm", "kg", "lb"]),
    default="nm",
    show_default=True,
    help="Staircase: unit of the loads; masses hang on the arm of the profile.",
)
@click.option(
    "--least-s",
    type=click.FloatRange(min=0, min_open=True),
    default=3.0,
    show_default=True,
    help="Staircase: shortest plateau, s.",
)
@profile_option
@click.option(
    "--out",
    metavar="FILE",
    required=True,
    type=click.Path(path_type=Path, dir_okay=False),
    help="Trace or loads file to write.",
)
@click.pass_obj
def command(
    output: Output,
    *,
    files: tuple[Path, ...],
    kind: str,
    maps: tuple[str, ...],
    constants: tuple[str, ...],
    time: str | None,
    rate: float | None,
    keep_time: bool,
    delimiter: str,
    logger: Logger | None,
    no_header: bool,
    skip: int,
    loads: str | None,
    load_unit: str,
    least_s: float,
    profile_name: str | None,
    out: Path,
) -> None:
    """Bring in traces and loads from other programs.

    Columns that already bear a name of hdbench come along without --map. Decimal commas and a
    byte order mark are understood. The new file is read back before success is told.

    With --from-logger the table is looked for behind what the logger writes before it, its own
    time column is taken, and units that it states (mV, rpm, deg) are turned into ours.
    """
    from dataclasses import replace

    from hdbench.profile import load_profile
    from hdbench.records import result_header
    from hdbench.records.foreign import ForeignFormat
    from hdbench.records.importing import import_files

    if logger is not None and no_header:
        raise UsageError(
            "--from-logger needs the row of column names that --no-header denies",
            where="--from-logger",
            fix="leave one of them out",
        )
    layout = ForeignFormat(_DELIMITERS[delimiter], not no_header, skip, logger)
    profile = load_profile(profile_name or "cim-tr-97-06")
    if kind == "staircase":
        stairs = staircase_plan(maps, constants, time, loads)
        stairs = replace(stairs, unit=load_unit, least_s=least_s, rate_hz=rate, layout=layout)
        staircase(output, stairs, files, out, profile)
        return
    plan = replace(
        _plan(kind, maps, constants, time),
        layout=layout,
        rate_hz=rate,
        keep_time=keep_time,
    )
    report = import_files(plan, files, out, profile.data.arm)
    body = {**result_header("import", profile), **report.to_dict()}
    output.result(body, lambda console: _show(console, report))
