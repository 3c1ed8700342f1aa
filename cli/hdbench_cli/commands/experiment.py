"""What the three experiment commands share: plan, run or re-evaluate, show."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from hdbench.errors import UsageError
from hdbench_cli.commands.outcome import Shown, present
from hdbench_cli.next_step import after_run
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

    from hdbench.diagnosis.planning.segments import MotionPlan
    from hdbench.profile import Profile
    from hdbench.ripple import Stretch
    from hdbench.session.calibrating.plan import Preset

__all__ = ["Request", "choose_profile", "run_command"]

_DEFAULT_PROFILE = "cim-tr-97-06"


@dataclass(frozen=True, slots=True)
class Request:
    """What the user asked an experiment command for."""

    kind: str
    profile_name: str | None
    out: Path
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
    realtime: bool = False
    no_report: bool = False
    form: str = "csv"
    calibration: Path | None = None
    allow_expired: bool = False
    misalignment: Path | None = None
    filter_name: str | None = None
    stretch: Stretch | None = None
    plan_file: Path | None = None
    preset: Preset | None = None
    who: Literal["auto", "person", "simulated"] = "auto"
    mistakes: str = ""


def choose_profile(name: str | None, source: Path | None, drive: str | None = None) -> Profile:
    """Return the named profile, else the stored run's own, else the default."""
    from hdbench.profile import load_profile, parse_profile

    manifest: dict[str, Any] = {}
    if source is not None and (source / "run.json").is_file():
        from hdbench.records.jsonfile import read_json

        manifest = read_json(source / "run.json", None)
    stored = manifest.get("profile")
    if name is None and isinstance(stored, dict) and isinstance(stored.get("text"), str):
        profile = parse_profile(stored["text"], f"{source}/run.json: profile")
    else:
        profile = load_profile(name or _DEFAULT_PROFILE)
    known = manifest.get("drive")
    named = drive or (known if isinstance(known, str) else "") or profile.drive
    return replace(profile, drive=named)


def run_command(
    output: Output,
    request: Request,
    show: Callable[[Console, Mapping[str, Any]], None],
    failed: Callable[[Mapping[str, Any]], str | None],
) -> None:
    """Run one experiment command."""
    profile = choose_profile(request.profile_name, request.source, request.drive)
    if request.plan_file is not None and request.source is not None:
        raise UsageError(
            "--plan and --from together; needed: one, a stored run has its own motion",
            where="--plan",
            fix="leave out --from to measure, or --plan to evaluate again",
        )
    if request.form == "parquet":
        from hdbench.records.tables import require_parquet

        require_parquet("--format parquet")
    if request.dry_run:
        _show_plan(output, request, profile)
        return
    if request.source is not None:
        folder, result = _from_stored(request, profile)
    else:
        folder, result = _measure(output, request, profile)
    if request.form == "parquet":
        _keep_parquet(folder, profile)

    def then(folder: Path, result: Mapping[str, Any]) -> str:
        name, gain = request.profile_name, request.calibration
        return after_run(request.kind, folder, result, profile_name=name, calibration=gain)

    present(output, request, profile, (folder, result), Shown(show, failed, then))


def _keep_parquet(folder: Path, profile: Profile) -> None:
    """Write the run's data as Parquet beside the CSV file, listed among the run's files."""
    from hdbench.records import RunFolder
    from hdbench.records.exporting import export_records, gather

    made = export_records(gather(folder, profile.data.arm), folder, "parquet")
    RunFolder.open(folder).add_files([made])


def _show_plan(output: Output, request: Request, profile: Profile) -> None:
    from hdbench.records import result_header
    from hdbench.session import make_plan
    from hdbench_cli.asking.choice import handling_words

    plan = make_plan(request.kind, profile, _motion(request), preset=request.preset)
    age = _calibration_age(request, profile)
    limits = profile.data.limits.model_dump(exclude_none=True)

    def text(console: Console) -> None:
        console.print(f"{plan.kind} on {profile.data.name}: {plan.duration_s:.0f} s of bench time")
        if plan.preset is not None:
            console.print(handling_words(plan))
        for line in plan.lines():
            console.print(f"  {line}", markup=False)
        console.print("limits  " + ", ".join(f"{k} {v:g}" for k, v in limits.items()))
        if age:
            console.print(f"gain    {age}", markup=False, highlight=False, soft_wrap=True)
        console.print("nothing has moved")

    header = result_header("plan", profile)
    output.result({**header, "plan": plan.to_dict(), "limits": limits}, text)


def _silent(_what: str, _share: float) -> None:
    """Leave the phase to the frames of the run."""


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
    return folder.path, found.result.to_json()


def _measure(output: Output, request: Request, profile: Profile) -> tuple[Path, Mapping[str, Any]]:
    from hdbench.devices.operator import parse_mistakes
    from hdbench.session import BenchOptions, run_experiment
    from hdbench_cli.asking.choice import attendance
    from hdbench_cli.asking.operator import ConsoleOperator
    from hdbench_cli.live.view import live_view

    person = request.yes or not request.no_input
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
        control=request.control,
        realtime=request.realtime,
        calibration=request.calibration,
        allow_expired=request.allow_expired,
        misalignment=request.misalignment,
        filter_name=request.filter_name,
        operator=operator,
        motion=motion,
        preset=request.preset,
        mistakes=parse_mistakes(request.mistakes),
    )
    if request.kind == "calibration":
        with attendance(output, request.who, profile, request) as (talk, rehearse, progress):
            asked = replace(options, talk=talk, rehearse=rehearse)
            outcome = run_experiment(request.kind, profile, asked, progress)
    else:
        with live_view(request.kind, profile, request.out) as watcher:
            watched = replace(options, watcher=watcher)
            outcome = run_experiment(request.kind, profile, watched, _silent)
    return outcome.folder.path, outcome.evaluation.result.to_json()
