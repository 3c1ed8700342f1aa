"""Reasons to doubt records that another program or a person wrote."""

from __future__ import annotations

from pathlib import Path

from hdbench.profile import Profile
from hdbench.records import Loads
from hdbench.records.trace import Trace

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
