"""Options and arguments that several commands share, and the words for stored runs in them."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from hdbench.errors import DataError, nothing_stored

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

F = TypeVar("F", bound=Callable[..., Any])
POSITIVE = click.FloatRange(min=0.0, min_open=True)
_LAST = "last"
_RUNS = Path("runs")


def newest_run(word: str) -> Path | None:
    """Return the run that ``last`` or ``last:KIND`` names; None for any other word."""
    name, mark, kind = word.partition(":")
    if name != _LAST or (mark and not kind) or Path(word).exists():
        return None
    from hdbench.records import list_runs

    runs = [run for run in list_runs(_RUNS) if run.kind and kind in ("", run.kind)]
    if not runs:
        raise DataError(
            f"no stored run{kind and f' of kind {kind}'} in {_RUNS.resolve()}",
            where=word,
            fix="measure one, name a run folder, or work in the folder that holds runs/",
        )
    return max(runs, key=lambda run: (run.started_utc, run.path.name)).path


class StoredPath(click.Path):
    """Path of a stored file or run; ``last`` and ``last:KIND`` name the newest one in runs/.

    Parameters
    ----------
    inside : str
        File of a run that a folder stands for; empty takes the folder itself.

    Notes
    -----
    What is missing is invalid data (exit 4), as where a command finds it later on.
    """

    def __init__(self, *, inside: str = "") -> None:
        super().__init__(path_type=Path, dir_okay=not inside, readable=True)
        self.inside = inside

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path, or say that nothing is there."""
        path = newest_run(str(value)) or Path(value)
        if self.inside and (path / "run.json").is_file():
            path /= self.inside
        if not path.exists():
            raise nothing_stored(path)
        return super().convert(path, param, ctx)


def speeds(ctx: click.Context, param: click.Parameter, typed: tuple[str, ...]) -> tuple[float, ...]:
    """Read motor velocities that are not zero; one option may name several, with commas between."""
    found = []
    for word in ",".join(typed).split(",") if typed else ():
        try:
            speed = float(word)
        except ValueError:
            speed = math.nan
        if not math.isfinite(speed) or speed == 0.0:
            raise click.BadParameter(
                f"{word!r}; needed: rad/s, finite and not 0, where orders have a frequency",
                ctx,
                param,
            )
        found.append(speed)
    return tuple(found)


def _profile_names() -> list[str]:
    from hdbench.profile import list_profiles

    return list(list_profiles())


def _plant_names() -> list[str]:
    from hdbench.plant.plantfile import list_plants

    return list(list_plants())


def _filter_names() -> list[str]:
    from hdbench.filter import PRESETS

    return [*PRESETS, "tuned"]


def _completes(names: Callable[[], list[str]]) -> Callable[..., list[CompletionItem]]:
    """Complete the names that begin as typed, and let the shell add its files."""

    def complete(_ctx: click.Context, _param: click.Parameter, typed: str) -> list[CompletionItem]:
        from click.shell_completion import CompletionItem

        found = [CompletionItem(name) for name in names() if name.startswith(typed)]
        return [*found, CompletionItem(typed, type="file")]

    return complete


def _identity(_ctx: click.Context, _param: click.Parameter, value: str | None) -> str | None:
    if value is not None and not (0 < len(value.strip()) <= 200 and value.isprintable()):
        raise click.BadParameter("needed: 1 to 200 printable characters, such as a serial number")
    return None if value is None else value.strip()


def file_option(*names: str, **more: Any) -> Callable[[F], F]:
    """Return an option that names a file to write."""
    return click.option(*names, type=click.Path(path_type=Path, dir_okay=False), **more)


def sources_argument(metavar: str, *, required: bool = True) -> Callable[[F], F]:
    """Return the argument that takes stored files and runs."""
    return click.argument(
        "sources", metavar=metavar, nargs=-1, required=required, type=StoredPath()
    )


def model_option(help_text: str = "") -> Callable[[F], F]:
    """Return the option that names a filter model."""
    usual = (
        "Filter model: report-a1, report-a2, report-6, a model file, or tuned (on this input) "
        "where there is one; else that of the stored run, else the profile's."
    )
    return click.option(
        "--model",
        "filter_name",
        metavar="NAME|FILE",
        shell_complete=_completes(_filter_names),
        help=help_text or usual,
    )


def plant_option(default: str = "as-modelled", bench: str = "embedded bench") -> Callable[[F], F]:
    """Return the option that names a plant."""
    return click.option(
        "--plant",
        metavar="NAME|FILE",
        shell_complete=_completes(_plant_names),
        default=default,
        help=f"Plant of the {bench}: physics and faults that its model does not have.",
    )


profile_option = click.option(
    "--profile",
    "profile_name",
    metavar="NAME|PATH",
    shell_complete=_completes(_profile_names),
    help="Bench to use: a built-in name or a TOML file.  [default: the stored run's own, "
    "else cim-tr-97-06]",
)
out_option = click.option(
    "--out",
    "out",
    metavar="DIR",
    type=click.Path(path_type=Path, file_okay=False),
    default=_RUNS,
    help="Parent folder of run folders.",
)
seed_option = click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    help="Seed of all random numbers of the command.",
)
from_option = click.option(
    "--from",
    "source",
    metavar="FILE|RUN",
    type=StoredPath(),
    help="Evaluate this stored file or run; nothing is measured.",
)
address_option = click.option(
    "--address",
    metavar="tcp://HOST:PORT",
    help="Bench controller to use instead of the profile's.",
)
control_option = click.option(
    "--control",
    metavar="tcp://127.0.0.1:PORT",
    help="Control channel of the simulated bench at --address; hdbench emulate prints it. A "
    "simulated operator sets lock and weights through it. Motion still needs --yes or an answer.",
)
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
gain_option = click.option(
    "--gain",
    metavar="N·m/V",
    type=float,
    help="Gain that scales torque_v; else that of calibration, run, model or profile.",
)
allow_expired_option = click.option(
    "--allow-expired",
    is_flag=True,
    help="Use that calibration even where it is older than the profile's validity_days.",
)
plan_option = click.option(
    "--plan",
    "plan_file",
    metavar="FILE|RUN",
    type=StoredPath(inside="plan.toml"),
    help="Run this plan file (hdbench plan --out FILE), or that of a diagnosis, instead of the "
    "profile's motion.",
)
plot_option = file_option("--plot", metavar="FILE.svg", help="Picture to write, .svg or .png.")
yes_option = click.option("--yes", is_flag=True, help="Confirm motion without a question.")
no_input_option = click.option(
    "--no-input", is_flag=True, help="Never ask; fail where an answer is needed."
)
check_option = click.option("--check", is_flag=True, help="Exit 3 unless the result passes.")
_no_report_option = click.option("--no-report", is_flag=True, help="Leave out report.html.")
operator_option = click.option(
    "--operator",
    "who",
    type=click.Choice(["auto", "person", "simulated"]),
    default="auto",
    help="Who answers: auto asks a person at a real bench, and at a simulated one on a terminal. "
    "simulated needs the embedded bench or --control.",
)
mistakes_option = click.option(
    "--operator-mistakes",
    "mistakes",
    metavar="LIST",
    default="",
    show_default=False,
    help="What goes wrong at a simulated bench, by point of the sequence: wrong-weight@5, "
    "wrong-weight@5:0.5 (kg), swing@7, early-release@9, comma-separated.",
)
# of every command that may move the motor, and of runs resume
motion_options = (yes_option, no_input_option, check_option, _no_report_option)


def with_options(*options: Callable[[Any], Any]) -> Callable[[F], F]:
    """Return what adds several options, the first one on top."""

    def add(function: F) -> F:
        for option in reversed(options):
            function = option(function)
        return function

    return add


bench_options = with_options(
    profile_option,
    drive_option,
    out_option,
    from_option,
    address_option,
    control_option,
    plant_option(),
    seed_option,
    click.option("--dry-run", is_flag=True, help="Check and print the plan; nothing moves."),
    *motion_options,
    click.option("--realtime", is_flag=True, help="Let the embedded bench keep real time."),
    click.option(
        "--format",
        "form",
        type=click.Choice(["csv", "parquet"]),
        default="csv",
        help="parquet keeps the data as Parquet too, beside the CSV file.",
    ),
)
