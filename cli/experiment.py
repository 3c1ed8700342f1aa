"""What the three experiment commands share: plan, run or re-evaluate, show."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdbench.errors import DoubtfulDataError, LimitError, UsageError
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

    from hdbench.diagnosis.planning import MotionPlan
    from hdbench.profile import Profile
    from hdbench.ripple import Stretch

__all__ = ["Request", "choose_profile", "doubts_of", "run_command"]

_DEFAULT_PROFILE = "cim-tr-97-06"


@dataclass(frozen=True, slots=True)
class Request:
    """What the user asked an experiment command for."""

    kind: str
    profile_name: str | None
    out: Path
    source: Path | None = None
    address: str | None = None
    plant: str = "as-modelled"
    seed: int = 0
    dry_run: bool = False
    yes: bool = False
    no_input: bool = False
    check: bool = False
    realtime: bool = False
    no_report: bool = False
    calibration: Path | None = None
    misalignment: Path | None = None
    filter_name: str | None = None
    stretch: Stretch | None = None
    plan_file: Path | None = None


def choose_profile(name: str | None, source: Path | None) -> Profile:
    """Return the named profile, else the stored run's own, else the default.

    Parameters
    ----------
    name : str or None
        What ``--profile`` said.
    source : Path or None
        A stored run or file.

    Returns
    -------
    Profile
        A valid profile.
    """
    from hdbench.profile import load_profile, parse_profile

    if name is None and source is not None and (source / "run.json").is_file():
        from hdbench.records.jsonfile import read_json

        stored = read_json(source / "run.json", None).get("profile")
        if isinstance(stored, dict) and isinstance(stored.get("text"), str):
            return parse_profile(stored["text"], f"{source / 'run.json'}: profile")
    return load_profile(name or _DEFAULT_PROFILE)


def doubts_of(result: Mapping[str, Any]) -> list[str]:
    """Return every reason to doubt a result: what the run saw and what its data show.

    Parameters
    ----------
    result : mapping
        A result with `doubts` of the run and `flags` of the data.

    Returns
    -------
    list of str
        Reasons in words; empty where there is none.
    """
    flags = [str(flag["detail"]) for flag in result.get("flags", ())]
    return [*map(str, result.get("doubts", ())), *flags]


def run_command(
    output: Output,
    request: Request,
    show: Callable[[Console, Mapping[str, Any]], None],
    failed: Callable[[Mapping[str, Any]], str | None],
) -> None:
    """Run one experiment command.

    Parameters
    ----------
    output : Output
        The command's streams.
    request : Request
        What was asked for.
    show : callable
        Draws the result for a person.
    failed : callable
        Returns why the result does not pass, or None; asked with ``--check``.

    Raises
    ------
    LimitError
        With ``--check``, when the result does not pass.
    DoubtfulDataError
        When the data are doubtful.
    """
    profile = choose_profile(request.profile_name, request.source)
    if request.plan_file is not None and request.source is not None:
        raise UsageError(
            "--plan and --from together; needed: one, a stored run has its own motion",
            where="--plan",
            fix="leave out --from to measure, or --plan to evaluate again",
        )
    if request.dry_run:
        _show_plan(output, request, profile)
        return
    if request.source is not None:
        folder, result = _from_stored(request, profile)
    else:
        folder, result = _measure(output, request, profile)
    doubts = doubts_of(result)
    if not request.no_report:
        from hdbench.report import write_report

        write_report([folder], folder / "report.html", profile=profile)

    def text(console: Console) -> None:
        show(console, result)
        console.print(f"\nrun     {folder}", highlight=False)
        if not request.no_report:
            console.print(f"report  {folder / 'report.html'}", highlight=False)

    output.result({**result, "run_folder": str(folder)}, text)
    reason = failed(result) if request.check else None
    if reason:
        _after(output, LimitError(reason, where=str(folder), fix="see report.html of this run"))
    if doubts:
        _after(
            output,
            DoubtfulDataError(
                "finished, but the data are doubtful: " + "; ".join(doubts),
                where=str(folder),
                fix="look at the marked samples, then measure again",
            ),
        )


def _after(output: Output, error: LimitError | DoubtfulDataError) -> None:
    """End with the error's code; with ``--json`` the one object is out already."""
    if output.json:
        import click

        output.note(str(error))
        raise click.exceptions.Exit(error.exit_code)
    raise error


def _show_plan(output: Output, request: Request, profile: Profile) -> None:
    from hdbench.records import result_header
    from hdbench.session import make_plan

    plan = make_plan(request.kind, profile, _motion(request))
    limits = profile.data.limits.model_dump()

    def text(console: Console) -> None:
        console.print(f"{plan.kind} on {profile.data.name}: {plan.duration_s:.0f} s of bench time")
        for number, step in enumerate(plan.steps, start=1):
            console.print(f"  {number:3d}  {step.describe()}", markup=False)
        console.print("limits  " + ", ".join(f"{k} {v:g}" for k, v in limits.items()))
        console.print("nothing has moved")

    header = result_header("plan", profile)
    output.result({**header, "plan": plan.to_dict(), "limits": limits}, text)


def _silent(_what: str, _share: float) -> None:
    """Leave the phase to the frames of the run."""


def _motion(request: Request) -> MotionPlan | None:
    """Return the content of the plan file that was asked for."""
    if request.plan_file is None:
        return None
    from hdbench.diagnosis.planning import read_plan

    return read_plan(request.plan_file)


def _from_stored(request: Request, profile: Profile) -> tuple[Path, Mapping[str, Any]]:
    from hdbench.session import evaluate_stored

    if request.source is None:
        raise UsageError("nothing to evaluate", where="--from", fix="name a file or a run")
    folder, found = evaluate_stored(
        request.kind,
        request.source,
        profile,
        out=request.out,
        calibration=request.calibration,
        misalignment=request.misalignment,
        filter_name=request.filter_name,
        stretch=request.stretch,
    )
    return folder.path, found.result


def _measure(output: Output, request: Request, profile: Profile) -> tuple[Path, Mapping[str, Any]]:
    from hdbench.session import BenchOptions, run_experiment
    from hdbench_cli.live import live_view
    from hdbench_cli.operator import ConsoleOperator
    from hdbench_cli.progress import progress_bar

    person = request.yes or not request.no_input
    if request.no_input and request.kind == "calibration":
        person = False
    operator = ConsoleOperator(motion_confirmed=request.yes) if person else None
    motion = _motion(request)
    if motion is not None and motion.needs_operator and request.no_input:
        raise UsageError(
            f"the plan needs an operator ({len(motion.loads)} load steps, first: "
            f"{motion.loads[0].text})",
            where=f"{request.plan_file} with --no-input",
            fix="run it without --no-input, or make a plan with hdbench plan --no-loads",
        )
    options = BenchOptions(
        out=request.out,
        plant=request.plant,
        seed=request.seed,
        address=request.address,
        realtime=request.realtime,
        calibration=request.calibration,
        misalignment=request.misalignment,
        filter_name=request.filter_name,
        operator=operator,
        motion=motion,
    )
    if request.kind == "calibration":
        with progress_bar(request.kind) as progress:
            outcome = run_experiment(request.kind, profile, options, progress)
    else:
        with live_view(request.kind, profile, request.out) as watcher:
            watched = replace(options, watcher=watcher)
            outcome = run_experiment(request.kind, profile, watched, _silent)
    return outcome.folder.path, outcome.evaluation.result
