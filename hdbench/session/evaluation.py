"""Evaluation of a run: its result, the filter with what it adds, and the run folder of both."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hdbench.errors import DataError
from hdbench.evaluation import EvaluatedResult
from hdbench.evaluation import evaluate as evaluate_record
from hdbench.filter import FilterModel, build_filter_model
from hdbench.filter.presets import TUNED, choose_filter
from hdbench.filter.tuning.run import tune_traces
from hdbench.profile import Profile
from hdbench.profile.scaling import measured_utc, profile_scale, rescaled, stored_scale
from hdbench.records import Loads, TorqueScale, Trace
from hdbench.records.jsonfile import read_json, write_json
from hdbench.records.loads import is_loads_file, read_loads
from hdbench.records.parquetfile import PARQUET
from hdbench.records.provenance import input_identity, provenance_path
from hdbench.records.recovery import resolve_input
from hdbench.records.runfolder import RunFolder
from hdbench.records.tracefile import read_trace, write_trace
from hdbench.ripple import Stretch

# share of the largest load below which a torque of the other sign may be the zero of a reference
# sensor: Table 1's sensors are consistent to 2 %, hand-read zeros to about as much again
_ZERO_SHARE = 0.05


def channel_doubts(records: Trace | Loads, source: Path, profile: Profile) -> list[str]:
    """Return doubts where channels of a file are in another unit or in each other's place."""
    if isinstance(records, Loads) or source.is_dir():
        return []
    from hdbench.diagnosis.faults.units import check_channels

    checked = check_channels(records, profile.data)
    if checked.reason:
        return [checked.reason]
    seen = {
        "velocity-scale": "the velocity is not in rad/s, or has the other sign",
        "encoder-scale": "the angle does not fit the velocity: another unit, count or sign",
    }
    words = [seen.get(flag.name, flag.detail) for flag in checked.flags]
    return [f"{word} (hdbench diagnose says by how much)" for word in words]


def channel_refusal(trace: Trace, source: Path, profile: Profile) -> str:
    """Return why a file's channels cannot be what their names say, whatever ripple they hold."""
    if source.is_dir():
        return ""
    from hdbench.diagnosis.faults.units import check_channels

    return check_channels(trace, profile.data).reason


def sign_doubts(records: Trace | Loads) -> list[str]:
    """Return a doubt where torques contradict their direction (cw positive, ccw negative)."""
    if not isinstance(records, Loads):
        return []
    least = _ZERO_SHARE * max(abs(r.torque_nm) for r in records.readings)
    signs = {"cw": 1.0, "ccw": -1.0}
    wrong = [r for r in records.readings if signs[r.direction] * r.torque_nm < -least]
    if not wrong:
        return []
    names = ", ".join(dict.fromkeys(r.experiment for r in wrong))
    return [f"{len(wrong)} torques have the sign of the other direction (experiments {names})"]


def evaluate(
    kind: str,
    records: Trace | Loads,
    profile: Profile,
    scale: TorqueScale,
    model: FilterModel,
    **told: Any,
) -> tuple[EvaluatedResult, FilterModel]:
    """Evaluate one experiment; return its result, and the filter with what it adds."""
    result = evaluate_record(kind, records, profile, scale=scale, model=model, **told)
    return result, build_filter_model(model, **{kind: result.to_json()})


def store_evaluation(
    folder: RunFolder,
    found: tuple[EvaluatedResult, FilterModel],
    files: Sequence[Path],
    reason: str,
) -> None:
    """Write result and filter model into a run folder and close the run."""
    result, model = found
    write_json(folder.result, result.to_json())
    filter_file = folder.path / "filter.json"
    write_json(filter_file, model.to_dict())
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
) -> tuple[RunFolder, EvaluatedResult]:
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
    result : CalibrationResult, MisalignmentResult or RippleResult
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
    kept = _keep_input(folder, file, records, imported="imported" in origin)
    channels = channel_doubts(records, source, profile)
    try:
        found = evaluate(
            kind,
            records,
            profile,
            scale,
            model,
            run=folder.run_id,
            doubts=(*sign_doubts(records), *channels),
            stretch=stretch,
            **({"imported": origin["imported"]} if "imported" in origin else {}),
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
    store_evaluation(folder, found, kept, f"evaluated from {source}")
    return folder, found[0]


def _keep_input(
    folder: RunFolder, file: Path, records: Trace | Loads, *, imported: bool
) -> list[Path]:
    """Copy the input into a run folder, with what is known of where it comes from."""
    suffix = ".csv.gz" if file.suffix == ".gz" else ".csv"
    stored = folder.path / (("loads" if isinstance(records, Loads) else "trace") + suffix)
    if file.suffix == PARQUET:
        write_trace(stored, read_trace(file))
        return [stored]
    shutil.copyfile(file, stored)
    if not imported:
        return [stored]
    shutil.copyfile(provenance_path(file), provenance_path(stored))
    return [stored, provenance_path(stored)]


def _load(
    kind: str, file: Path, source: Path, profile: Profile, calibration: Path | None
) -> tuple[Trace | Loads, TorqueScale]:
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
