"""One evaluation for measured and for stored data."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hdbench.errors import DataError
from hdbench.evaluation import evaluate as evaluate_record
from hdbench.filter import FilterModel, build_filter_model
from hdbench.profile import Profile
from hdbench.profile.scaling import rescaled, stored_scale
from hdbench.profile.validity import measured_utc
from hdbench.records import Loads, TorqueScale, Trace
from hdbench.records.jsonfile import read_json, result_header, write_json
from hdbench.records.provenance import input_identity, provenance_path
from hdbench.records.recovery import resolve_input
from hdbench.records.runfolder import RunFolder
from hdbench.records.tables import PARQUET, is_loads_file, read_loads, read_trace, write_trace
from hdbench.ripple import Stretch
from hdbench.session.doubts import channel_doubts, sign_doubts
from hdbench.session.filters import TUNED, choose_filter, tune_traces

__all__ = ["Evaluation", "evaluate", "evaluate_stored", "store_evaluation"]


@dataclass(frozen=True, slots=True)
class Evaluation:
    """What came out of one experiment.

    Parameters
    ----------
    result : mapping
        The result as result.json keeps it.
    records : Trace or Loads
        What was evaluated.
    filter_model : FilterModel
        The filter used, with what this experiment adds to it.
    """

    result: Mapping[str, Any]
    records: Trace | Loads
    filter_model: FilterModel


def evaluate(
    kind: str,
    records: Trace | Loads,
    profile: Profile,
    scale: TorqueScale,
    model: FilterModel,
    *,
    run: str,
    doubts: Sequence[str] = (),
    stretch: Stretch | None = None,
) -> Evaluation:
    """Evaluate one experiment.

    Parameters
    ----------
    kind : str
        ``calibration``, ``misalignment`` or ``ripple``.
    records : Trace or Loads
        Its data.
    profile : Profile
        The bench.
    scale : TorqueScale
        The gain that scaled the torque.
    model : FilterModel
        The filter.
    run : str
        Identifier of the run; the filter's provenance names it.
    doubts : sequence of str
        Reasons to doubt the data.
    stretch : Stretch or None
        Part of a ripple run; None takes all of it.

    Returns
    -------
    Evaluation
        Result, data and the filter with what this experiment adds.

    Raises
    ------
    DataError
        If the data are of another kind or cannot be evaluated.
    """
    if isinstance(records, Loads) != (kind == "calibration"):
        given = "loads" if isinstance(records, Loads) else "a trace"
        needed = "loads" if kind == "calibration" else "a trace"
        raise DataError(
            f"found {given}; {kind} needs {needed}",
            where=records.source,
            fix="name a file of the other kind, or use the command for this one",
        )
    result: dict[str, Any]
    if isinstance(records, Loads):
        from hdbench.calibration import evaluate_calibration

        limit = profile.data.calibration.max_consistency
        loads = evaluate_calibration(
            records, max_consistency=limit, bench=profile.data, monte_carlo_seed=0
        )
        header = result_header(kind, profile)
        result = {**loads.to_dict(header), "run": run, "doubts": list(doubts)}
    else:
        found = evaluate_record(kind, records, profile, scale=scale, model=model, stretch=stretch)
        result = replace(found, run=run, doubts=tuple(doubts)).to_json()
    return Evaluation(result, records, _fed(kind, model, result))


def _fed(kind: str, model: FilterModel, result: dict[str, Any]) -> FilterModel:
    return build_filter_model(
        model,
        ripple=result if kind == "ripple" else None,
        misalignment=result if kind == "misalignment" else None,
        calibration=result if kind == "calibration" else None,
    )


def store_evaluation(
    folder: RunFolder, found: Evaluation, files: Sequence[Path], reason: str
) -> None:
    """Write result and filter model into a run folder and close the run."""
    write_json(folder.result, found.result)
    filter_file = folder.path / "filter.json"
    write_json(filter_file, found.filter_model.to_dict())
    folder.finish("complete", reason, [*files, folder.result, filter_file])


def evaluate_stored(
    kind: str,
    source: Path,
    profile: Profile,
    *,
    out: Path,
    calibration: Path | None = None,
    misalignment: Path | None = None,
    filter_name: str | None = None,
    stretch: Stretch | None = None,
) -> tuple[RunFolder, Evaluation]:
    """Evaluate a stored file or run again, into a run folder of its own.

    Parameters
    ----------
    kind : str
        ``calibration``, ``misalignment`` or ``ripple``.
    source : Path
        A trace, a loads file or a run folder.
    profile : Profile
        The bench.
    out : Path
        Parent folder of run folders.
    calibration : Path or None
        Calibration to rescale by.
    misalignment : Path or None
        Misalignment result whose output-order block joins the filter.
    filter_name : str or None
        Filter model instead of the stored run's or, for a file, the profile's; ``tuned`` is tuned
        on this very input.
    stretch : Stretch or None
        Part of a ripple run.

    Returns
    -------
    folder : RunFolder
        The new run, with a copy of the input.
    evaluation : Evaluation
        What came out.

    Raises
    ------
    DataError
        If the input is broken or cannot be evaluated.
    """
    file = resolve_input(source)
    tuned = filter_name == TUNED
    name = None if tuned else filter_name
    model = choose_filter(profile, name, misalignment=misalignment, source=source)
    records, scale = _load(kind, file, source, profile, calibration)
    if tuned and isinstance(records, Trace):
        origins = {f"trace {records.source}": "the input itself"}
        model = tune_traces(profile, model, [records], origins).model
    origin = {**input_identity(file), "path": str(source)}
    details = {"source": {**origin, "measured_utc": measured_utc(source)}}
    folder = RunFolder.create(out, kind=kind, profile=profile, details=details)
    folder.update(calibration=scale.to_dict(), filter=model.to_dict())
    suffix = ".csv.gz" if file.suffix == ".gz" else ".csv"
    stored = folder.path / (("loads" if isinstance(records, Loads) else "trace") + suffix)
    if file.suffix == PARQUET:
        write_trace(stored, read_trace(file))
    else:
        shutil.copyfile(file, stored)
        if "imported" in origin:
            shutil.copyfile(provenance_path(file), provenance_path(stored))
    kept = [path for path in (stored, provenance_path(stored)) if path.exists()]
    channels = channel_doubts(records, source, profile)
    try:
        found = evaluate(
            kind,
            records,
            profile,
            scale,
            model,
            run=folder.run_id,
            doubts=[*sign_doubts(records), *channels],
            stretch=stretch,
        )
    except DataError as error:
        folder.finish("complete", f"not evaluated: {error.what}", kept)
        if channels:
            raise DataError(
                f"{'; '.join(channels)}: {error.what}",
                where=error.where,
                fix="bring the file in with the right columns and units: hdbench import --map",
            ) from error
        raise
    if "imported" in origin:
        found = replace(found, result={**found.result, "imported": origin["imported"]})
    store_evaluation(folder, found, kept, f"evaluated from {source}")
    return folder, found


def _load(
    kind: str, file: Path, source: Path, profile: Profile, calibration: Path | None
) -> tuple[Trace | Loads, TorqueScale]:
    from hdbench.profile.scaling import profile_scale

    if is_loads_file(file):
        return read_loads(file, profile.data.arm), profile_scale(profile)
    if kind == "calibration":
        raise DataError(
            "no loads: the columns experiment, series and reading_v are missing",
            where=str(file),
            fix="name a loads CSV, or make one with hdbench import --kind loads",
        )
    stored = None
    if source.is_dir():
        manifest = read_json(source / "run.json", None)
        stored = stored_scale(manifest.get("calibration"), source)
    return rescaled(read_trace(file), profile, calibration=calibration, stored=stored)
