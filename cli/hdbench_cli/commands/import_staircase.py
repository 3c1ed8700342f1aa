"""`hdbench import --kind staircase`: raw readings under changing weights."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from hdbench_cli.next_step import after_import
from hdbench_cli.next_step import line as next_line
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

    from hdbench.calibration.staircase import StaircasePlan, StaircaseReport
    from hdbench.profile import Profile

__all__ = ["staircase", "staircase_plan"]


def staircase_plan(
    maps: tuple[str, ...], constants: tuple[str, ...], time: str | None, loads: str | None
) -> StaircasePlan:
    """Return what the options say of a staircase."""
    from hdbench.calibration.staircase import StaircasePlan
    from hdbench.importing.mapping import parse_constant, parse_map
    from hdbench.importing.recipe import known_columns

    known = known_columns("loads")
    columns = [parse_map(text, known) for text in maps]
    if time is not None:
        columns.append(parse_map(f"time_s={time}", known))
    fixed = tuple(parse_constant(text, known) for text in constants)
    return StaircasePlan(tuple(columns), fixed, _numbers(loads))


def _numbers(loads: str | None) -> tuple[float, ...]:
    from hdbench.errors import UsageError

    try:
        return tuple(float(word) for word in (loads or "").split(",") if word.strip())
    except ValueError as error:
        raise UsageError(
            f"{loads!r:.80} is no list of numbers",
            where="--loads",
            fix="give numbers with commas between, such as --loads 0,1,2,1,0",
        ) from error


def staircase(
    output: Output, plan: StaircasePlan, files: tuple[Path, ...], out: Path, profile: Profile
) -> None:
    """Bring one staircase in and tell what was found."""
    from hdbench.calibration.staircase import import_staircase
    from hdbench.errors import UsageError
    from hdbench.records import result_header

    if len(files) != 1:
        raise UsageError(
            f"{len(files)} files", where="FILE", fix="bring in one staircase at a time"
        )
    report = import_staircase(plan, files[0], out, profile.data.arm)
    body = {**result_header("import", profile), **report.to_dict()}
    output.result(body, lambda console: _show(console, report))


def _show(console: Console, report: StaircaseReport) -> None:
    stairs, unit = report.stairs, report.unit.replace("nm", "N m")
    lines = [f"{len(stairs.plateaus)} plateaus in {report.n_samples} samples"]
    lines += [
        f"{p.start_s:8.1f} to {p.end_s:6.1f} s  {load:8g} {unit}  {p.mean:.6g} +- {p.std:.2g}"
        for p, load in zip(stairs.plateaus, report.loads, strict=True)
    ]
    lines.append(f"slope {report.slope():.6g} per {unit}")
    for name, times in (("glitches", stairs.glitches_at_s), ("stuck samples", stairs.stuck_at_s)):
        if times:
            shown = ", ".join(f"{t:.2f}" for t in times[:8])
            lines.append(f"{len(times)} {name} left out, at {shown} s")
    lines += [f"read back and kept as {report.out}"]
    lines += [next_line(after_import("loads", report.out, ()))]
    for line in lines:
        console.print(line, markup=False, soft_wrap=True)
