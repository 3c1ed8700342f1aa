"""Options and arguments of the commands, declared in options.toml."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hdbench.errors import DataError, nothing_stored
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

_LAST = "last"
_RUNS = Path("runs")


@cache
def declared(name: str) -> dict[str, Any]:
    """Return what a TOML file beside this module declares."""
    return tomllib.loads(Path(__file__).with_name(f"{name}.toml").read_text(encoding="utf-8"))


def parameter(section: str, name: str) -> click.Parameter:
    """Return an option or argument of a command; `shared` is a section, too."""
    table = declared("options")
    entry = dict(table.get(section, {}).get(name, {}))
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


def _set_json(ctx: click.Context, _param: click.Parameter, value: bool) -> None:
    if value:
        ctx.ensure_object(Output).json = True


def _add_verbose(ctx: click.Context, _param: click.Parameter, value: int) -> None:
    ctx.ensure_object(Output).verbose += value


class _Finite(click.types.FloatParamType):
    """A number that is neither infinite nor NaN."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number.", param, ctx)
        return number


class _FiniteRange(click.FloatRange, _Finite):
    """A finite number within limits."""


_TYPES: dict[str, Any] = {
    "float": _Finite(),
    "int": int,
    "path": click.Path(path_type=Path),
    "file": click.Path(path_type=Path, dir_okay=False),
    "file or -": click.Path(dir_okay=False, allow_dash=True),
    "folder": click.Path(path_type=Path, file_okay=False),
}
_CALLBACKS = {
    "identity": _identity,
    "json": _set_json,
    "since": _since,
    "speeds": speeds,
    "verbose": _add_verbose,
}
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
    form = click.IntRange if name == "int" else _FiniteRange
    return form(*ends, min_open="above" in limits, max_open="below" in limits)
