"""Tables of a diagnosis as CSV: residual, spectra, and maps of the residual."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

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
    return {
        domain: columns
        for domain, name, values, bins in _binned(pictures)
        if (columns := _map(pictures, name, values, bins, domain == "variance"))
    }


def _binned(pictures: Pictures) -> Iterator[tuple[str, str, FloatArray, FloatArray]]:
    """Yield domain, column name, values and bin (NaN for none) of each quantity."""
    # enough to show a kink of a friction curve, few enough that each holds hundreds of samples of a
    # record of a minute
    n_bins, speed = 48, pictures.velocity_rad_s
    for domain, name, values in (
        ("time", "time_s", pictures.time_s),
        ("velocity", "motor_velocity_rad_s", speed),
        ("acceleration", "motor_acceleration_rad_s2", pictures.acceleration_rad_s2),
        ("torque", "applied_torque_nm", pictures.applied_nm),
        ("variance", "absolute_velocity_rad_s", np.abs(speed)),
    ):
        good = _usable(pictures, values)
        bins = np.full(len(values), np.nan)
        low, width = 0.0, 0.0
        if good.any():
            low, width = float(values[good].min()), float(np.ptp(values[good])) / n_bins
        if width > 0.0:
            bins[good] = np.minimum(np.floor((values[good] - low) / width), n_bins - 1.0)
        yield domain, name, values, bins
    for domain, name, values in (
        ("output-angle", "output_angle_rad", pictures.output_angle_rad),
        ("motor-angle", "motor_angle_rad", pictures.motor_angle_rad),
    ):
        wrapped = np.mod(values, 2.0 * np.pi)
        yield domain, name, wrapped, np.floor(wrapped / (2.0 * np.pi) * n_bins)


def _usable(pictures: Pictures, values: FloatArray) -> NDArray[np.bool_]:
    left = pictures.residual_before_nm + pictures.residual_after_nm
    return np.asarray(np.isfinite(left + values) & ~pictures.masked)


def _map(
    pictures: Pictures, name: str, values: FloatArray, bins: FloatArray, rms: bool
) -> dict[str, FloatArray]:
    """Return the columns of a map; none where there is nothing to map."""
    good = _usable(pictures, values) & np.isfinite(bins)
    if not good.any():
        return {}
    chosen, index = values[good], bins[good].astype(np.intp)
    count = np.bincount(index).astype(float)
    # fewer than eight samples have no spread of their own
    kept = count >= 8
    # a spread of less than 1e-9 of the size is rounding
    if not np.ptp(chosen) > 1e-9 * float(np.abs(chosen).max()) or int(kept.sum()) < 2:
        return {}
    count = np.where(kept, count, 1.0)

    def mean(x: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(index, weights=x, minlength=len(count)) / count)

    # standard deviations as if the samples were independent; of the variance the root mean square
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
