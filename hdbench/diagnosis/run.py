"""A diagnosis as a run folder: result, extended model, residual and spectra."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hdbench.diagnosis.dynamic import diagnose_trace
from hdbench.diagnosis.result import Diagnosis, Pictures
from hdbench.diagnosis.static import diagnose_loads
from hdbench.model import load_model, save_model
from hdbench.profile import Profile
from hdbench.profile.scaling import rescaled, stored_scale
from hdbench.records import (
    FloatArray,
    RunFolder,
    TorqueScale,
    Trace,
    is_loads_file,
    read_json,
    read_loads,
    read_trace,
    resolve_input,
    result_header,
    sha256_file,
    write_atomic,
    write_json,
)

__all__ = ["DiagnosisOptions", "diagnose_run"]

_SPECTRUM_FILES = {
    "motor-order": ("order_spectrum.csv", "motor_order"),
    "output-order": ("output_order_spectrum.csv", "output_order"),
    "frequency": ("frequency_spectrum.csv", "frequency_hz"),
}


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
    """

    model_file: Path | None = None
    alpha: float = 0.01
    materiality: float = 0.01
    seed: int = 0


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
    answer, origin = _diagnose(file, Path(source), profile, chosen, progress)
    details = {"input": str(source), "input_sha256": sha256_file(file)}
    folder = RunFolder.create(out, kind="diagnosis", profile=profile, details=details)
    files = ["result.json"]
    if answer.pictures is not None:
        files += _write_pictures(folder.path, answer.pictures)
        provenance = {"diagnosis": folder.run_id, **details}
        save_model(folder.path / "model.json", answer.model, profile=profile, provenance=provenance)
        files.append("model.json")
    header = result_header("diagnosis", profile)
    model_file = "model.json" if answer.pictures is not None else None
    result = {**answer.to_dict(header, model_file), **details, "torque_scale": origin}
    write_json(folder.result, result)
    folder.finish("complete", f"diagnosis: {answer.verdict}", files)
    return folder.path, result


def _diagnose(
    file: Path,
    source: Path,
    profile: Profile,
    options: DiagnosisOptions,
    progress: Callable[[str, float], None] | None,
) -> tuple[Diagnosis, dict[str, object] | None]:
    if is_loads_file(file):
        loads = read_loads(file, profile.data.arm)
        return diagnose_loads(loads, profile), None
    trace, scale = _scaled(read_trace(file), source, profile)
    model = load_model(options.model_file) if options.model_file else None
    answer = diagnose_trace(
        trace,
        profile,
        model=model,
        alpha=options.alpha,
        materiality=options.materiality,
        seed=options.seed,
        progress=progress,
    )
    return answer, scale.to_dict()


def _scaled(trace: Trace, source: Path, profile: Profile) -> tuple[Trace, TorqueScale]:
    """Return the trace in N m and by which gain: its own, the run's calibration, the profile's."""
    stored = None
    if (source / "run.json").is_file():
        stored = stored_scale(read_json(source / "run.json").get("calibration"), source)
    return rescaled(trace, profile, calibration=None, stored=stored)


def _write_pictures(folder: Path, pictures: Pictures) -> list[str]:
    """Write residual and spectra; nine digits, an empty cell where there is no number."""
    table = {
        "time_s": pictures.time_s,
        "measured_nm": pictures.measured_nm,
        "simulated_nm": pictures.simulated_nm,
        "extended_nm": pictures.extended_nm,
        "residual_before_nm": pictures.residual_before_nm,
        "residual_after_nm": pictures.residual_after_nm,
        "masked": pictures.masked.astype(float),
    }
    _write_table(folder / "residual.csv", table)
    names = ["residual.csv"]
    for spectrum in pictures.spectra:
        name, axis = _SPECTRUM_FILES[spectrum.domain]
        columns = {
            axis: spectrum.axis,
            "before_nm": spectrum.before_nm,
            "after_nm": spectrum.after_nm,
        }
        _write_table(folder / name, columns)
        names.append(name)
    return names


def _write_table(path: Path, columns: dict[str, FloatArray]) -> None:
    rows = np.column_stack(list(columns.values())).tolist()
    lines = [",".join(columns)]
    lines += [",".join("" if x != x else f"{x:.9g}" for x in row) for row in rows]
    write_atomic(path, ("\n".join(lines) + "\n").encode())
