"""`hdbench batch`."""

from __future__ import annotations

import hashlib
import json
import shlex
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from hdbench import __version__
from hdbench.batch import (
    BatchFolder,
    Input,
    Workers,
    content_of,
    expand_inputs,
    run_tasks,
    stamps_of,
    summary_of,
)
from hdbench.batch.workers import require_batch
from hdbench.errors import (
    DoubtfulDataError,
    HdbenchError,
    LimitError,
    Stopped,
    UsageError,
    nothing_stored,
)
from hdbench.system.processes import usable_cores
from hdbench_cli.commandline import batch_options
from hdbench_cli.commands.batch_task import COMMANDS, empty_row, run_one
from hdbench_cli.inputs import choose_profile
from hdbench_cli.options import newest_run
from hdbench_cli.output import Output, progress_bar

# failed inputs named on the screen: the table has them all
_MOST_LINES = 10


def batch_command(
    output: Output,
    /,
    name: str,
    inputs: tuple[str, ...],
    out: Path,
    resume: bool,
    workers: int | None,
    scheduler: str | None,
    retries: int,
    memory: str,
    **_options: Any,
) -> None:
    """Run COMMAND over many inputs: one result each as the command writes it, and one table."""
    ctx = click.get_current_context()
    require_batch()  # before anything is made
    kind = COMMANDS[name]
    named = tuple(str(newest_run(word) or word) for word in inputs)
    entries = expand_inputs(named, kinds=kind.kinds, any_file=kind.any_file, whole=kind.whole)
    jobs = [*_jobs(name, ctx, entries)]
    seats = Workers(workers or usable_cores(), scheduler, retries, memory)
    with closing(BatchFolder(out, name, resume=resume)) as folder:
        batch = _Run(folder, [*zip(entries, jobs, folder.names(entries), strict=True)], name)
        try:
            batch.run(seats)
        except (KeyboardInterrupt, SystemExit) as stop:
            raise _stopped(stop, batch, ctx, inputs) from None
        finally:
            batch.write()
    _tell(output, batch, out)


class _Run:
    """One call: which inputs have a result already, and the rows of all."""

    def __init__(
        self, folder: BatchFolder, inputs: Sequence[tuple[Input, Job, str]], name: str
    ) -> None:
        self._folder = folder
        self._inputs = inputs
        self.name = name
        self.rows: list[dict[str, Any] | None] = [None] * len(inputs)
        self.kept = 0
        self.failed = 0

    def run(self, workers: Workers) -> None:
        """Compute what is missing."""
        todo = [task for number in range(len(self._inputs)) if (task := self._task(number))]
        if not todo:
            return
        workers = replace(workers, count=min(workers.count, len(todo)))
        begin = time.monotonic()
        with (
            progress_bar("batch") as show,
            closing(run_tasks(run_one, todo, workers)) as outcomes,
        ):
            for count, outcome in enumerate(outcomes, 1):
                number = outcome.task["number"]
                done = _lost(outcome.task, outcome.deaths) if outcome.lost else outcome.value
                self._take(number, done)
                rate = count / (time.monotonic() - begin)
                show(_progress(count, len(todo), rate, self.failed), count / len(todo))

    def _task(self, number: int) -> dict[str, Any] | None:
        """Return what a worker has to do; None where the result is there."""
        entry, job, name = self._inputs[number]
        known = self._folder.kept(entry, job.digest)
        if known and known["stamps"] and known["stamps"] == stamps_of(entry.path):
            self._keep(number, known["row"])
            return None
        out = self._folder.path
        return {
            "number": number,
            "command": self.name,
            "options": job.options,
            "input": str(entry.path),
            "path": str(entry.path.absolute()),
            "name": name,
            "out": str(out.absolute()),
            "shown": str(out),
            "known": known["row"]["sha256"] if known else None,
            "drive": entry.drive,
        }

    def _keep(self, number: int, row: Mapping[str, Any]) -> None:
        entry = self._inputs[number][0]
        # where the folder stands now, and what the list says now
        told = {"input": str(entry.path)} | ({"drive": entry.drive} if entry.drive else {})
        if row["result"] is not None:
            told["result"] = str(self._folder.result_path(row))
        self.rows[number] = {**row, **told}
        self.kept += row["result"] is not None
        self.failed += row["result"] is None

    def _take(self, number: int, done: Mapping[str, Any]) -> None:
        entry, job, name = self._inputs[number]
        if done["row"] is None:  # another time of change, the same content
            known = self._folder.kept(entry, job.digest)
            if known is None:
                raise HdbenchError(
                    "a result was taken away meanwhile",
                    where=str(self._folder.path),
                    fix="go on with --resume",
                )
            done = {**done, "row": known["row"]}
            self._keep(number, done["row"])
        else:
            self.rows[number] = done["row"]
            self.failed += done["row"]["result"] is None
        self._folder.add(entry, job.digest, name, done)

    def told(self) -> list[dict[str, Any]]:
        """Return the rows that there are, in the order of the inputs."""
        return [row for row in self.rows if row is not None]

    def write(self) -> None:
        """Write the table of the rows that there are."""
        self._folder.write_table(self.told())


def _progress(count: int, total: int, rate: float, failed: int) -> str:
    """Return how far a batch is; failures stand where a narrow terminal does not cut them."""
    left_s = (total - count) / rate
    left = f"{left_s:.0f} s" if left_s < 100.0 else f"{left_s / 60.0:.0f} min"
    failures = f"{failed} failed, " if failed else ""
    return f"{count}/{total}, {failures}{rate:.2g}/s, {left} left"


def _lost(task: Mapping[str, Any], deaths: int) -> dict[str, Any]:
    """Return the row of an input whose worker died again and again."""
    times = "once" if deaths == 1 else f"{deaths} times"
    error = (
        f"{task['path']}: the worker died {times} on this input: it was killed, or held "
        "more than its --memory (fix: try it alone, with more --memory or fewer --workers)"
    )
    return {"row": {**empty_row(task), "exit_code": 1, "error": error}, "stamps": None}


def _stopped(
    stop: BaseException, batch: _Run, ctx: click.Context, inputs: Sequence[str]
) -> Stopped | SystemExit:
    code = stop.code if isinstance(stop, SystemExit) else 130
    if not isinstance(code, int):
        raise stop
    words = shlex.join([ctx.params["name"], *inputs])
    return Stopped(
        f"{len(batch.told())} of {len(batch.rows)} inputs are done and kept",
        where=str(ctx.params["out"]),
        fix=f"go on: hdbench batch {words if len(words) < 200 else '...'} with the same options "
        "and --resume",
        exit_code=code,
    )


def _tell(output: Output, batch: _Run, out: Path) -> None:
    """Print the table or its summary, and end with the code of the worst."""
    rows = batch.told()
    summary = summary_of(rows, batch.kept)
    body = {"command": batch.name, "out": str(out), **summary, "rows": rows}

    def lines() -> Iterator[str]:
        parts = [f"{count} {word}" for word, count in summary.items() if count or word == "done"]
        yield ", ".join(parts)
        bad = [row for row in rows if row["result"] is None]
        yield from (f"  {row['error']}" for row in bad[:_MOST_LINES])
        if len(bad) > _MOST_LINES:
            yield f"  and {len(bad) - _MOST_LINES} more: see the column error"
        yield f"table  {out / 'batch.csv'}"

    output.result(body, lines(), kind="batch")
    output.end(_error(rows, summary, out))


def _error(
    rows: Sequence[Mapping[str, Any]], summary: Mapping[str, int], out: Path
) -> HdbenchError | None:
    where, codes = str(out / "batch.csv"), [row["exit_code"] for row in rows]
    see = "look at the columns exit_code and error"
    if summary["failed"]:
        return DoubtfulDataError(
            f"{summary['failed']} of {len(rows)} inputs failed",
            where=where,
            fix=f"{see}; mend these inputs, then go on with --resume",
        )
    if 3 in codes:
        return LimitError(f"{codes.count(3)} of {len(rows)} do not pass", where=where, fix=see)
    if any(codes):
        doubtful = len(codes) - codes.count(0)
        return DoubtfulDataError(
            f"{doubtful} of {len(rows)} have doubtful data", where=where, fix=see
        )
    return None


@dataclass(frozen=True, slots=True)
class Job:
    """What is asked of one input: words of the command line, and the digest of their meaning."""

    options: tuple[str, ...]
    digest: str


def _jobs(name: str, ctx: click.Context, entries: Sequence[Input]) -> Iterator[Job]:
    """Yield what is asked of each input, with files among the options known by their content."""
    typed = [*_words(ctx, name)]
    known = {option for param in batch_options(name) for option in param.opts}
    digest_of, profile_of = cache(_meaning), cache(_profile_digest)
    for entry in entries:
        words = list(typed)
        for option, value in (("--profile", entry.profile), ("--calibration", entry.calibration)):
            if value and option not in known:
                raise UsageError(
                    f"the list names a {option[2:]}, and {name} takes none",
                    where=str(entry.path),
                    fix="leave that column out",
                )
            words += [(option, value)] if value else []
        profile = dict(words).get("--profile", "")
        meaning = [
            __version__,
            name,
            profile_of(profile) if "--profile" in known else "",
            [(option, digest_of(value)) for option, value in words],
        ]
        digest = hashlib.sha256(json.dumps(meaning).encode()).hexdigest()
        flat = (word for pair in words for word in (pair[0], _absolute(pair[1])) if word)
        yield Job(tuple(flat), digest)


def _meaning(value: str) -> str:
    """Return the digest of what a word names, else the word."""
    found = bool(value) and Path(value).exists()
    return content_of(Path(value)).sha256 if found else value


def _profile_digest(name: str) -> str:
    return choose_profile(name or None, None).sha256


def _words(ctx: click.Context, name: str) -> Iterator[tuple[str, str]]:
    """Yield the options that were typed for the command, each with its value, empty for a flag."""
    for option in batch_options(name):
        key = str(option.name)
        if ctx.get_parameter_source(key) is not ParameterSource.COMMANDLINE:
            continue
        value = ctx.params[key]
        for one in value if option.multiple else (value,):
            if isinstance(one, Path) and not one.exists():
                raise nothing_stored(one)
            yield option.opts[0], "" if option.is_flag else str(one)


def _absolute(value: str) -> str:
    """Return a word that names a file here so that it does so for every worker."""
    return str(Path(value).absolute()) if value and Path(value).exists() else value
