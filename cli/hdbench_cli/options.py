"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from hdbench_cli import complete
from hdbench_cli.parameters import StoredPath

__all__ = [
    "address_option",
    "allow_expired_option",
    "bench_options",
    "calibration_option",
    "control_option",
    "drive_option",
    "from_option",
    "model_option",
    "out_option",
    "plan_option",
    "profile_option",
    "seed_option",
]

F = TypeVar("F", bound=Callable[..., Any])

profile_option = click.option(
    "--profile",
    "profile_name",
    metavar="NAME|PATH",
    shell_complete=complete.profiles,
    help="Bench to use: a built-in name or a TOML file.  [default: the stored run's own, "
    "else cim-tr-97-06]",
)
out_option = click.option(
    "--out",
    "out",
    metavar="DIR",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("runs"),
    show_default=True,
    help="Parent folder of run folders.",
)
seed_option = click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Seed of everything that is simulated.",
)
from_option = click.option(
    "--from",
    "source",
    metavar="FILE|RUN",
    type=StoredPath(),
    help="Evaluate this stored file or run again instead of measuring.",
)
address_option = click.option(
    "--address",
    metavar="tcp://HOST:PORT",
    help="Bench controller to use instead of the profile's.",
)
control_option = click.option(
    "--control",
    metavar="tcp://127.0.0.1:PORT",
    help="Control channel of the simulated bench at --address, as hdbench emulate prints it: a "
    "simulated operator sets lock and weights. Motion still needs --yes or an answer.",
)


def _identity(_ctx: click.Context, _param: click.Parameter, value: str | None) -> str | None:
    if value is not None and not (0 < len(value.strip()) <= 200 and value.isprintable()):
        raise click.BadParameter("needed: 1 to 200 printable characters, such as a serial number")
    return None if value is None else value.strip()


drive_option = click.option(
    "--drive",
    metavar="ID",
    callback=_identity,
    help="Drive on the bench, such as its serial number; kept in run.json.  [default: the stored "
    "run's, else the profile's identity.drive_serial]",
)
calibration_option = click.option(
    "--calibration",
    metavar="RUN|FILE",
    type=StoredPath(),
    help="Calibration whose gain scales the torque; else the profile's gain.",
)
allow_expired_option = click.option(
    "--allow-expired",
    is_flag=True,
    help="Use that calibration even where it is older than the profile's validity_days.",
)
model_option = click.option(
    "--model",
    "filter_name",
    metavar="NAME|FILE",
    shell_complete=complete.filter_models,
    help="Filter model: report-a1, report-a2, report-6, a model file, or tuned (on this input) "
    "where there is one; else that of the stored run, else the profile's.",
)


plan_option = click.option(
    "--plan",
    "plan_file",
    metavar="FILE",
    type=StoredPath(dir_okay=False),
    help="Run this plan file (hdbench plan --out FILE) instead of the profile's motion.",
)


def bench_options(function: F) -> F:
    """Add the options of every command that drives the bench."""
    options = (
        profile_option,
        drive_option,
        out_option,
        from_option,
        address_option,
        control_option,
        click.option(
            "--plant",
            metavar="NAME|FILE",
            shell_complete=complete.plants,
            default="as-modelled",
            show_default=True,
            help="What the embedded bench has beyond its model.",
        ),
        seed_option,
        click.option("--dry-run", is_flag=True, help="Check and print the plan; nothing moves."),
        click.option("--yes", is_flag=True, help="Confirm motion without a question."),
        click.option("--no-input", is_flag=True, help="Never ask; fail where an answer is needed."),
        click.option("--check", is_flag=True, help="Exit 3 unless the result passes."),
        click.option("--realtime", is_flag=True, help="Let the embedded bench keep real time."),
        click.option("--no-report", is_flag=True, help="Leave out report.html."),
        click.option(
            "--format",
            "form",
            type=click.Choice(["csv", "parquet"]),
            default="csv",
            show_default=True,
            help="parquet keeps the data as Parquet too, beside the CSV file.",
        ),
    )
    for option in reversed(options):
        function = option(function)
    return function
