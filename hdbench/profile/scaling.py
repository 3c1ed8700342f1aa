"""Torque and motion of a trace in SI units: gains, how sure and how old, volts and counts."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from hdbench.errors import DataError, UsageError
from hdbench.profile.loader import Profile
from hdbench.profile.schema import ProfileData
from hdbench.records import Quantity, TorqueScale, Trace
from hdbench.records.jsonfile import read_json
from hdbench.records.storage import sha256_file
from hdbench.records.trace import FloatArray

# clocks of two computers may differ by minutes; by an hour where one keeps the wrong season
_CLOCK_SLACK = timedelta(hours=1)
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
    """Return a stored gain, checked."""
    try:
        gain = Quantity(float(value["value"]), float(value["std"]), value.get("dof"))
        if gain.value == 0.0:
            raise ValueError("value is 0 N m/V")
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise DataError(
            f"gain_nm_per_v is {value!r:.80} ({error}); needed: an object with value (not 0), std "
            "and dof, N m/V",
            where=f"{file}: gain_nm_per_v",
            fix="calibrate again, or name another file",
        ) from error
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
    trace: Trace,
    profile: Profile,
    *,
    calibration: Path | None,
    stored: TorqueScale | None,
    gain: float | None = None,
) -> tuple[Trace, TorqueScale]:
    """Give a trace its torque in newton metres and say by which gain."""
    asked, option = None, "--calibration"
    if gain == 0.0:
        fix = "give the sensor's torque per volt"
        raise UsageError("a gain of 0 N m/V; needed: another number", where="--gain", fix=fix)
    if gain is not None:
        asked = TorqueScale(Quantity(gain, 0.0), "--gain; its uncertainty not declared")
        option = "--gain"
    elif calibration is not None:
        asked = read_calibration(calibration)
    if asked is not None and "torque_v" not in trace:
        raise DataError(
            f"no torque_v column to scale by {option}; found torque_nm only",
            where=trace.source,
            fix=f"leave {option} out, or import the raw volts as torque_v",
        )
    if asked is None and "torque_nm" in trace:
        as_given = TorqueScale(
            Quantity(1.0, 0.0), "torque_nm as given; no gain applied, its uncertainty not declared"
        )
        return trace, stored or as_given
    scale = asked or stored or profile_scale(profile)
    return trace.with_columns(torque_nm=trace["torque_v"] * scale.gain_nm_per_v.value), scale


def _manifest(run: Path) -> dict[str, Any]:
    """Return what ``run.json`` of a run, or beside its result, holds; nothing without one."""
    file = (run if run.is_dir() else run.parent) / "run.json"
    return read_json(file) if file.is_file() else {}


def measured_utc(run: Path) -> str | None:
    """Return when the data of a run were measured."""
    manifest = _manifest(run)
    details = manifest.get("details")
    source = details.get("source") if isinstance(details, dict) else None
    known = source.get("measured_utc") if isinstance(source, dict) else manifest.get("ended_utc")
    return known if isinstance(known, str) else None


def calibration_time(path: Path) -> tuple[str | None, bool]:
    """Return when a calibration was made."""
    measured = measured_utc(path)
    if measured is not None:
        return measured, True
    manifest = _manifest(path)
    found = manifest.get("ended_utc") or manifest.get("started_utc")
    return (found if isinstance(found, str) else None), False


def checked_age(
    scale: TorqueScale, path: Path, profile: Profile, *, now: datetime, allow_expired: bool = False
) -> TorqueScale:
    """Say how old a calibration is, and refuse one that is older than the profile allows."""
    text, measured = calibration_time(path)
    if text is None:
        return replace(scale, age_words="its age is not known")
    age = (now - _moment(text, path)) / timedelta(days=1)
    limit = profile.data.calibration.validity_days
    if not age >= -_CLOCK_SLACK / timedelta(days=1):
        raise DataError(
            f"the calibration is dated {text}, {-age:.1f} days in the future; needed: an earlier "
            "date",
            where=str(path),
            fix="set the clock of this computer, or name another calibration",
        )
    expired = not age <= limit
    if expired and not allow_expired:
        raise DataError(
            f"the calibration has expired: {age:.1f} days old; needed: at most {limit:g} days "
            "(calibration.validity_days of the profile)",
            where=str(path),
            fix="calibrate again with hdbench calibrate, or use it knowingly with --allow-expired",
        )
    words = f"{'' if measured else 'at least '}{max(age, 0.0):.1f} days old, valid for {limit:g}"
    if expired:
        words += ": EXPIRED, used because that was asked for"
    return replace(
        scale, calibrated_utc=text, age_days=max(age, 0.0), expired=expired, age_words=words
    )


def _moment(text: str, path: Path) -> datetime:
    try:
        moment = datetime.fromisoformat(text)
        if moment.tzinfo is None:
            raise ValueError("no time zone")
    except ValueError as error:
        raise DataError(
            f"the date {text!r:.40} cannot be read: {error}; needed: ISO 8601 with a time zone",
            where=str(path),
            fix="restore run.json of the calibration from a copy, or name another calibration",
        ) from error
    return moment


def torque_channel(trace: Trace, gain_nm_per_v: float) -> FloatArray:
    """Return the measured torque.

    Parameters
    ----------
    trace : Trace
        With ``torque_nm`` or ``torque_v``.
    gain_nm_per_v : float
        Torque per volt, N m/V.

    Returns
    -------
    ndarray, shape (n_samples,)
        Torque, N m; NaN where a sample is missing.

    Raises
    ------
    DataError
        If the trace has neither channel.

    Notes
    -----
    ``torque_nm`` is taken as it stands; without it ``torque_nm = gain_nm_per_v * torque_v``. Who
    wants another gain for a trace that holds both writes ``torque_nm`` anew from ``torque_v``.
    """
    if "torque_nm" in trace:
        return trace["torque_nm"]
    if "torque_v" in trace:
        return trace["torque_v"] * gain_nm_per_v
    raise _missing(trace, "torque", "torque_nm in N m, or torque_v in V")


def velocity_channel(trace: Trace, profile: ProfileData) -> FloatArray:
    """Return the motor velocity, rad/s: measured, or by the tacho's volts; DataError without."""
    if "motor_velocity_rad_s" in trace:
        return trace["motor_velocity_rad_s"]
    if "tacho_v" in trace:
        return trace["tacho_v"] * profile.tacho.gain_rad_s_per_v
    raise _missing(trace, "velocity", "motor_velocity_rad_s in rad/s, or tacho_v in V")


def angle_channel(trace: Trace, profile: ProfileData) -> FloatArray | None:
    """Return the measured motor angle, rad: its column or counts; None where there is neither."""
    if "motor_angle_rad" in trace:
        return trace["motor_angle_rad"]
    count_rad = 2.0 * math.pi / profile.encoder.counts_per_turn
    return trace["encoder_count"] * count_rad if "encoder_count" in trace else None


def _missing(trace: Trace, what: str, needed: str) -> DataError:
    column = needed.partition(" ")[0]
    return DataError(
        f"the trace has no {what} channel; found columns {', '.join(trace.columns)}, needed: "
        f"{needed}",
        where=trace.source,
        fix=f"name the column when importing: hdbench import --map {column}=COLUMN",
    )
