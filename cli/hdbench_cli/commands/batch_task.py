"""One input of a batch, where it is computed: the command itself, its result put in its place."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hdbench.errors import HdbenchError
from hdbench.profile import Profile
from hdbench_cli.output import Body, Output, Shown, headed


@dataclass(frozen=True, slots=True)
class BatchCommand:
    """How a command takes one input and where its result goes.

    Parameters
    ----------
    option : tuple of str
        Option before the input.
    writes : str
        ``run`` makes a run folder under --out; an ending such as ``.csv`` is that of the file
        --out; empty leaves what --json prints, as a file.
    kinds : tuple of str
        Kinds of the runs to take out of a folder; empty takes all.
    any_file, whole : bool
        Take every file out of a folder; take the folder itself.
    """

    option: tuple[str, ...] = ()
    writes: str = ""
    kinds: tuple[str, ...] = ()
    any_file: bool = False
    whole: bool = False


_DYNAMIC = ("misalignment", "ripple")
COMMANDS = {
    "import": BatchCommand(writes=".csv", any_file=True),
    "inspect": BatchCommand(kinds=_DYNAMIC),
    "diagnose": BatchCommand(writes="run", kinds=("calibration", *_DYNAMIC)),
    "orders": BatchCommand(kinds=_DYNAMIC),
    "run-ripple": BatchCommand(("--from",), "run", ("ripple",)),
    "run-misalignment": BatchCommand(("--from",), "run", ("misalignment",)),
    "calibrate": BatchCommand(("--from",), "run", ("calibration",)),
    "filter": BatchCommand(writes=".csv", kinds=_DYNAMIC),
    "tune": BatchCommand(writes=".json", kinds=_DYNAMIC),
    "regress": BatchCommand(whole=True),
}


@dataclass(slots=True)
class _Kept(Output):
    """Streams of a command that nobody reads on a screen: its result, error and notes are kept."""

    body: Mapping[str, Any] | None = None
    failure: HdbenchError | None = None
    notes: list[str] = field(default_factory=list)

    def result(
        self, body: Body, lines: Shown, *, kind: str = "", profile: Profile | None = None
    ) -> None:
        """Keep the result."""
        self.body = headed(body, kind, profile)

    def note(self, message: str) -> None:
        """Keep a line."""
        self.notes.append(message)

    def error(self, error: HdbenchError) -> None:
        """Keep the error."""
        self.failure = error


def empty_row(task: Mapping[str, Any]) -> dict[str, Any]:
    """Return the row of an input before anything is known of it."""
    return {
        "input": task["input"],
        "sha256": None,
        "exit_code": 0,
        "error": None,
        "result": None,
        "verdict": None,
        "drive": task["drive"] or None,
    }


def run_one(task: Mapping[str, Any]) -> dict[str, Any]:
    """Run the command of a batch on one input."""
    from hdbench.batch import content_of

    path, begin = Path(task["path"]), time.perf_counter()
    row = empty_row(task)
    try:
        content = content_of(path)
    except HdbenchError as error:
        return {"row": row | _failure(error), "stamps": None}
    if content.sha256 == task["known"]:
        return {"row": None, "stamps": content.stamps}
    row["sha256"] = content.sha256
    try:
        with tempfile.TemporaryDirectory(
            dir=Path(task["out"]) / ".parts", ignore_cleanup_errors=True
        ) as part:
            row |= _run(task, path, Path(part))
    except OSError as error:
        from hdbench.records.storage import storage_error

        row |= _failure(storage_error(error, Path(task["out"])))
    row["seconds"] = round(time.perf_counter() - begin, 3)
    return {"row": row, "stamps": content.stamps}


def _failure(error: HdbenchError) -> dict[str, Any]:
    problems = error.problems or (error,)
    said = "; ".join(f"{one.where}: {one.what} (fix: {one.fix})" for one in problems)
    return {"exit_code": error.exit_code, "error": said, "verdict": None}


def _run(task: Mapping[str, Any], path: Path, part: Path) -> dict[str, Any]:
    from hdbench_cli.main import _run as run_line

    command = COMMANDS[task["command"]]
    out: Sequence[str] = ()
    if command.writes:
        out = ("--out", str(part if command.writes == "run" else part / f"out{command.writes}"))
    words = [task["command"], *command.option, str(path), *out, *task["options"]]
    output = _Kept(json=True)
    with warnings.catch_warnings():
        # as the command line does: what a library's remark leads to is told as a doubt or error
        warnings.simplefilter("ignore", RuntimeWarning)
        code = run_line(words, output)
    if output.body is None:
        error = output.failure or HdbenchError("no result", where=words[0], fix="run it alone")
        return _failure(error) | {"exit_code": code or 1}
    place = _publish(task, command, output.body, part)
    row: dict[str, Any] = {
        "exit_code": code,
        "error": " ".join(" ".join(output.notes).split()) if code else None,
        "result": str(Path(task["shown"]) / "results" / place.name),
    }
    drive = task["drive"] or _drive_of(place) or _drive_of(path)
    return row | {"drive": drive, "verdict": _verdict(output.body, code)} | _figures(output.body)


def _publish(
    task: Mapping[str, Any], command: BatchCommand, body: Mapping[str, Any], part: Path
) -> Path:
    """Give the finished result its name; an older one of that name makes room."""
    from hdbench.records import write_json

    results, name = Path(task["out"]) / "results", str(task["name"])
    printed = results / f"{name}.result.json"
    if command.writes == "run":
        place = results / name
        _replace(Path(body["run_folder"]), place, part)
        return place
    place = results / f"{name}{command.writes}" if command.writes else printed
    told = {"out": str(Path(task["shown"]) / "results" / place.name)} if command.writes else {}
    write_json(part / "printed.json", {**body, **told})
    _replace(part / "printed.json", printed, part)
    for file in part.glob("out.*"):
        _replace(file, place.with_name(file.name.replace("out", name, 1)), part)
    return place


def _replace(made: Path, place: Path, part: Path) -> None:
    if place.is_dir():
        os.replace(place, part / "older")
    os.replace(made, place)
    shutil.rmtree(part / "older", ignore_errors=True)


def _drive_of(run: Path) -> str | None:
    """Return the drive that a run names."""
    from hdbench.records import read_json

    record = run / "run.json"
    try:
        drive = read_json(record).get("drive") if record.is_file() else None
    except HdbenchError:
        return None
    return drive if isinstance(drive, str) and drive else None


def _verdict(body: Mapping[str, Any], code: int) -> str:
    if "verdict" in body:
        return str(body["verdict"])
    if "accepted" in body:
        from hdbench.records.runindex import ACCEPTANCE

        return ACCEPTANCE[body["accepted"]]
    return {0: "in-order", 3: "check-failed"}.get(code, "doubtful")


def _figures(body: Mapping[str, Any]) -> dict[str, Any]:
    from hdbench.report.sections import key_figures

    found: dict[str, Any] = {}
    for figure in key_figures(body):
        found[figure.quantity] = figure.value
        if figure.std is not None:
            found[f"{figure.quantity}_std"] = figure.std
    if "causes" in body and isinstance(body["causes"], list):
        found["causes"] = " ".join(cause["name"] for cause in body["causes"])
    return found
