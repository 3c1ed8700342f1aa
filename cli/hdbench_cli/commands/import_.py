"""`hdbench import`: other programs' logs as trace or loads."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, Literal

import click

from hdbench.calibration.staircase.importing import StaircasePlan, StaircaseReport, import_staircase
from hdbench.errors import UsageError
from hdbench.importing.importer import ImportReport, import_files
from hdbench.importing.listing import ChannelFacts, list_channels
from hdbench.importing.proposal import Proposal, proposed_mapping, time_candidate
from hdbench.importing.recipe import Recipe, read_recipe, write_recipe
from hdbench.importing.registry import open_source
from hdbench.importing.source import Source
from hdbench.importing.trace import no_time
from hdbench.profile import Profile
from hdbench_cli.inputs import choose_profile
from hdbench_cli.next_step import after_import, next_line
from hdbench_cli.output import Output


def _pairs(texts: tuple[str, ...], option: str) -> dict[str, str]:
    """Return NAME=VALUE texts by name."""
    found: dict[str, str] = {}
    for text in texts:
        name, mark, value = text.partition("=")
        if not mark or not value:
            raise UsageError(
                f"found {text!r:.80}; needed: [FILE_NUMBER:]NAME=...",
                where=option,
                fix=f"such as {option} torque_nm=Torque*0.001",
            )
        found[name] = value
    return found


def _imported(report: ImportReport, profile_name: str | None) -> Iterator[str]:
    """Yield what one file or several became."""
    yield f"{report.kind}: {report.rows} rows of {', '.join(report.columns)}"
    if report.lost:
        yield f"{report.lost} cells without a number are marked as lost"
    if report.time_origin_s:
        yield f"time starts at 0; it was {report.time_origin_s!r} s"
    yield from report.notes
    yield f"read back and kept as {report.out}"
    command = after_import(report.kind, report.out, report.columns, profile_name)
    if command:
        yield next_line(command)


def _listed(
    source: Source, facts: list[ChannelFacts], proposal: Proposal, command: str
) -> Iterator[str]:
    """Yield what is in a file and which mapping is proposed."""
    yield f"{source.path}: {source.form}, {len(facts)} channels"
    width = min(max(len(f.channel.name) for f in facts), 48)
    for f in facts:
        rate = "" if f.rate_hz is None else f"{f.rate_hz:.5g} Hz"
        span = "words" if f.is_text else "no number"
        if f.least is not None:
            span = f"{f.least:.6g} to {f.most:.6g}"
        missing = f"{100 * f.missing_share:.3g} % missing" if f.missing_share else ""
        unit = f.channel.unit or "-"
        row = f"{f.number:4d} {f.channel.name:<{width}} {unit:<6} {rate:<10} {span:<28} {missing}"
        yield row.rstrip()
    yield from source.notes[:20]
    yield "proposed, by names and units:"
    for target, text in proposal.recipe.map.items():
        yield f"  {target} = {text}  ({proposal.reasons[target]})"
    for option, reason in proposal.reasons.items():
        if option.startswith("--"):
            yield f"  {option}  ({reason})"
    yield from (f"needed: {need}" for need in proposal.needs)
    if not proposal.needs:
        yield "to take it:"
    yield command


def _listing(
    output: Output, file: Path, recipe: Recipe, profile: Profile, bench: str | None, *, ask: bool
) -> Proposal | None:
    """Show what is in a file and what is proposed; return what a person takes at once."""
    with closing(open_source(file, recipe)) as source:
        time = time_candidate(source.channels)
        facts = list_channels(source, None if time is None else time.name)
        proposal = proposed_mapping(facts, recipe, source.channels, bench)
    out = _default_out(file)
    if proposal.no_time and output.json:
        raise no_time(source)
    body = {
        "file": str(file),
        "form": source.form,
        "channels": [fact.to_dict() for fact in facts],
        "notes": list(source.notes),
        "proposal": proposal.to_dict(file, out),
    }
    lines = _listed(source, facts, proposal, proposal.command(file, out))
    output.result(body, lines, kind="import", profile=profile)
    if proposal.no_time:
        raise no_time(source)
    if not ask or proposal.needs or output.json:
        return None
    return proposal if click.confirm(f"Take it and write {out}?", err=True) else None


def _default_out(file: Path) -> Path:
    stem = file.name.removesuffix(".gz").rpartition(".")[0] or file.name
    out = Path(f"{stem}.csv")
    return Path(f"{stem}.trace.csv") if out.resolve() == file.resolve() else out


def import_command(
    output: Output,
    /,
    files: tuple[Path, ...],
    kind: Literal["trace", "loads", "staircase"],
    maps: tuple[str, ...],
    constants: tuple[str, ...],
    time: str | None,
    recipe_file: Path | None,
    loads: str | None,
    load_unit: str,
    least_s: float,
    profile_name: str | None,
    out: Path | None,
    no_input: bool,
    **layout: Any,
) -> None:
    """Import traces and loads from other programs."""
    profile = choose_profile(profile_name, None)
    timed = {"time_s": time} if time is not None else {}
    recipe = Recipe(
        "loads" if kind == "staircase" else kind,
        {**_pairs(maps, "--map"), **timed},
        _pairs(constants, "--set"),
        **layout,
    )
    if kind == "staircase":
        plan = StaircasePlan(recipe, _numbers(loads), load_unit, least_s)
        _staircase(output, plan, files, _needed(out), profile)
        return
    keep = recipe_file is not None and not recipe_file.exists()
    if recipe_file is not None and not keep:
        recipe = recipe.over(read_recipe(recipe_file))
    if out is None and not recipe.map and not recipe.set and len(files) == 1:
        ask = not no_input and sys.stdin.isatty()
        taken = _listing(output, files[0], recipe, profile, profile_name, ask=ask)
        if taken is None:
            return
        recipe, out = taken.taken(), _default_out(files[0])
    _run(output, recipe, files, _needed(out), profile, profile_name)
    if keep and recipe_file is not None:
        write_recipe(recipe_file, recipe)
        output.note(f"mapping kept as {recipe_file}")


def _needed(out: Path | None) -> Path:
    if out is None:
        raise UsageError("no file to write", where="--out", fix="give --out FILE.csv")
    return out


def _run(
    output: Output,
    recipe: Recipe,
    files: tuple[Path, ...],
    out: Path,
    profile: Profile,
    profile_name: str | None,
) -> None:
    """Import into one file, or each file into a folder."""
    # the gear ratio of a bench that nobody named is none of this drive
    ratio = None if profile_name is None else profile.data.drive.gear_ratio
    arm = profile.data.arm
    if not out.is_dir():
        report = import_files(recipe, files, out, arm, ratio)
        lines = _imported(report, profile_name)
        output.result(report.to_dict(), lines, kind="import", profile=profile)
        return
    reports = [import_files(recipe, [file], out / _default_out(file), arm, ratio) for file in files]
    told = {"imports": [report.to_dict() for report in reports]}
    lines = (line for report in reports for line in _imported(report, profile_name))
    output.result(told, lines, kind="import", profile=profile)


def _staircase(
    output: Output, plan: StaircasePlan, files: tuple[Path, ...], out: Path, profile: Profile
) -> None:
    """Bring in raw readings under changing weights, and tell what was found."""
    if len(files) != 1:
        raise UsageError(
            f"{len(files)} files", where="FILE", fix="bring in one staircase at a time"
        )
    report = import_staircase(plan, files[0], out, profile.data.arm)
    output.result(report.to_dict(), _plateaus(report), kind="import", profile=profile)


def _numbers(loads: str | None) -> tuple[float, ...]:
    try:
        return tuple(float(word) for word in (loads or "").split(",") if word.strip())
    except ValueError as error:
        raise UsageError(
            f"{loads!r:.80} is no list of numbers",
            where="--loads",
            fix="give numbers with commas between, such as --loads 0,1,2,1,0",
        ) from error


def _plateaus(report: StaircaseReport) -> Iterator[str]:
    stairs, unit = report.stairs, report.unit.replace("nm", "N m")
    yield f"{len(stairs.plateaus)} plateaus in {report.n_samples} samples"
    for p, load in zip(stairs.plateaus, report.loads, strict=True):
        yield (
            f"{p.start_s:8.1f} to {p.end_s:6.1f} s  {load:8g} {unit}  {p.mean:.6g} +- {p.std:.2g}"
        )
    yield f"slope {report.slope():.6g} per {unit}"
    for name, times in (("glitches", stairs.glitches_at_s), ("stuck samples", stairs.stuck_at_s)):
        if times:
            shown = ", ".join(f"{t:.2f}" for t in times[:8])
            yield f"{len(times)} {name} left out, at {shown} s"
    yield f"read back and kept as {report.out}"
    yield next_line(after_import("loads", report.out, (), None))
