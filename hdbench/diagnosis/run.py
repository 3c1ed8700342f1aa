"""Run folder of a diagnosis: result, extended model, residual and spectra."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic.dataclasses import dataclass as checked

from hdbench.diagnosis.answer.filter_gain import filter_gain
from hdbench.diagnosis.answer.result import Diagnosis
from hdbench.diagnosis.answer.tables import code_map, write_pictures, write_table
from hdbench.diagnosis.dynamic import diagnose_trace
from hdbench.diagnosis.evidence import Told, silent
from hdbench.diagnosis.inspection import inspect_trace
from hdbench.diagnosis.planning import plan_for_causes, write_plan
from hdbench.diagnosis.static import diagnose_loads
from hdbench.diagnosis.together import diagnose_together
from hdbench.errors import DataError, UsageError
from hdbench.model import BenchModel, load_model, motion_from_trace, save_model, user_causes
from hdbench.profile import Profile
from hdbench.profile.scaling import rescaled, stored_scale
from hdbench.records import (
    RunFolder,
    Trace,
    input_identity,
    is_loads_file,
    read_json,
    read_loads,
    read_trace,
    resolve_input,
    write_json,
)
from hdbench.results import ProfileName
from hdbench.results.diagnosis import DiagnosedPart, SeparatingRun

# samples of one diagnosis at most: ten minutes at 1 kHz, the longest records of the blind
# benchmark; memory grows by some 4 kB a sample
MOST_SAMPLES = 600_000


def part_of(
    trace: Trace,
    from_s: float | None = None,
    to_s: float | None = None,
    *,
    most: int = MOST_SAMPLES,
) -> tuple[Trace, DiagnosedPart | None]:
    """Return the part of a record to diagnose."""
    time_s = trace.time_s
    begin = 0 if from_s is None else int(np.searchsorted(time_s, from_s, side="left"))
    end = len(trace) if to_s is None else int(np.searchsorted(time_s, to_s, side="right"))
    if end <= begin:
        raise DataError(
            f"no sample from {'the start' if from_s is None else f'{from_s:g} s'} to "
            f"{'the end' if to_s is None else f'{to_s:g} s'}; "
            f"the record runs from {time_s[0]:g} to {time_s[-1]:g} s",
            where=trace.source,
            fix="name times of the record's own clock, the earlier one first",
        )
    kept = min(end - begin, most)
    if kept == len(trace):
        return trace, None
    columns = {name: column[begin : begin + kept] for name, column in trace.columns.items()}
    held = Trace(columns, trace.source, trace.metadata)
    ends = float(held.time_s[0]), float(held.time_s[-1])
    return held, DiagnosedPart(*ends, kept, len(trace), kept < end - begin)


@checked(frozen=True, slots=True)
class DiagnosisOptions:
    """What a diagnosis can be asked for."""

    # bench model to hold against the record; the profile's where None
    model_file: Path | None = None
    alpha: float = 0.01  # probability of any finding on a record without an effect
    # smallest share of the residual variance of a cause that counts
    materiality: float = 0.01
    seed: int = 0  # of the draws
    # terms of the baseline to add or remove, such as ``-misalignment`` or ``+order:6``
    baseline: tuple[str, ...] = ()
    cause_files: tuple[Path, ...] = ()  # TOML files with causes of the user's own
    # first and last time of a dynamic run to look at, s; its ends where None
    from_s: float | None = None
    to_s: float | None = None


@dataclass(frozen=True, slots=True)
class _Input:
    """What is diagnosed: a file, and where it holds a run the part of it in N m."""

    identity: dict[str, Any]  # path and digest, and what it was imported from
    file: Path
    trace: Trace | None = None  # None for calibration loads
    stated: Mapping[str, Any] = field(default_factory=dict)  # what a result says of the trace


def diagnose_run(
    source: Path,
    profile: Profile,
    *,
    out: Path,
    options: DiagnosisOptions | None = None,
    progress: Told = silent,
) -> tuple[Path, Diagnosis]:
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
    progress : callable
        Called with what is being done and the share done.

    Returns
    -------
    folder : Path
        Run folder with ``result.json`` and, for a dynamic run, model, residual and spectra.
    result : Diagnosis
        The result as ``result.json`` holds it.

    Raises
    ------
    DataError, StorageError
        If the input cannot be read, or the folder cannot be written.
    """
    chosen = options or DiagnosisOptions()
    asked = _asked(chosen, profile, progress)
    # an input that cannot be used must not leave an empty run behind
    given = _input(source, profile, chosen)
    if given.trace is None:
        _refuse_for_loads(chosen, given.file)
        answer = diagnose_loads(read_loads(given.file, profile.data.arm), profile, **asked)
    else:
        answer = diagnose_trace(given.trace, profile, baseline=chosen.baseline, **asked)
    return _stored(answer, given, profile, out)


def diagnose_runs_together(
    sources: Sequence[Path],
    profile: Profile,
    *,
    out: Path,
    options: DiagnosisOptions | None = None,
    progress: Told = silent,
) -> tuple[Path, Diagnosis]:
    """Diagnose several dynamic runs of one drive at once, and store one diagnosis.

    Parameters
    ----------
    sources : sequence of Path
        Run folders or traces, two or more, each named once.
    profile, out, options, progress : as by `diagnose_run`
        The folder has one extended model of all.

    Returns
    -------
    tuple of Path and Diagnosis
        As by `diagnose_run`; the result has `records`.

    Raises
    ------
    UsageError
        If there is one input only, one is there twice, or one holds calibration loads.
    """
    chosen = options or DiagnosisOptions()
    most = MOST_SAMPLES // max(1, len(sources))
    inputs = [_input(source, profile, chosen, most) for source in sources]
    traces = _check_together(inputs)
    answer = diagnose_together(
        traces,
        [str(source) for source in sources],
        profile,
        baseline=chosen.baseline,
        **_asked(chosen, profile, progress),
    )
    parts = zip(answer.records, inputs, strict=True)
    records = tuple(replace(part, **one.identity, **one.stated) for part, one in parts)
    used = next(one for part, one in zip(records, inputs, strict=True) if not part.left_out)
    return _stored(replace(answer, records=records), used, profile, out)


def _check_together(inputs: Sequence[_Input]) -> list[Trace]:
    """Return the traces of inputs that can be taken together."""
    if len(inputs) < 2:
        raise UsageError(
            f"--together with {len(inputs)} record; needed: 2 or more of one drive",
            where="hdbench diagnose",
            fix="name more records, or leave out --together",
        )
    traces: dict[str, Trace] = {}
    names: dict[str, str] = {}
    for one in inputs:
        name, digest = one.identity["input"], one.identity["input_sha256"]
        if one.trace is None:
            raise UsageError(
                "--together with calibration loads; needed: dynamic runs",
                where=str(one.file),
                fix="diagnose the loads alone: one file holds all experiments of a calibration",
            )
        if digest in traces:
            raise UsageError(
                f"the same record as {names[digest]}; needed: each record once",
                where=name,
                fix="leave one of them out: a copy is no evidence",
            )
        traces[digest], names[digest] = one.trace, name
    return list(traces.values())


def _stored(
    answer: Diagnosis, given: _Input, profile: Profile, out: Path
) -> tuple[Path, Diagnosis]:
    """Write a diagnosis as a run folder; of several records `given` is the first."""
    from hdbench import __version__

    folder = RunFolder.create(out, kind="diagnosis", profile=profile, details=given.identity)
    files = ["result.json", *_write_tables(folder.path, answer, given, profile)]
    gain, proposal = None, None
    if given.trace is not None and answer.pictures is not None:
        motion, extra = motion_from_trace(given.trace, profile.data), answer.model.extra_causes
        proposal = plan_for_causes(answer.causes, profile.data, motion=motion, extra=extra)
        if not answer.records:
            gain = filter_gain(given.trace, motion, profile, answer)
    separating = None
    if proposal is not None:
        separating = SeparatingRun(file=None, words=proposal.words)
        if proposal.plan is not None:
            write_plan(folder.path / "plan.toml", proposal.plan)
            files.append("plan.toml")
            separating = replace(separating, file="plan.toml")
    extended = answer.pictures is not None or answer.load_pictures is not None
    if extended:
        provenance = {"diagnosis": folder.run_id, **given.identity}
        save_model(folder.path / "model.json", answer.model, profile=profile, provenance=provenance)
        files.append("model.json")
    result = replace(
        answer,
        hdbench_version=__version__,
        profile=ProfileName(name=profile.name, sha256=profile.sha256),
        model_file="model.json" if extended else None,
        filter_gain=gain,
        separating_run=separating,
        **given.identity,
        **given.stated,
    )
    write_json(folder.result, result.to_json())
    folder.finish("complete", f"diagnosis: {answer.verdict}", files)
    return folder.path, result


def _asked(options: DiagnosisOptions, profile: Profile, progress: Told) -> dict[str, Any]:
    """Return what every kind of diagnosis is asked for."""
    # the profile's own model where no other and no causes of the user's own are given
    model = load_model(options.model_file) if options.model_file else None
    own = user_causes(options.cause_files)
    return {
        "model": (model or BenchModel.from_profile(profile.data)).with_extra(own) if own else model,
        "alpha": options.alpha,
        "materiality": options.materiality,
        "seed": options.seed,
        "progress": progress,
    }


def _input(
    source: Path, profile: Profile, options: DiagnosisOptions, most: int = MOST_SAMPLES
) -> _Input:
    """Return an input; of a run the part to diagnose, scaled to N m."""
    file = resolve_input(Path(source))
    found = input_identity(file)
    identity = {"input": str(source), "input_sha256": found["sha256"]}
    identity |= {key: found[key] for key in ("imported",) if key in found}
    if is_loads_file(file):
        return _Input(identity, file)
    held, part = part_of(read_trace(file), options.from_s, options.to_s, most=most)
    stored, manifest = None, Path(source) / "run.json"
    if manifest.is_file():
        stored = stored_scale(read_json(manifest).get("calibration"), Path(source))
    # by its own gain, that of the run's calibration, or the profile's
    trace, scale = rescaled(held, profile, calibration=None, stored=stored)
    log = inspect_trace(held, profile.data).to_dict()
    return _Input(identity, file, trace, {"torque_scale": scale, "part": part, "inspection": log})


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


def _write_tables(folder: Path, answer: Diagnosis, given: _Input, profile: Profile) -> list[str]:
    """Write every table of the diagnosis and return the names."""
    if answer.load_pictures is not None:
        write_table(folder / "residual.csv", answer.load_pictures)
        return ["residual.csv"]
    if answer.pictures is None:
        return []
    files = write_pictures(folder, answer.pictures)
    if given.trace is not None and not answer.records and "torque_v" in given.trace:
        daq = profile.data.daq
        step_v = 2.0 * daq.range_v / 2**daq.resolution_bits
        write_table(folder / "map_code.csv", code_map(given.trace["torque_v"], step_v))
        files.append("map_code.csv")
    return files
