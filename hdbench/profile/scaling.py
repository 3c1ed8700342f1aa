"""Which gain turns volts into newton metres, and how sure it is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hdbench.errors import DataError
from hdbench.profile.loader import Profile
from hdbench.records import Quantity, TorqueScale, Trace
from hdbench.records.jsonfile import read_json, sha256_file

__all__ = ["profile_scale", "read_calibration", "rescaled", "stored_scale"]

_EIGHT = 8  # experiments behind the profile's consistency, report section 3


def profile_scale(profile: Profile) -> TorqueScale:
    """Return the gain that the profile states."""
    sensor = profile.data.sensor
    return TorqueScale(
        Quantity(sensor.gain_nm_per_v, sensor.gain_consistency * sensor.gain_nm_per_v, _EIGHT - 1),
        f"profile {profile.data.name}, not calibrated on this bench",
    )


def read_calibration(path: Path) -> TorqueScale:
    """Read the gain of a stored calibration."""
    file = path / "result.json" if path.is_dir() else path
    if not file.is_file():
        raise DataError(
            "no calibration here; needed: the run folder of a calibration, or its result.json",
            where=str(path),
            fix="name one that `hdbench runs list` shows, or make one with `hdbench calibrate`",
        )
    result = read_json(file, "hdbench/calibration/1")
    gain = _quantity(result.get("gain_nm_per_v"), file)
    name = path.name if path.is_dir() else file.name
    return TorqueScale(gain, f"calibration {name}", sha256_file(file))


def _quantity(value: Any, file: Path) -> Quantity:
    if not (isinstance(value, dict) and {"value", "std"} <= value.keys()):
        raise DataError(
            f"gain_nm_per_v is {value!r}; needed: an object with value, std and dof, N m/V",
            where=f"{file}: gain_nm_per_v",
            fix="calibrate again, or name another file",
        )
    try:
        gain = Quantity(float(value["value"]), float(value["std"]), value.get("dof"))
    except (TypeError, ValueError) as error:
        raise DataError(
            f"gain_nm_per_v cannot be used: {error}",
            where=f"{file}: gain_nm_per_v",
            fix="calibrate again, or name another file",
        ) from error
    if gain.value == 0.0:
        raise DataError(
            "gain_nm_per_v is 0 N m/V; needed: a gain other than zero",
            where=f"{file}: gain_nm_per_v",
            fix="calibrate again, or name another file",
        )
    return gain


def stored_scale(calibration: Any, where: Path) -> TorqueScale | None:
    """Return the gain that a run folder says it used, or None where it does not say."""
    if not isinstance(calibration, dict) or "gain_nm_per_v" not in calibration:
        return None
    return TorqueScale(
        _quantity(calibration["gain_nm_per_v"], where / "run.json"),
        str(calibration.get("source", "run.json")),
        calibration.get("sha256"),
        calibration.get("calibrated_utc"),
        calibration.get("age_days"),
        calibration.get("expired") is True,
        str(calibration.get("age_words", "")),
    )


def rescaled(
    trace: Trace, profile: Profile, *, calibration: Path | None, stored: TorqueScale | None
) -> tuple[Trace, TorqueScale]:
    """Give a trace its torque in newton metres and say by which gain."""
    if calibration is not None:
        if "torque_v" not in trace:
            raise DataError(
                "no torque_v column to scale by the calibration; found torque_nm only",
                where=trace.source,
                fix="leave --calibration out, or import the raw volts as torque_v",
            )
        scale = read_calibration(calibration)
        return _scaled(trace, scale), scale
    if "torque_nm" in trace:
        as_given = TorqueScale(
            Quantity(1.0, 0.0), "torque_nm as given; no gain applied, its uncertainty not declared"
        )
        return trace, stored or as_given
    scale = stored or profile_scale(profile)
    return _scaled(trace, scale), scale


def _scaled(trace: Trace, scale: TorqueScale) -> Trace:
    return trace.with_columns(torque_nm=trace["torque_v"] * scale.gain_nm_per_v.value)
