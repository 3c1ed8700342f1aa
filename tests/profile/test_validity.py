"""Validity of a calibration: its age, and when it is refused."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from runkit import write_run

from hdbench.errors import DataError
from hdbench.profile import scaling
from hdbench.records import Quantity, TorqueScale

NOW = datetime(2026, 6, 1, 12, tzinfo=UTC)
SCALE = TorqueScale(Quantity(6.6, 0.08, 3.0), "calibration R")


def run(folder: Path, **manifest: Any) -> Path:
    """Write a calibration's run folder."""
    gain = {"value": 6.6, "std": 0.08, "dof": 3.0}
    return write_run(folder, "calibration", {"gain_nm_per_v": gain}, **manifest)


def ended(days_ago: float) -> str:
    return (NOW - timedelta(days=days_ago)).isoformat()


def test_a_calibration_of_yesterday_says_so_and_is_used(tmp_path, profile):
    folder = run(tmp_path / "r", ended_utc=ended(1.0))
    scale = scaling.checked_age(scaling.read_calibration(folder), folder, profile, now=NOW)
    assert scale.age_days == pytest.approx(1.0)
    assert scale.expired is False
    assert scale.age_words == "1.0 days old, valid for 365"
    assert scale.gain_nm_per_v.value == 6.6


def test_the_limit_is_the_profiles(tmp_path, profile):
    limit = profile.data.calibration.validity_days
    young = run(tmp_path / "young", ended_utc=ended(limit - 0.01))
    assert scaling.checked_age(SCALE, young, profile, now=NOW).expired is False
    old = run(tmp_path / "old", ended_utc=ended(limit + 0.01))
    with pytest.raises(DataError, match=r"expired: 365\.0 days old; needed: at most 365") as caught:
        scaling.checked_age(SCALE, old, profile, now=NOW)
    assert "--allow-expired" in caught.value.fix


def test_an_expired_one_is_used_knowingly_and_marked(tmp_path, profile):
    folder = run(tmp_path / "r", ended_utc=ended(400.0))
    scale = scaling.checked_age(SCALE, folder, profile, now=NOW, allow_expired=True)
    assert scale.expired is True
    assert "EXPIRED" in scale.age_words
    stored = scaling.stored_scale(json.loads(json.dumps(scale.to_dict())), tmp_path)
    assert stored == scale


def test_weights_that_hung_long_ago_stay_old_when_evaluated_again(tmp_path, profile):
    source = {"source": {"path": "x", "measured_utc": ended(400.0)}}
    folder = run(tmp_path / "r", ended_utc=ended(0.0), details=source)
    assert scaling.measured_utc(folder) == ended(400.0)
    assert scaling.measured_utc(folder / "result.json") == ended(400.0)
    with pytest.raises(DataError, match="expired"):
        scaling.checked_age(SCALE, folder / "result.json", profile, now=NOW)


def test_loads_of_unknown_age_are_at_least_as_old_as_their_evaluation(tmp_path, profile):
    source = {"source": {"path": "loads.csv", "measured_utc": None}}
    folder = run(tmp_path / "r", ended_utc=ended(2.0), details=source)
    assert scaling.calibration_time(folder) == (ended(2.0), False)
    assert scaling.checked_age(SCALE, folder, profile, now=NOW).age_words.startswith(
        "at least 2.0 days"
    )


def test_a_result_without_a_run_has_no_known_age(tmp_path, profile):
    folder = run(tmp_path / "r", ended_utc=ended(2.0))
    (folder / "run.json").unlink()
    scale = scaling.checked_age(SCALE, folder / "result.json", profile, now=NOW)
    assert (scale.age_days, scale.age_words) == (None, "its age is not known")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("2027-01-01T00:00:00+00:00", "in the future"),
        ("yesterday", "cannot be read"),
        ("2026-05-01T00:00:00", "no time zone"),
    ],
)
def test_a_date_that_cannot_be_is_refused(tmp_path, profile, text, words):
    folder = run(tmp_path / "r", ended_utc=text)
    with pytest.raises(DataError, match=words):
        scaling.checked_age(SCALE, folder, profile, now=NOW, allow_expired=True)


def test_a_clock_that_is_minutes_behind_does_no_harm(tmp_path, profile):
    folder = run(tmp_path / "r", ended_utc=ended(-0.01))
    assert scaling.checked_age(SCALE, folder, profile, now=NOW).age_days == 0.0
