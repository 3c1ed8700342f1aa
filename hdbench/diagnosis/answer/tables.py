"""Tables of a diagnosis as CSV: residual, spectra, and maps of the residual."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hdbench.diagnosis.answer.result import Pictures
from hdbench.records import FloatArray, write_atomic

Columns = Mapping[str, FloatArray]

_SPECTRUM_FILES = {
    "motor-order": ("order_spectrum.csv", "motor_order"),
    "output-order": ("output_order_spectrum.csv", "output_order"),
    "frequency": ("frequency_spectrum.csv", "frequency_hz"),
}


def write_pictures(folder: Path, pictures: Pictures) -> list[str]:
    """Write residual, spectra and maps into a run folder; return the names of the files."""
    lines = ("measured_nm", "simulated_nm", "extended_nm")
    left = ("residual_before_nm", "residual_after_nm")
    table = {name: getattr(pictures, name) for name in ("time_s", *lines, *left)}
    tables: dict[str, Columns] = {
        "residual.csv": {**table, "masked": pictures.masked.astype(float)}
    }
    for one in pictures.spectra:
        name, axis = _SPECTRUM_FILES[one.domain]
        tables[name] = {axis: one.axis, "before_nm": one.before_nm, "after_nm": one.after_nm}
    for domain, found in residual_maps(pictures).items():
        tables[f"map_{domain.replace('-', '_')}.csv"] = found
    for name, columns in tables.items():
        write_table(folder / name, columns)
    return list(tables)


def write_table(path: Path, columns: Columns) -> None:
    """Write columns as CSV: nine digits, an empty cell where there is no number."""
    rows = np.column_stack(list(columns.values())).tolist()
    lines = [",".join(columns)]
    lines += [",".join("" if x != x else f"{x:.9g}" for x in row) for row in rows]
    write_atomic(path, ("\n".join(lines) + "\n").encode())


def residual_maps(pictures: Pictures) -> dict[str, dict[str, FloatArray]]:
    """Return the residual in bins of time, speed, acceleration, torque and angles, by domain."""
    speed, turn = pictures.velocity_rad_s, 2.0 * np.pi
    maps = {}
    for domain, name, values in (
        ("time", "time_s", pictures.time_s),
        ("velocity", "motor_velocity_rad_s", speed),
        ("acceleration", "motor_acceleration_rad_s2", pictures.acceleration_rad_s2),
        ("torque", "applied_torque_nm", pictures.applied_nm),
        ("variance", "absolute_velocity_rad_s", np.abs(speed)),
        ("output-angle", "output_angle_rad", np.mod(pictures.output_angle_rad, turn)),
        ("motor-angle", "motor_angle_rad", np.mod(pictures.motor_angle_rad, turn)),
    ):
        if columns := _map(pictures, name, values, domain):
            maps[domain] = columns
    return maps


def _map(pictures: Pictures, name: str, values: FloatArray, domain: str) -> dict[str, FloatArray]:
    """Return the columns of a map; none where there is nothing to map."""
    left = pictures.residual_before_nm + pictures.residual_after_nm
    good = np.isfinite(left + values) & ~pictures.masked
    chosen = values[good]
    # a spread of less than 1e-9 of the size is rounding
    if not len(chosen) or not np.ptp(chosen) > 1e-9 * float(np.abs(chosen).max()):
        return {}
    # enough to show a kink of a friction curve, few enough that each holds hundreds of samples of a
    # record of a minute
    n_bins = 48
    if domain.endswith("-angle"):
        index = np.floor(chosen / (2.0 * np.pi) * n_bins)
    else:
        width = float(np.ptp(chosen)) / n_bins
        index = np.minimum(np.floor((chosen - float(chosen.min())) / width), n_bins - 1.0)
    index = index.astype(np.intp)
    count = np.bincount(index).astype(float)
    # fewer than eight samples have no spread of their own
    kept = count >= 8
    if int(kept.sum()) < 2:
        return {}
    count = np.where(kept, count, 1.0)

    def mean(x: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(index, weights=x, minlength=len(count)) / count)

    # standard deviations as if the samples were independent; of the variance the root mean square
    rms = domain == "variance"
    columns = {name: mean(chosen), "samples": count}
    for when in ("before", "after"):
        left = getattr(pictures, f"residual_{when}_nm")[good]
        level = mean(left * left) if rms else mean(left)
        square = mean(left**4) if rms else mean(left * left)
        spread = np.sqrt(np.maximum(square - level**2, 0.0) / count)
        if rms:
            level = np.sqrt(level)
            spread /= np.maximum(2.0 * level, np.finfo(float).tiny)
        columns |= {f"{when}_nm": level, f"{when}_std_nm": spread}
    return {key: column[kept] for key, column in columns.items()}


def code_map(torque_v: FloatArray, step_v: float) -> dict[str, FloatArray]:
    """Count the codes of a converter modulo 32."""
    # the five lowest bits show stuck and missing codes
    codes = np.round(torque_v[np.isfinite(torque_v)] / step_v).astype(np.int64)
    counts = np.bincount(np.mod(codes, 32), minlength=32).astype(float)
    return {
        "code_modulo_32": np.arange(32, dtype=float),
        "samples": counts,
        "share": counts / max(1.0, float(counts.sum())),
    }
