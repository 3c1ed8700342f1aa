"""What every finished run shows: report, result, doubts, exit code."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from hdbench.errors import DoubtfulDataError, LimitError
from hdbench_cli.next_step import line
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

    from hdbench.profile import Profile

__all__ = ["Asked", "Shown", "doubt_fix", "doubts_of", "present"]


class Asked(Protocol):
    """What a command that shows a run was asked for."""

    @property
    def no_report(self) -> bool:
        """Leave out report.html."""
        ...

    @property
    def check(self) -> bool:
        """Exit 3 unless the result passes."""
        ...


@dataclass(frozen=True, slots=True)
class Shown:
    """How one kind of result is shown and judged, and which command is useful after it."""

    show: Callable[[Console, Mapping[str, Any]], None]
    failed: Callable[[Mapping[str, Any]], str | None]
    then: Callable[[Path, Mapping[str, Any]], str] | None = None


def doubts_of(result: Mapping[str, Any]) -> list[str]:
    """Return every reason to doubt a result: what the run saw and what its data show."""
    flags = [str(flag["detail"]) for flag in result.get("flags", ())]
    return [*map(str, result.get("doubts", ())), *flags]


def present(
    output: Output,
    asked: Asked,
    profile: Profile,
    found: tuple[Path, Mapping[str, Any]],
    shown: Shown,
) -> None:
    """Write the report of a finished run, show its result, and say what speaks against it."""
    folder, result = found
    doubts = doubts_of(result)
    if not asked.no_report:
        from hdbench.report import write_report

        write_report([folder], folder / "report.html", profile=profile)

    def text(console: Console) -> None:
        shown.show(console, result)
        scale = result.get("torque_scale") or {}
        if scale.get("age_words"):
            gain = f"gain          {scale['source']}: {scale['age_words']}"
            console.print(gain, markup=False, highlight=False, soft_wrap=True)
        console.print(f"\nrun     {folder}", highlight=False)
        if not asked.no_report:
            console.print(f"report  {folder / 'report.html'}", highlight=False)
        if shown.then is not None:
            console.print(line(shown.then(folder, result)), markup=False, soft_wrap=True)

    output.result({**result, "run_folder": str(folder)}, text)
    reason = shown.failed(result) if asked.check else None
    if reason:
        _after(output, LimitError(reason, where=str(folder), fix="see report.html of this run"))
    if doubts:
        _after(
            output,
            DoubtfulDataError(
                "finished, but the data are doubtful: " + "; ".join(doubts),
                where=str(folder),
                fix=doubt_fix(folder),
            ),
        )


def doubt_fix(folder: Path) -> str:
    """Return what to do about doubtful data: a file can be brought in anew, a run measured anew."""
    from hdbench.records import RunFolder

    details = RunFolder.open(folder).manifest.get("details", {})
    if isinstance(details, dict) and "source" in details:
        return (
            "look at the report; where columns or units are wrong bring the file in again: "
            "hdbench import --map"
        )
    return "look at the marked samples, then measure again"


def _after(output: Output, error: LimitError | DoubtfulDataError) -> None:
    """End with the error's code; with ``--json`` the one object is out already."""
    if output.json:
        import click

        output.note(str(error))
        raise click.exceptions.Exit(error.exit_code)
    raise error
