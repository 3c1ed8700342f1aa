"""What `hdbench runs show` says of a run."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdbench_cli.next_step import after_run, line
from hdbench_cli.numbers import with_uncertainty

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["draw_run"]

# characters of a hash that tell two files apart at a glance; --json has all
_HASH = 12


def draw_run(console: Console, body: Mapping[str, Any], run: Path) -> None:
    """Draw what a run says of itself, for a person."""
    from rich.text import Text

    for name, words in _lines(body):
        console.print(Text(f"{name:13}{words}"), soft_wrap=True)
    console.print(Text(line(_then(body, run))), soft_wrap=True)


def _lines(body: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    yield "run", str(body.get("run_id", ""))
    yield "kind", str(body.get("kind", ""))
    ended = f", {body['exit_reason']}" if body.get("exit_reason") else ""
    yield "status", f"{body.get('status', '')}{ended}"
    yield "started", str(body.get("started_utc", ""))
    yield "ended", str(body.get("ended_utc") or "not yet")
    profile = _table(body, "profile")
    yield "profile", f"{profile.get('name', '')}, SHA-256 {_short(profile.get('sha256'))}"
    for name in ("drive", "sensor"):
        if body.get(name):
            yield name, str(body[name])
    gain = _table(body, "calibration")
    value = _table(gain, "gain_nm_per_v")
    if value.get("value") is not None:
        known = value.get("std") is not None
        words = with_uncertainty(value, "N m/V") if known else f"{value['value']:.6g} N m/V"
        yield "gain", f"{words}, {gain.get('source')}"
    for name, words in (
        ("device", _pairs(_table(body, "device"))),
        ("versions", _pairs(_table(body, "versions"))),
        ("filter", str(_table(body, "filter").get("name", ""))),
    ):
        if words:
            yield name, words
    details = _table(body, "details")
    for step in _table(details, "plan").get("steps", ()):
        yield "plan", str(step)
    if details.get("simulation"):
        yield "simulation", _pairs(_table(details, "simulation"))
    for note in body.get("notes", ()):
        yield "note", f"{note['utc'][:19]}Z  {note['text']}"
    for name, digest in _table(body, "files").items():
        yield "file", f"{name}, SHA-256 {_short(digest)}"


def _table(body: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    found = body.get(key)
    return found if isinstance(found, Mapping) else {}


def _short(digest: object) -> str:
    return str(digest or "unknown")[:_HASH]


def _pairs(table: Mapping[str, Any]) -> str:
    words = {True: "yes", False: "no"}
    return ", ".join(
        f"{key} {words[value] if isinstance(value, bool) else value}"
        for key, value in table.items()
    )


def _then(body: Mapping[str, Any], run: Path) -> str:
    """Return the next useful command."""
    if body.get("status") == "incomplete":
        return f"hdbench runs resume {shlex.quote(str(run))}"
    if body.get("status") == "complete" and body.get("kind") in (
        "calibration",
        "misalignment",
        "ripple",
    ):
        return after_run(str(body["kind"]), run, {})
    return f"hdbench report {shlex.quote(str(run))} --out report.html"
