"""The residual before and after over everything that it could depend on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.answer.result import Pictures
from hdbench.records.trace import FloatArray

__all__ = ["ResidualMap", "code_map", "residual_maps"]

# bins of a map: enough to show a kink of a friction curve, few enough that each holds hundreds of
# samples of a record of a minute
_BINS = 48
# bins below this many samples have no spread of their own
_LEAST = 8
# a quantity whose spread is below this share of its size is constant: there is nothing to map
_CONSTANT = 1e-9
# codes of a converter are counted modulo 32: the five lowest bits show stuck and missing ones
_CODES = 32


@dataclass(frozen=True, slots=True)
class ResidualMap:
    """Residual, averaged in bins of one quantity.

    Parameters
    ----------
    domain : str
        ``time``, ``velocity``, ``acceleration``, ``torque``, ``output-angle``, ``motor-angle``,
        ``variance`` or ``code``.
    axis_name : str
        Column name of the quantity, with its unit.
    axis : ndarray, shape (m,)
        Mean of the quantity in each bin.
    samples : ndarray, shape (m,)
        Samples in each bin.
    before_nm, after_nm : ndarray, shape (m,)
        Mean residual without and with the causes, N m; in the domain ``variance`` its root mean
        square.
    before_std_nm, after_std_nm : ndarray, shape (m,)
        Standard deviation of these, N m, were the samples independent of each other.
    """

    domain: str
    axis_name: str
    axis: FloatArray
    samples: FloatArray
    before_nm: FloatArray
    after_nm: FloatArray
    before_std_nm: FloatArray
    after_std_nm: FloatArray

    def columns(self) -> dict[str, FloatArray]:
        """Return the map as columns of a table."""
        return {
            self.axis_name: self.axis,
            "samples": self.samples,
            "before_nm": self.before_nm,
            "before_std_nm": self.before_std_nm,
            "after_nm": self.after_nm,
            "after_std_nm": self.after_std_nm,
        }


def residual_maps(pictures: Pictures) -> tuple[ResidualMap, ...]:
    """Average the residual in bins of time, speed, acceleration, torque and angles."""
    turn = 2.0 * np.pi
    speed = pictures.velocity_rad_s
    by_range = (
        ("time", "time_s", pictures.time_s, False),
        ("velocity", "motor_velocity_rad_s", speed, False),
        ("acceleration", "motor_acceleration_rad_s2", pictures.acceleration_rad_s2, False),
        ("torque", "applied_torque_nm", pictures.applied_nm, False),
        ("variance", "absolute_velocity_rad_s", np.abs(speed), True),
    )
    by_turn = (
        ("output-angle", "output_angle_rad", pictures.output_angle_rad),
        ("motor-angle", "motor_angle_rad", pictures.motor_angle_rad),
    )
    maps = [
        _map(pictures, (domain, name), values, _equal_widths(pictures, values), rms)
        for domain, name, values, rms in by_range
    ]
    for domain, name, values in by_turn:
        wrapped = np.mod(values, turn)
        bins = np.floor(wrapped / turn * _BINS)
        maps.append(_map(pictures, (domain, name), wrapped, bins, False))
    return tuple(found for found in maps if found is not None)


def _usable(pictures: Pictures, values: FloatArray) -> NDArray[np.bool_]:
    present = np.isfinite(pictures.residual_before_nm) & np.isfinite(pictures.residual_after_nm)
    return np.asarray(present & np.isfinite(values) & ~pictures.masked)


def _equal_widths(pictures: Pictures, values: FloatArray) -> FloatArray:
    """Return the bin of each sample; NaN where it is in none."""
    good = _usable(pictures, values)
    bins = np.full(len(values), np.nan)
    if good.any():
        low, width = float(values[good].min()), float(np.ptp(values[good])) / _BINS
        if width > 0.0:
            bins[good] = np.minimum(np.floor((values[good] - low) / width), _BINS - 1.0)
    return bins


def _map(
    pictures: Pictures, names: tuple[str, str], values: FloatArray, bins: FloatArray, rms: bool
) -> ResidualMap | None:
    good = _usable(pictures, values) & np.isfinite(bins)
    if not good.any():
        return None
    chosen = values[good]
    if not np.ptp(chosen) > _CONSTANT * float(np.abs(chosen).max()):
        return None
    index = bins[good].astype(np.intp)
    count = np.bincount(index).astype(float)
    kept = count >= _LEAST
    if int(kept.sum()) < 2:
        return None
    count = np.where(kept, count, 1.0)

    def mean(x: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(index, weights=x, minlength=len(count)) / count)

    def level(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        first = mean(x * x) if rms else mean(x)
        second = mean(x**4) if rms else mean(x * x)
        spread = np.sqrt(np.maximum(second - first**2, 0.0) / count)
        if not rms:
            return first, spread
        root = np.sqrt(first)
        return root, spread / np.maximum(2.0 * root, np.finfo(float).tiny)

    before, before_std = level(pictures.residual_before_nm[good])
    after, after_std = level(pictures.residual_after_nm[good])
    place = mean(chosen)
    columns = (place, count, before, after, before_std, after_std)
    axis, samples, *rest = (column[kept] for column in columns)
    return ResidualMap(names[0], names[1], axis, samples, *rest)


def code_map(torque_v: FloatArray, step_v: float) -> dict[str, FloatArray]:
    """Count the codes of a converter modulo 32."""
    codes = np.round(torque_v[np.isfinite(torque_v)] / step_v).astype(np.int64)
    counts = np.bincount(np.mod(codes, _CODES), minlength=_CODES).astype(float)
    return {
        "code_modulo_32": np.arange(_CODES, dtype=float),
        "samples": counts,
        "share": counts / max(1.0, float(counts.sum())),
    }
