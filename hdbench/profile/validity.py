"""How old a calibration is, and whether it may still scale a run."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from hdbench.errors import DataError
from hdbench.profile.loader import Profile
from hdbench.records import TorqueScale
from hdbench.records.jsonfile import read_json

__all__ = ["calibration_time", "checked_age", "measured_utc"]

# clocks of two computers may differ by minutes; by an hour where one keeps the wrong season
_CLOCK_SLACK = timedelta(hours=1)


def measured_utc(run: Path) -> str | None:
    """Return when the data of a run were measured."""
    file = (run if run.is_dir() else run.parent) / "run.json"
    if not file.is_file():
        return None
    manifest = read_json(file)
    details = manifest.get("details")
    source = details.get("source") if isinstance(details, dict) else None
    known = source.get("measured_utc") if isinstance(source, dict) else manifest.get("ended_utc")
    return known if isinstance(known, str) else None


def calibration_time(path: Path) -> tuple[str | None, bool]:
    """Return when a calibration was made."""
    measured = measured_utc(path)
    if measured is not None:
        return measured, True
    folder = path if path.is_dir() else path.parent
    if not (folder / "run.json").is_file():
        return None, False
    manifest: dict[str, Any] = read_json(folder / "run.json")
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
