"""Experiments: a run or a stored one is evaluated, shown, and judged."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from hdbench.errors import DoubtfulDataError, LimitError, UsageError
from hdbench_cli.asking.operator import ConsoleOperator, Who, calibration_talk, silent
from hdbench_cli.inputs import choose_profile
from hdbench_cli.next_step import after_run, next_line
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import RenderableType

    from hdbench.diagnosis.planning.segments import MotionPlan
    from hdbench.profile import Profile
    from hdbench.ripple import Stretch
    from hdbench.session import BenchOptions, RunOutcome
    from hdbench.session.calibrating.plan import Preset
    from hdbench.session.plans import Plan


@dataclass(frozen=True, slots=True)
class Request:
    """What the user asked an experiment command, or `runs resume`, for."""

    kind: str
    profile_name: str | None = None
    out: Path = Path("runs")
    drive: str | None = None
    source: Path | None = None
    address: str | None = None
    control: str | None = None
    plant: str = "as-modelled"
    seed: int = 0
    dry_run: bool = False
    yes: bool = False
    no_input: bool = False
    check: bool = False
    realtime: bool | None = False
    no_report: bool = False
    form: str = "csv"
    calibration: Path | None = None
    allow_expired: bool = False
    misalignment: Path | None = None
    filter_name: str | None = None
    stretch: Stretch | None = None
    plan_file: Path | None = None
    preset: Preset | None = None
    who: Who = "auto"
    mistakes: str = ""


def shown_of(kind: str) -> ModuleType:
    """Return the command module of a kind of run: its `lines` show a result, `failed` judges it."""
    name = {"calibration": "calibrate", "misalignment": "run_misalignment", "ripple": "run_ripple"}
    return importlib.import_module(f"hdbench_cli.commands.{name[kind]}")


def doubts_of(result: Mapping[str, Any]) -> list[str]:
    """Return every reason to doubt a result: what the run saw and what its data show."""
    flags = [str(flag["detail"]) for flag in result.get("flags", ())]
    return [*map(str, result.get("doubts", ())), *flags]


def run(output: Output, request: Request) -> None:
    """Run one experiment command."""
    profile = choose_profile(request.profile_name, request.source, request.drive)
    if request.plan_file is not None and request.source is not None:
        raise UsageError(
            "--plan and --from together; needed: one, a stored run has its own motion",
            where="--plan",
            fix="leave out --from to measure, or --plan to evaluate again",
        )
    if request.form == "parquet":
        from hdbench.records.parquetfile import require_parquet

        require_parquet("--format parquet")
    if request.dry_run:
        _show_plan(output, request, profile)
        return
    if request.source is not None:
        folder, result = _from_stored(request, request.source, profile)
    else:
        from hdbench.session import run_experiment

        with _watched(output, request, profile) as (options, progress):
            outcome = run_experiment(request.kind, profile, options, progress)
        folder, result = _outcome(outcome)
    if request.form == "parquet":
        _keep_parquet(folder, profile)
    _present(output, request, profile, folder, result)


def resume(output: Output, path: Path, **options: Any) -> None:
    """Go on with a run that was stopped, and show its result."""
    from hdbench.records import RunFolder
    from hdbench.session.experiments import resume_run, stored_address, stored_profile

    folder = RunFolder.open(path)
    request = Request(str(folder.manifest["kind"]), out=path.parent, **options)
    request = replace(request, address=request.address or stored_address(folder))
    profile = stored_profile(folder)
    with _watched(output, request, profile) as (asked, progress):
        outcome = resume_run(path, asked, progress)
    _present(output, request, profile, *_outcome(outcome))


def _outcome(outcome: RunOutcome) -> tuple[Path, Mapping[str, Any]]:
    return outcome.folder.path, outcome.result.to_json()


@contextmanager
def _watched(
    output: Output, request: Request, profile: Profile
) -> Iterator[tuple[BenchOptions, Callable[[str, float], None]]]:
    """Yield the options of a run and its progress: with who answers, or with a live view."""
    from hdbench.devices.operator import parse_mistakes
    from hdbench.session import BenchOptions
    from hdbench_cli.live.view import live_view

    person = request.yes or not request.no_input
    asked = {entry.name: getattr(request, entry.name) for entry in fields(request)}
    of_person = {
        "operator": ConsoleOperator(motion_confirmed=request.yes) if person else None,
        "motion": _motion(request),
        "mistakes": parse_mistakes(request.mistakes),
    }
    known = {entry.name for entry in fields(BenchOptions)}
    options = BenchOptions(**{k: v for k, v in {**asked, **of_person}.items() if k in known})
    if request.kind == "calibration":
        with calibration_talk(
            output,
            request.who,
            profile,
            no_input=request.no_input,
            address=request.address,
            control=request.control,
        ) as (talk, rehearse, progress):
            yield replace(options, talk=talk, rehearse=rehearse), progress
        return
    with live_view(request.kind, profile, request.out) as watcher:
        yield replace(options, watcher=watcher), silent


def _motion(request: Request) -> MotionPlan | None:
    """Return the content of the plan file that was asked for."""
    if request.plan_file is None:
        return None
    from hdbench.diagnosis.planning import read_plan

    motion = read_plan(request.plan_file)
    if motion.needs_operator and request.no_input and not request.dry_run:
        raise UsageError(
            f"the plan needs an operator ({len(motion.loads)} load steps, first: "
            f"{motion.loads[0].text})",
            where=f"{request.plan_file} with --no-input",
            fix="run it without --no-input, or make a plan with hdbench plan --no-loads",
        )
    return motion


def _from_stored(
    request: Request, source: Path, profile: Profile
) -> tuple[Path, Mapping[str, Any]]:
    from hdbench.session import evaluate_stored

    folder, found = evaluate_stored(
        request.kind,
        source,
        profile,
        out=request.out,
        calibration=request.calibration,
        misalignment=request.misalignment,
        filter_name=request.filter_name,
        stretch=request.stretch,
    )
    return folder.path, found.to_json()


def _keep_parquet(folder: Path, profile: Profile) -> None:
    """Write the run's data as Parquet beside the CSV file, listed among the run's files."""
    from hdbench.records import RunFolder
    from hdbench.records.exporting import export_records, gather

    made = export_records(gather(folder, profile.data.arm), folder, "parquet")
    RunFolder.open(folder).add_files([made])


def _show_plan(output: Output, request: Request, profile: Profile) -> None:
    from hdbench.records import result_header
    from hdbench.session import make_plan

    plan = make_plan(request.kind, profile, _motion(request), preset=request.preset)
    age = _calibration_age(request, profile)
    limits = profile.data.limits.model_dump(exclude_none=True)

    def lines(_body: object) -> Iterator[str]:
        yield f"{plan.kind} on {profile.data.name}: {plan.duration_s:.0f} s of bench time"
        if plan.preset is not None:
            yield _handling(plan)
        yield from (f"  {line}" for line in plan.lines())
        yield "limits  " + ", ".join(f"{k} {v:g}" for k, v in limits.items())
        if age:
            yield f"gain    {age}"
        yield "nothing has moved"

    header = result_header("plan", profile)
    output.result({**header, "plan": plan.to_dict(), "limits": limits}, lines)


def _handling(plan: Plan) -> str:
    """Return how long a calibration takes with a person at the weights."""
    minutes = (plan.duration_s + plan.handling_s) / 60.0
    return (
        f"preset {plan.preset}: {len(plan.points)} points; about {minutes:.0f} min with a person: "
        f"{plan.duration_s / 60.0:.0f} min settling and reading, "
        f"{plan.handling_s / 60.0:.0f} min for weights and mountings (an estimate)"
    )


def _calibration_age(request: Request, profile: Profile) -> str:
    """Say how old the calibration is that a run would use; an expired one is refused."""
    if request.calibration is None:
        return ""
    from hdbench.profile.scaling import checked_age, read_calibration
    from hdbench.records.runfolder import utc_now

    scale = checked_age(
        read_calibration(request.calibration),
        request.calibration,
        profile,
        now=utc_now(),
        allow_expired=request.allow_expired,
    )
    return f"{scale.source}: {scale.age_words}"


def _present(
    output: Output, request: Request, profile: Profile, folder: Path, result: Mapping[str, Any]
) -> None:
    """Write the report of a finished run, show its result, and say what speaks against it."""
    shown = shown_of(request.kind)
    if not request.no_report:
        from hdbench.report import write_report

        write_report([folder], folder / "report.html", profile=profile)

    def lines(_body: object) -> Iterator[RenderableType]:
        yield from shown.lines(result)
        scale = result.get("torque_scale") or {}
        if scale.get("age_words"):
            yield f"gain          {scale['source']}: {scale['age_words']}"
        yield f"\nrun     {folder}"
        if not request.no_report:
            yield f"report  {folder / 'report.html'}"
        yield next_line(
            after_run(
                request.kind,
                folder,
                result,
                profile_name=request.profile_name,
                calibration=request.calibration,
            )
        )

    output.result({**result, "run_folder": str(folder)}, lines)
    reason = shown.failed(result) if request.check else None
    if reason:
        output.end(LimitError(reason, where=str(folder), fix="see report.html of this run"))
    if doubts := doubts_of(result):
        what = "finished, but the data are doubtful: " + "; ".join(doubts)
        output.end(DoubtfulDataError(what, where=str(folder), fix=_doubt_fix(folder)))


def _doubt_fix(folder: Path) -> str:
    """Return what to do about doubtful data: a file can be brought in anew, a run measured anew."""
    from hdbench.records import RunFolder

    details = RunFolder.open(folder).manifest.get("details", {})
    if isinstance(details, dict) and "source" in details:
        return (
            "look at the report; where columns or units are wrong bring the file in again: "
            "hdbench import --map"
        )
    return "look at the marked samples, then measure again"
