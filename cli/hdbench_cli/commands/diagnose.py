"""`hdbench diagnose`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hdbench.diagnosis import Diagnosis, DiagnosisOptions, diagnose_run, diagnose_runs_together
from hdbench.errors import DoubtfulDataError, LimitError, UsageError
from hdbench.model import describe_causes, user_causes
from hdbench.profile import Profile
from hdbench.records import result_header
from hdbench_cli.inputs import choose_profile
from hdbench_cli.output import Output, progress_bar
from hdbench_cli.text import Lines


def _list_causes(output: Output, cause_files: tuple[Path, ...]) -> None:

    causes = describe_causes(user_causes(cause_files))
    rows = [f"{cause['name']:<28}{cause['equation']}" for cause in causes]
    output.result({"causes": causes}, rows, kind="causes")


def diagnose_command(
    output: Output,
    /,
    sources: tuple[Path, ...],
    profile_name: str | None,
    drive: str | None,
    out: Path,
    together: bool,
    check: bool,
    list_causes: bool,
    **asked: Any,
) -> None:
    """Show what the simulation gets wrong, name the cause, extend the model, measure the gain."""
    if list_causes:
        _list_causes(output, asked["cause_files"])
        return
    if not sources:
        raise UsageError(
            "nothing to diagnose",
            where="hdbench diagnose",
            fix="name a run folder, a trace or a loads file, or ask for --list-causes",
        )
    from hdbench_cli.commands import diagnosis_text

    options = DiagnosisOptions(**asked)
    profiles = [choose_profile(profile_name, source, drive) for source in sources]
    done: list[tuple[Path, Diagnosis]] = []
    if together:
        _one_bench(sources, profiles)
        with progress_bar("diagnose") as progress:
            done.append(
                diagnose_runs_together(
                    sources, profiles[0], out=out, options=options, progress=progress
                )
            )
    for source, profile in () if together else zip(sources, profiles, strict=True):
        with progress_bar("diagnose") as progress:
            done.append(diagnose_run(source, profile, out=out, options=options, progress=progress))
    bodies = [_named(found, folder) for folder, found in done]
    whole = bodies[0] if len(bodies) == 1 else {**result_header("list", None), "diagnoses": bodies}

    def lines() -> Lines:
        for folder, found in done:
            yield from diagnosis_text.lines(found, folder)
            yield f"{'run':<11}{folder}"

    output.result(whole, lines())
    _end(output, done, check)


def _one_bench(sources: Sequence[Path], profiles: Sequence[Profile]) -> None:
    """Refuse runs that were measured on different benches, unless --profile says which it is."""
    for source, profile in zip(sources, profiles, strict=True):
        if profile.sha256 != profiles[0].sha256:
            raise UsageError(
                f"--together with profiles {profiles[0].name!r} of {sources[0]} and "
                f"{profile.name!r}, which differ; needed: records of one drive",
                where=str(source),
                fix="leave out the records of the other bench, or name the bench with --profile",
            )


def _named(found: Diagnosis, folder: Path) -> dict[str, Any]:
    """Return the result with its folder, and the model file as other commands take it.

    Inside the run folder the model file stands by its name, so that the folder can be moved; here
    its whole path stands, which --model takes from any working folder.
    """
    path = None if found.model_file is None else str((folder / found.model_file).resolve())
    return {**found.to_json(), "model_file": path, "run_folder": str(folder)}


def _end(output: Output, done: list[tuple[Path, Diagnosis]], check: bool) -> None:
    """End with the code of a failed check, or of doubtful data; the result is out already."""
    failed = [(folder, found) for folder, found in done if found.verdict != "nothing-found"]
    flagged = [(folder, found) for folder, found in done if found.data_flags]
    if check and failed:
        folder, found = failed[0]
        output.end(
            LimitError(
                f"verdict {found.verdict}; needed: nothing-found",
                where=str(folder),
                fix="look at the causes, or diagnose with --model and the extended model",
            )
        )
    if flagged:
        folder, found = flagged[0]
        names = sorted({flag.name for flag in found.data_flags})
        output.end(
            DoubtfulDataError(
                f"finished, but the data are doubtful: {', '.join(names)}",
                where=str(folder),
                fix="look at the marked samples, then measure again",
            )
        )
