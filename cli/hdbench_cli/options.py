"""Options and arguments of the commands, declared in options.toml and used by name."""

from __future__ import annotations

import inspect
import math
import tomllib
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hdbench.errors import DataError, nothing_stored

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

Function = Callable[..., Any]
# of every experiment, and of the commands that choose stored runs
EXPERIMENT = (
    "profile_name drive out source address control plant seed dry_run yes no_input check no_report "
    "realtime form"
)
RUN_FILTERS = "kind profile status verdict drive sensor"
_LAST = "last"
_RUNS = Path("runs")


def declared(
    name: str, names: str = "", *, cls: type[click.Command] = click.Command
) -> Callable[[Function], click.Command]:
    """Make a command of a function that takes the `Output`, then values by name.

    `name` is a section of options.toml, with that of its group before it: `runs list`. `names` are
    its entries in the order of the help, with blanks between; without them the function's own
    parameters are.
    """

    def made(function: Function) -> click.Command:
        taken = names.split() or [*inspect.signature(function).parameters][1:]
        example = " ".join(_table()[name]["example"].split())
        return click.command(
            name.rpartition(" ")[2],
            cls=cls,
            params=[parameter(name, entry) for entry in taken],
            epilog=f"Example{'s' if '; hdbench' in example else ''}: {example}",
        )(click.pass_obj(function))

    return made


def parameter(section: str, name: str) -> click.Parameter:
    """Return an option or argument of a command; `shared` is a section, too."""
    table = _table()
    entry = dict(table[section].get(name, {}))
    if not {"flags", "argument"} & entry.keys():
        entry = {**table["shared"].get(name, {}), **entry}
    name, kind = entry.pop("fills", name), _type(entry)
    if "argument" in entry:
        metavar, many = entry.pop("argument"), entry.pop("many", False)
        return click.Argument(
            [name],
            metavar=metavar or None,
            nargs=-1 if many else 1,
            type=kind,
            **{"required": True, **entry},
        )
    words = " ".join(entry.pop("help").split())
    if "default_text" in entry:
        words += f"  [default: {entry.pop('default_text')}]"
    if "callback" in entry:
        entry["callback"] = _CALLBACKS[entry["callback"]]
    if "complete" in entry:
        entry["shell_complete"] = _completes(_NAMES[entry.pop("complete")])
    if entry.pop("flag", False):
        entry["is_flag"] = True
    return click.Option([*entry.pop("flags").split(), name], type=kind, help=words, **entry)


@cache
def _table() -> dict[str, Any]:
    file = Path(__file__).with_suffix(".toml")
    return tomllib.loads(file.read_text(encoding="utf-8"))


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


def _since(ctx: click.Context, param: click.Parameter, value: str | None) -> datetime | None:
    """Read a date, a moment, or a number of days back."""
    if value is None:
        return None
    try:
        if value.endswith("d"):
            return datetime.now(UTC) - timedelta(days=float(value[:-1]))
        moment = datetime.fromisoformat(value)
    except (ValueError, OverflowError):
        raise click.BadParameter(
            f"{value!r}; needed: a date such as 2026-11-21, or 30d", ctx, param
        ) from None
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)


_TYPES: dict[str, Any] = {
    "float": float,
    "int": int,
    "path": click.Path(path_type=Path),
    "file": click.Path(path_type=Path, dir_okay=False),
    "file or -": click.Path(dir_okay=False, allow_dash=True),
    "folder": click.Path(path_type=Path, file_okay=False),
}
_CALLBACKS = {"identity": _identity, "since": _since, "speeds": speeds}
_NAMES = {"profiles": _profile_names, "plants": _plant_names, "filters": _filter_names}


def _type(entry: dict[str, Any]) -> Any:
    """Take what says which values an entry takes out of it, and return that as click's type."""
    if "choices" in entry:
        return click.Choice(entry.pop("choices"))
    name, _, inside = entry.pop("type", "").partition(":")
    if name == "stored":
        return StoredPath(inside=inside)
    limits = {key: entry.pop(key) for key in ("min", "above", "max", "below") if key in entry}
    if not limits:
        return _TYPES.get(name)
    ends = limits.get("min", limits.get("above")), limits.get("max", limits.get("below"))
    form = click.IntRange if name == "int" else click.FloatRange
    return form(*ends, min_open="above" in limits, max_open="below" in limits)
