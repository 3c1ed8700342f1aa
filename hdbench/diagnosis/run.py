"""A diagnosis as a run folder: result, extended model, residual and spectra."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdbench.diagnosis.answer.files import write_pictures, write_table
from hdbench.diagnosis.answer.filtergain import filter_gain
from hdbench.diagnosis.answer.maps import code_map
from hdbench.diagnosis.answer.result import Diagnosis
from hdbench.diagnosis.dynamic import diagnose_trace
from hdbench.diagnosis.inspection import Inspection, inspect_trace
from hdbench.diagnosis.part import Part, part_of
from hdbench.diagnosis.planning import Proposal, plan_for_result, write_plan
from hdbench.diagnosis.static import diagnose_loads
from hdbench.errors import UsageError
from hdbench.model import (
    BenchModel,
    Motion,
    load_model,
    motion_from_trace,
    save_model,
    user_causes,
)
from hdbench.profile import Profile
from hdbench.profile.scaling import rescaled, stored_scale
from hdbench.records import (
    RunFolder,
    TorqueScale,
    Trace,
    input_identity,
    is_loads_file,
    read_json,
    read_loads,
    read_trace,
    resolve_input,
    result_header,
    write_json,
)

__all__ = ["DiagnosisOptions", "diagnose_run"]


@dataclass(frozen=True, slots=True)
class DiagnosisOptions:
    """What a diagnosis can be asked for.

    Parameters
    ----------
    model_file : Path or None
        Bench model to hold against the record; the profile's where None.
    alpha : float
        Probability of any finding on a record without an effect.
    materiality : float
        Smallest share of the residual variance of a cause that counts.
    seed : int
        Seed of the draws.
    baseline : tuple of str
        Terms of the baseline to add or remove, such as ``-misalignment`` or ``+order:6``.
    cause_files : tuple of Path
        TOML files with causes of the user's own.
    from_s, to_s : float or None
        First and last time of a dynamic run to look at, s; its ends where None.
    """

    model_file: Path | None = None
    alpha: float = 0.01
    materiality: float = 0.01
    seed: int = 0
    baseline: tuple[str, ...] = ()
    cause_files: tuple[Path, ...] = ()
    from_s: float | None = None
    to_s: float | None = None


@dataclass(frozen=True, slots=True)
class _Done:
    """A diagnosis and what belongs to it; trace and scale are None for calibration loads.

    `part` says what of the record was looked at, None for the whole; `log` what it can tell.
    """

    answer: Diagnosis
    trace: Trace | None = None
    scale: TorqueScale | None = None
    part: Part | None = None
    log: Inspection | None = None


def diagnose_run(
    source: Path,
    profile: Profile,
    *,
    out: Path,
    options: DiagnosisOptions | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> tuple[Path, dict[str, Any]]:
    """Diagnose a stored trace, loads file or run, and store the diagnosis.

    Parameters
    ----------
    source : Path
        A run folder, a trace or a loads file; its columns tell which.
    profile : Profile
        Bench.
    out : Path
        Parent folder of run folders.
    options : DiagnosisOptions or None
        Settings; the defaults where None.
    progress : callable or None
        Called with what is being done and the share done.

    Returns
    -------
    folder : Path
        Run folder with ``result.json`` and, for a dynamic run, ``model.json``,
        ``residual.csv`` and spectra.
    result : dict
        The result object.

    Raises
    ------
    DataError
        If the input cannot be read.
    StorageError
        If the folder cannot be written.
    """
    chosen = options or DiagnosisOptions()
    file = resolve_input(Path(source))
    # an input that cannot be used must not leave an empty run behind
    done = _diagnose(file, Path(source), profile, chosen, progress)
    answer = done.answer
    identity = input_identity(file)
    details = {"input": str(source), "input_sha256": identity["sha256"]}
    details |= {key: identity[key] for key in ("imported",) if key in identity}
    folder = RunFolder.create(out, kind="diagnosis", profile=profile, details=details)
    files = ["result.json", *_write_tables(folder.path, done, profile)]
    motion = None
    if done.trace is not None and answer.pictures is not None:
        motion = motion_from_trace(done.trace, profile.data)
    proposal = _proposal(answer, profile, motion)
    if proposal is not None and proposal.plan is not None:
        write_plan(folder.path / "plan.toml", proposal.plan)
        files.append("plan.toml")
    extended = answer.pictures is not None or answer.load_pictures is not None
    if extended:
        provenance = {"diagnosis": folder.run_id, **details}
        save_model(folder.path / "model.json", answer.model, profile=profile, provenance=provenance)
        files.append("model.json")
    header = result_header("diagnosis", profile)
    result = {
        **answer.to_dict(header, "model.json" if extended else None),
        **details,
        "torque_scale": None if done.scale is None else done.scale.to_dict(),
        "filter_gain": _gain(done, profile, motion),
        "separating_run": _separating(proposal),
        "part": None if done.part is None else done.part.to_dict(),
        "inspection": None if done.log is None else done.log.to_dict(),
    }
    write_json(folder.result, result)
    folder.finish("complete", f"diagnosis: {answer.verdict}", files)
    return folder.path, result


def _diagnose(
    file: Path,
    source: Path,
    profile: Profile,
    options: DiagnosisOptions,
    progress: Callable[[str, float], None] | None,
) -> _Done:
    model = _given(options, profile)
    if is_loads_file(file):
        _refuse_for_loads(options, file)
        static = diagnose_loads(
            read_loads(file, profile.data.arm),
            profile,
            model=model,
            alpha=options.alpha,
            materiality=options.materiality,
            seed=options.seed,
            progress=progress,
        )
        return _Done(static)
    held, part = part_of(read_trace(file), options.from_s, options.to_s)
    trace, scale = _scaled(held, source, profile)
    answer = diagnose_trace(
        trace,
        profile,
        model=model,
        alpha=options.alpha,
        materiality=options.materiality,
        seed=options.seed,
        progress=progress,
        baseline=options.baseline,
    )
    return _Done(answer, trace, scale, part, inspect_trace(held, profile.data))


def _refuse_for_loads(options: DiagnosisOptions, file: Path) -> None:
    if options.baseline:
        raise UsageError(
            f"--baseline {options.baseline[0]} with calibration loads; needed: a dynamic run",
            where=str(file),
            fix="leave out --baseline: readings have one gain and one zero per experiment",
        )
    if options.from_s is not None or options.to_s is not None:
        raise UsageError(
            "--from-s or --to-s with calibration loads, which have no clock; needed: a dynamic run",
            where=str(file),
            fix="leave them out",
        )


def _given(options: DiagnosisOptions, profile: Profile) -> BenchModel | None:
    """Return the model at hand with the user's own causes; None for the profile's as it is."""
    model = load_model(options.model_file) if options.model_file else None
    own = user_causes(options.cause_files)
    return (model or BenchModel.from_profile(profile.data)).with_extra(own) if own else model


def _write_tables(folder: Path, done: _Done, profile: Profile) -> list[str]:
    """Write every table of the diagnosis and return the names."""
    if done.answer.load_pictures is not None:
        write_table(folder / "residual.csv", done.answer.load_pictures)
        return ["residual.csv"]
    if done.answer.pictures is None:
        return []
    files = write_pictures(folder, done.answer.pictures)
    if done.trace is not None and "torque_v" in done.trace:
        daq = profile.data.daq
        step_v = 2.0 * daq.range_v / 2**daq.resolution_bits
        write_table(folder / "map_code.csv", code_map(done.trace["torque_v"], step_v))
        files.append("map_code.csv")
    return files


def _gain(done: _Done, profile: Profile, motion: Motion | None) -> dict[str, Any] | None:
    """Return what the filter gains by the orders found; None where none was."""
    if done.trace is None or motion is None:
        return None
    gain = filter_gain(done.trace, motion, profile, done.answer)
    return None if gain is None else gain.to_dict()


def _proposal(answer: Diagnosis, profile: Profile, motion: Motion | None) -> Proposal | None:
    """Return the run that settles what is open; None for loads and where nothing is."""
    if motion is None:
        return None
    extra = answer.model.extra_causes
    return plan_for_result(answer.to_dict({}), profile.data, motion=motion, extra=extra)


def _separating(proposal: Proposal | None) -> dict[str, Any] | None:
    """Return what the proposed run settles, in words, and its file."""
    if proposal is None:
        return None
    return {
        "file": None if proposal.plan is None else "plan.toml",
        "words": list(proposal.words),
    }


def _scaled(trace: Trace, source: Path, profile: Profile) -> tuple[Trace, TorqueScale]:
    """Return the trace in N m and by which gain: its own, the run's calibration, the profile's."""
    stored = None
    if (source / "run.json").is_file():
        stored = stored_scale(read_json(source / "run.json").get("calibration"), source)
    return rescaled(trace, profile, calibration=None, stored=stored)
