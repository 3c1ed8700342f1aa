"""The tables of a diagnosis: residual, spectra and maps as CSV."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hdbench.diagnosis.answer.maps import residual_maps
from hdbench.diagnosis.answer.result import Pictures
from hdbench.records import FloatArray, write_atomic

__all__ = ["write_pictures", "write_table"]

_SPECTRUM_FILES = {
    "motor-order": ("order_spectrum.csv", "motor_order"),
    "output-order": ("output_order_spectrum.csv", "output_order"),
    "frequency": ("frequency_spectrum.csv", "frequency_hz"),
}


def write_pictures(folder: Path, pictures: Pictures) -> list[str]:
    """Write residual, spectra and maps into a run folder."""
    table = {
        "time_s": pictures.time_s,
        "measured_nm": pictures.measured_nm,
        "simulated_nm": pictures.simulated_nm,
        "extended_nm": pictures.extended_nm,
        "residual_before_nm": pictures.residual_before_nm,
        "residual_after_nm": pictures.residual_after_nm,
        "masked": pictures.masked.astype(float),
    }
    tables: dict[str, Mapping[str, FloatArray]] = {"residual.csv": table}
    for spectrum in pictures.spectra:
        name, axis = _SPECTRUM_FILES[spectrum.domain]
        tables[name] = {
            axis: spectrum.axis,
            "before_nm": spectrum.before_nm,
            "after_nm": spectrum.after_nm,
        }
    for found in residual_maps(pictures):
        tables[f"map_{found.domain.replace('-', '_')}.csv"] = found.columns()
    for name, columns in tables.items():
        write_table(folder / name, columns)
    return list(tables)


def write_table(path: Path, columns: Mapping[str, FloatArray]) -> None:
    """Write columns as CSV: nine digits, an empty cell where there is no number."""
    rows = np.column_stack(list(columns.values())).tolist()
    lines = [",".join(columns)]
    lines += [",".join("" if x != x else f"{x:.9g}" for x in row) for row in rows]
    write_atomic(path, ("\n".join(lines) + "\n").encode())
