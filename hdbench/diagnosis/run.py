"""Run folder of a diagnosis: result, extended model, residual and spectra."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hdbench.diagnosis.answer.filter_gain import filter_gain
from hdbench.diagnosis.answer.result import Diagnosis
from hdbench.diagnosis.answer.tables import code_map, write_pictures, write_table
from hdbench.diagnosis.dynamic import diagnose_trace
from hdbench.diagnosis.inspection import inspect_trace
from hdbench.diagnosis.inspection.result import Inspection
from hdbench.diagnosis.planning import plan_for_causes, write_plan
from hdbench.diagnosis.planning.proposal import Proposal
from hdbench.diagnosis.static import diagnose_loads
from hdbench.diagnosis.together import diagnose_together
from hdbench.errors import DataError, UsageError
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
    write_json,
)
from hdbench.results import ProfileName
from hdbench.results.diagnosis import DiagnosedPart, FilterGain, SeparatingRun

MOST_SAMPLES = 600_000
"""Samples of one diagnosis at most: ten minutes at 1 kHz, the longest records of the blind
benchmark. Memory grows by some 4 kB a sample."""


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
class _Input:
    """A trace in N m, the gain that scaled it, and what of the record it is; None for the whole."""

    trace: Trace
    scale: TorqueScale
    part: DiagnosedPart | None
    log: Inspection


@dataclass(frozen=True, slots=True)
class _Done:
    """A diagnosis and the record it is of, of several the first; None for calibration loads."""

    answer: Diagnosis
    input: _Input | None = None


def diagnose_run(
    source: Path,
    profile: Profile,
    *,
    out: Path,
    options: DiagnosisOptions | None = None,
    progress: Callable[[str, float], None] | None = None,
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
    progress : callable or None
        Called with what is being done and the share done.

    Returns
    -------
    folder : Path
        Run folder with ``result.json`` and, for a dynamic run, ``model.json``,
        ``residual.csv`` and spectra.
    result : Diagnosis
        The result as ``result.json`` holds it.

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
    return _stored(done, profile, out, _identity(source, file))


def diagnose_runs_together(
    sources: Sequence[Path],
    profile: Profile,
    *,
    out: Path,
    options: DiagnosisOptions | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> tuple[Path, Diagnosis]:
    """Diagnose several dynamic runs of one drive at once, and store one diagnosis.

    Parameters
    ----------
    sources : sequence of Path
        Run folders or traces, two or more, each named once.
    profile : Profile
        Bench of all of them.
    out : Path
        Parent folder of run folders.
    options : DiagnosisOptions or None
        Settings; the defaults where None.
    progress : callable or None
        Called with what is being done and the share done.

    Returns
    -------
    folder : Path
        Run folder, with one extended model of all.
    result : Diagnosis
        The result as ``result.json`` holds it, with `records`.

    Raises
    ------
    DataError
        If an input cannot be read, or fewer than two can be used.
    StorageError
        If the folder cannot be written.
    UsageError
        If there is one input only, one is there twice, or one holds calibration loads.
    """
    chosen = options or DiagnosisOptions()
    files = [resolve_input(Path(source)) for source in sources]
    identities = [_identity(source, file) for source, file in zip(sources, files, strict=True)]
    _check_together(files, identities)
    most = MOST_SAMPLES // len(files)
    inputs = [
        _input(file, Path(source), profile, chosen, most)
        for file, source in zip(files, sources, strict=True)
    ]
    answer = diagnose_together(
        [one.trace for one in inputs],
        [str(source) for source in sources],
        profile,
        baseline=chosen.baseline,
        **_asked(chosen, profile, progress),
    )
    used = next(i for i, one in enumerate(answer.records) if not one.left_out)
    done = _Done(answer, inputs[used])
    return _stored(done, profile, out, identities[used], together=(inputs, identities))


def _check_together(files: Sequence[Path], identities: Sequence[Mapping[str, Any]]) -> None:
    if len(files) < 2:
        raise UsageError(
            f"--together with {len(files)} record; needed: 2 or more of one drive",
            where="hdbench diagnose",
            fix="name more records, or leave out --together",
        )
    seen: dict[str, str] = {}
    for file, one in zip(files, identities, strict=True):
        if is_loads_file(file):
            raise UsageError(
                "--together with calibration loads; needed: dynamic runs",
                where=str(file),
                fix="diagnose the loads alone: one file holds all experiments of a calibration",
            )
        other = seen.get(one["input_sha256"])
        seen[one["input_sha256"]] = one["input"]
        if other is not None:
            raise UsageError(
                f"the same record as {other}; needed: each record once",
                where=str(one["input"]),
                fix="leave one of them out: a copy is no evidence",
            )


def _identity(source: Path, file: Path) -> dict[str, Any]:
    """Return path and digest of an input, and what it was made from."""
    identity = input_identity(file)
    details = {"input": str(source), "input_sha256": identity["sha256"]}
    return details | {key: identity[key] for key in ("imported",) if key in identity}


def _stored(
    done: _Done,
    profile: Profile,
    out: Path,
    details: dict[str, Any],
    together: tuple[Sequence[_Input], Sequence[Mapping[str, Any]]] | None = None,
) -> tuple[Path, Diagnosis]:
    """Write a diagnosis as a run folder."""
    from hdbench import __version__

    answer = done.answer
    folder = RunFolder.create(out, kind="diagnosis", profile=profile, details=details)
    files = ["result.json", *_write_tables(folder.path, done, profile)]
    motion = None
    if done.input is not None and answer.pictures is not None:
        motion = motion_from_trace(done.input.trace, profile.data)
    proposal = _proposal(answer, profile, motion)
    if proposal is not None and proposal.plan is not None:
        write_plan(folder.path / "plan.toml", proposal.plan)
        files.append("plan.toml")
    extended = answer.pictures is not None or answer.load_pictures is not None
    if extended:
        provenance = {"diagnosis": folder.run_id, **details}
        save_model(folder.path / "model.json", answer.model, profile=profile, provenance=provenance)
        files.append("model.json")
    result = replace(
        answer,
        hdbench_version=__version__,
        profile=ProfileName(name=profile.name, sha256=profile.sha256),
        model_file="model.json" if extended else None,
        filter_gain=_gain(done, profile, motion),
        separating_run=_separating(proposal),
        **details,
        **_of_input(done.input),
    )
    if together is not None:
        parts = zip(result.records, *together, strict=True)
        told = (replace(one, **named, **_of_input(given)) for one, given, named in parts)
        result = replace(result, records=tuple(told))
    write_json(folder.result, result.to_json())
    folder.finish("complete", f"diagnosis: {answer.verdict}", files)
    return folder.path, result


def _diagnose(
    file: Path,
    source: Path,
    profile: Profile,
    options: DiagnosisOptions,
    progress: Callable[[str, float], None] | None,
) -> _Done:
    asked = _asked(options, profile, progress)
    if is_loads_file(file):
        _refuse_for_loads(options, file)
        return _Done(diagnose_loads(read_loads(file, profile.data.arm), profile, **asked))
    given = _input(file, source, profile, options)
    return _Done(diagnose_trace(given.trace, profile, baseline=options.baseline, **asked), given)


def _asked(
    options: DiagnosisOptions, profile: Profile, progress: Callable[[str, float], None] | None
) -> dict[str, Any]:
    """Return what every kind of diagnosis is asked for."""
    return {
        "model": _given(options, profile),
        "alpha": options.alpha,
        "materiality": options.materiality,
        "seed": options.seed,
        "progress": progress,
    }


def _input(
    file: Path, source: Path, profile: Profile, options: DiagnosisOptions, most: int = MOST_SAMPLES
) -> _Input:
    """Return the part of a record to diagnose, scaled to N m."""
    held, part = part_of(read_trace(file), options.from_s, options.to_s, most=most)
    return _Input(*_scaled(held, source, profile), part, inspect_trace(held, profile.data))


def _of_input(given: _Input | None) -> dict[str, Any]:
    return {
        "torque_scale": None if given is None else given.scale,
        "part": None if given is None else given.part,
        "inspection": None if given is None else given.log.to_dict(),
    }


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
    if done.input is not None and not done.answer.records and "torque_v" in done.input.trace:
        daq = profile.data.daq
        step_v = 2.0 * daq.range_v / 2**daq.resolution_bits
        write_table(folder / "map_code.csv", code_map(done.input.trace["torque_v"], step_v))
        files.append("map_code.csv")
    return files


def _gain(done: _Done, profile: Profile, motion: Motion | None) -> FilterGain | None:
    """Return what the filter gains by the orders found; None where none was, and of several."""
    if done.input is None or motion is None or done.answer.records:
        return None
    return filter_gain(done.input.trace, motion, profile, done.answer)


def _proposal(answer: Diagnosis, profile: Profile, motion: Motion | None) -> Proposal | None:
    """Return the run that settles what is open; None for loads and where nothing is."""
    if motion is None:
        return None
    extra = answer.model.extra_causes
    return plan_for_causes(answer.causes, profile.data, motion=motion, extra=extra)


def _separating(proposal: Proposal | None) -> SeparatingRun | None:
    """Return what the proposed run settles, in words, and its file."""
    if proposal is None:
        return None
    file = None if proposal.plan is None else "plan.toml"
    return SeparatingRun(file=file, words=proposal.words)


def _scaled(trace: Trace, source: Path, profile: Profile) -> tuple[Trace, TorqueScale]:
    """Return the trace in N m and by which gain: its own, the run's calibration, the profile's."""
    stored = None
    if (source / "run.json").is_file():
        stored = stored_scale(read_json(source / "run.json").get("calibration"), source)
    return rescaled(trace, profile, calibration=None, stored=stored)
