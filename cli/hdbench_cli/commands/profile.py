"""`hdbench profile`: list, show, check and make profiles."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import click

from hdbench.errors import ProfileError, UsageError
from hdbench.profile import (
    check_loads,
    check_profiles,
    list_profiles,
    load_profile,
    new_profile,
    profile_schema,
)
from hdbench.records import read_trace, resolve_input, write_new
from hdbench_cli.output import Output


def list_command(output: Output) -> None:
    """List the built-in profiles."""
    profiles = [load_profile(name) for name in list_profiles()]
    rows = [{**p.describe(), "description": p.data.description} for p in profiles]
    lines = [f"{row['name']}  {row['description']}" for row in rows]
    output.result({"profiles": rows}, lines, kind="profiles")


def show_command(output: Output, name: str) -> None:
    """Show the text of a profile."""
    profile = load_profile(name)
    body = {
        **profile.describe(),
        "path": profile.path,
        "text": profile.text,
        "data": profile.data.model_dump(mode="json"),
    }
    output.result(body, profile.text, kind="profile", profile=profile)


def check_command(output: Output, files: tuple[str, ...]) -> None:
    """Check profiles and name every problem at once; exit 4 if there is one."""
    profiles = check_profiles(files)
    for profile in profiles:
        try:
            check_loads(profile)
        except ProfileError as error:
            output.note(f"hdbench calibrate needs other weights: {error}")
    rows = [{**p.describe(), "path": p.path} for p in profiles]
    lines = [f"{row['path']}: valid" for row in rows]
    output.result({"profiles": rows}, lines, kind="profiles")


def new_command(
    output: Output,
    name: str,
    source: Path | None,
    gear_ratio: float | None,
    load_inertia: float | None,
    rated_torque: float | None,
    orders: tuple[float, ...],
    no_input: bool,
    out: Path | None,
) -> None:
    """Make a profile to start from, with meaning and unit of every key."""
    more: dict[str, Any] = {}
    if source is None:
        if (gear_ratio, load_inertia, rated_torque) != (None, None, None) or orders:
            raise UsageError(
                "--gear-ratio, --load-inertia, --rated-torque and --order go with --from",
                where="hdbench profile new",
                fix="give --from TRACE, or change the values in the file",
            )
        text = new_profile(name)
    else:
        from hdbench.diagnosis.bench import Known, bench_of_trace

        ask = not no_input and not output.json and sys.stdin.isatty()
        known = Known(
            _asked(gear_ratio, "--gear-ratio", "Motor turns per output turn", ask),
            _asked(load_inertia, "--load-inertia", "Inertia of the load at the output, kg m2", ask),
            rated_torque,
            orders,
        )
        bench = bench_of_trace(read_trace(resolve_input(source)), name, known)
        text, more = bench.text, bench.to_dict()
    if out is not None:
        write_new(out, text.encode())
    path = None if out is None else str(out)
    body = {"name": name, "path": path, **more, "text": text}
    # the text may go into a file by a redirection: what is said about it does not belong there
    if more and not output.json:
        for line in _told(more):
            output.note(line)
    output.result(body, text if out is None else f"{out}\n", kind="profile-new")


def _asked(value: float | None, option: str, question: str, ask: bool) -> float:
    """Return a value that no log tells: given, or asked for."""
    if value is not None:
        return value
    if not ask:
        raise UsageError(
            f"{question.lower()}: not given, and no log tells it",
            where="hdbench profile new --from",
            fix=f"give {option}",
        )
    return float(click.prompt(question, type=float, err=True))


def _told(bench: dict[str, Any]) -> list[str]:
    """Return what was filled, and what such a bench supports, as lines."""
    lines = [f"{one['key']} = {one['value']}  ({one['because']})" for one in bench["filled"]]
    for what in ("experiments", "causes"):
        good = [one["name"] for one in bench[what] if one["supported"]]
        lines.append(f"{what} that this log supports: {', '.join(good) or 'none'}")
        reasons: dict[str, list[str]] = {}
        for one in bench[what]:
            if not one["supported"]:
                reasons.setdefault(one["because"], []).append(one["name"])
        lines += [f"  not {', '.join(names)}: {why}" for why, names in reasons.items()]
    return lines


def schema_command(output: Output) -> None:
    """Print the JSON schema of profiles, for editors."""
    body = profile_schema()
    output.result(body, json.dumps(body, indent=2) + "\n")
