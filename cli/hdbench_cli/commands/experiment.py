"""Experiments: a run or a stored one is evaluated, shown, and judged."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from hdbench.devices.operator import parse_mistakes
from hdbench.diagnosis.planning import read_plan
from hdbench.diagnosis.planning.segments import MotionPlan
from hdbench.errors import DoubtfulDataError, LimitError, UsageError
from hdbench.profile import Profile
from hdbench.profile.scaling import checked_age, read_calibration
from hdbench.records import RunFolder
from hdbench.records.exporting import export_records, gather
from hdbench.records.parquetfile import require_parquet
from hdbench.records.runfolder import utc_now
from hdbench.ripple import Stretch
from hdbench.session import BenchOptions, evaluate_stored, make_plan, run_experiment
from hdbench.session.experiments import profile_of, resume_run, stored_address
from hdbench.session.plans import Plan
from hdbench_cli.asking.operator import ConsoleOperator, Who, calibration_talk, silent
from hdbench_cli.commands.experiment_text import LINES, doubts_of, failed
from hdbench_cli.inputs import choose_profile
from hdbench_cli.live.view import live_view
from hdbench_cli.next_step import after_run, next_line
from hdbench_cli.output import Output
from hdbench_cli.text import Lines


@dataclass(frozen=True, slots=True)
class Request:
    """What the user asked an experiment command, or `runs resume`, for; `bench` is how to run."""

    kind: str
    bench: BenchOptions
    profile_name: str | None = None
    drive: str | None = None
    source: Path | None = None
    dry_run: bool = False
    yes: bool = False
    no_input: bool = False
    check: bool = False
    no_report: bool = False
    form: str = "csv"
    stretch: Stretch | None = None
    plan_file: Path | None = None
    who: Who = "auto"
    mistakes: str = ""


def _request(kind: str, *, mistakes: str = "", **options: Any) -> Request:
    """Return the options of a command, those of the bench apart."""
    bench = {e.name: options.pop(e.name) for e in fields(BenchOptions) if e.name in options}
    return Request(kind, BenchOptions(**bench), mistakes=mistakes, **options)


def calibrate_command(output: Output, /, **options: Any) -> None:
    """Calibrate the torque sensor."""
    run(output, _request("calibration", **options))


def run_misalignment_command(output: Output, /, **options: Any) -> None:
    """Measure the misalignment torque."""
    run(output, _request("misalignment", **options))


def run_ripple_command(
    output: Output,
    /,
    velocity_above: float | None,
    from_s: float | None,
    to_s: float | None,
    **options: Any,
) -> None:
    """Measure the torque ripple."""
    stretch = Stretch(velocity_above, from_s, to_s)
    run(output, _request("ripple", stretch=stretch, **options))


def run(output: Output, request: Request) -> None:
    """Run one experiment command."""
    profile = choose_profile(request.profile_name, request.source, request.drive)
    if request.form == "parquet":
        require_parquet("--format parquet")
    if request.dry_run:
        _show_plan(output, request, profile)
        return
    if request.source is not None:
        bench = request.bench
        stored, found = evaluate_stored(
            request.kind,
            request.source,
            profile,
            out=bench.out,
            calibration=bench.calibration,
            misalignment=bench.misalignment,
            filter_name=bench.filter_name,
            stretch=request.stretch,
        )
        folder, result = stored.path, found.to_json()
    else:
        with _watched(output, request, profile) as (options, progress):
            outcome = run_experiment(request.kind, profile, options, progress)
        folder, result = outcome.folder.path, outcome.result.to_json()
    if request.form == "parquet":
        _keep_parquet(folder, profile)
    _present(output, request, profile, folder, result)


def resume_command(output: Output, /, run: Path, realtime: bool, **options: Any) -> None:
    """Go on with a run that was stopped, and show its result."""
    folder = RunFolder.open(run)
    request = _request(str(folder.manifest["kind"]), out=run.parent, **options)
    # without the option the bench keeps time as it did before
    address = request.bench.address or stored_address(folder)
    bench = replace(request.bench, address=address, realtime=realtime or None)
    request = replace(request, bench=bench)
    profile = profile_of(folder)
    with _watched(output, request, profile) as (asked, progress):
        outcome = resume_run(run, asked, progress)
    _present(output, request, profile, outcome.folder.path, outcome.result.to_json())


@contextmanager
def _watched(
    output: Output, request: Request, profile: Profile
) -> Iterator[tuple[BenchOptions, Callable[[str, float], None]]]:
    """Yield the options of a run and its progress: with who answers, or with a live view."""
    person = request.yes or not request.no_input
    options = replace(
        request.bench,
        operator=ConsoleOperator(motion_confirmed=request.yes) if person else None,
        motion=_motion(request),
        mistakes=parse_mistakes(request.mistakes),
    )
    if request.kind == "calibration":
        with calibration_talk(
            output,
            request.who,
            profile,
            no_input=request.no_input,
            address=options.address,
            control=options.control,
        ) as (talk, rehearse, progress):
            yield replace(options, talk=talk, rehearse=rehearse), progress
        return
    with live_view(request.kind, profile, options.out) as watcher:
        yield replace(options, watcher=watcher), silent


def _motion(request: Request) -> MotionPlan | None:
    """Return the content of the plan file that was asked for."""
    if request.plan_file is None:
        return None
    motion = read_plan(request.plan_file)
    if motion.needs_operator and request.no_input and not request.dry_run:
        raise UsageError(
            f"the plan needs an operator ({len(motion.loads)} load steps, first: "
            f"{motion.loads[0].text})",
            where=f"{request.plan_file} with --no-input",
            fix="run it without --no-input, or make a plan with hdbench plan --no-loads",
        )
    return motion


def _keep_parquet(folder: Path, profile: Profile) -> None:
    """Write the run's data as Parquet beside the CSV file, listed among the run's files."""
    made = export_records(gather(folder, profile.data.arm), folder, "parquet")
    RunFolder.open(folder).add_files([made])


def _show_plan(output: Output, request: Request, profile: Profile) -> None:
    plan = make_plan(request.kind, profile, _motion(request), preset=request.bench.preset)
    age = _calibration_age(request, profile)
    limits = profile.data.limits.model_dump(exclude_none=True)

    def lines() -> Iterator[str]:
        yield f"{plan.kind} on {profile.data.name}: {plan.duration_s:.0f} s of bench time"
        if plan.preset is not None:
            yield _handling(plan)
        yield from (f"  {line}" for line in plan.lines())
        yield "limits  " + ", ".join(f"{k} {v:g}" for k, v in limits.items())
        if age:
            yield f"gain    {age}"
        yield "nothing has moved"

    body = {"plan": plan.to_dict(), "limits": limits}
    output.result(body, lines(), kind="plan", profile=profile)


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
    if request.bench.calibration is None:
        return ""
    scale = checked_age(
        read_calibration(request.bench.calibration),
        request.bench.calibration,
        profile,
        now=utc_now(),
        allow_expired=request.bench.allow_expired,
    )
    return f"{scale.source}: {scale.age_words}"


def _present(
    output: Output, request: Request, profile: Profile, folder: Path, result: Mapping[str, Any]
) -> None:
    """Write the report of a finished run, show its result, and say what speaks against it."""
    if not request.no_report:
        from hdbench.report import write_report

        write_report([folder], folder / "report.html", profile=profile)

    def lines() -> Lines:
        yield from LINES[request.kind](result)
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
                calibration=request.bench.calibration,
            )
        )

    output.result({**result, "run_folder": str(folder)}, lines())
    reason = failed(request.kind, result) if request.check else None
    if reason:
        output.end(LimitError(reason, where=str(folder), fix="see report.html of this run"))
    if doubts := doubts_of(result):
        what = "finished, but the data are doubtful: " + "; ".join(doubts)
        output.end(DoubtfulDataError(what, where=str(folder), fix=_doubt_fix(folder)))


def _doubt_fix(folder: Path) -> str:
    """Return what to do about doubtful data: a file can be brought in anew, a run measured anew."""
    details = RunFolder.open(folder).manifest.get("details", {})
    if isinstance(details, dict) and "source" in details:
        return (
            "look at the report; where columns or units are wrong bring the file in again: "
            "hdbench import --map"
        )
    return "look at the marked samples, then measure again"
