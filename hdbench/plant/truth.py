"""Everything that a bench simulates, ready for JSON."""

from __future__ import annotations

import math
from dataclasses import asdict

from hdbench.plant.effects import EFFECT_KINDS, Effect
from hdbench.plant.fixture import GAIN_HARMONICS, PositionGain
from hdbench.plant.torque import AnalogueChannels
from hdbench.profile.schema import ProfileData

__all__ = ["sensor_truth", "torque_truth"]


def sensor_truth(gain: PositionGain, channels: AnalogueChannels) -> dict[str, object]:
    """Return gain and gauges."""
    positions = [2.0 * math.pi * k / GAIN_HARMONICS for k in range(GAIN_HARMONICS)]
    return {
        "gain_nm_per_v": gain.mean_nm_per_v,
        "gain_spread": gain.spread,
        "gain_at_position": [[position, gain.at(position)] for position in positions],
        "gauges": asdict(channels.bridge),
    }


def torque_truth(profile: ProfileData, effects: tuple[Effect, ...]) -> dict[str, object]:
    """Return every component of the torque channel."""
    drive, model = profile.drive, profile.model
    factor = 1.0 + 1.0 / drive.gear_ratio if drive.flexspline == "turning" else 1.0
    ripple = [
        {
            "order": part.order * factor,
            "amplitude_nm": part.amplitude_nm,
            "phase_rad": part.phase_rad,
        }
        for part in model.ripple
    ]
    misalignment = {
        "amplitude_nm": model.misalignment.amplitude_nm,
        "phase_rad": model.misalignment.phase_rad,
    }
    names = {record: kind for kind, record in EFFECT_KINDS.items()}
    return {
        "zero_nm": model.zero_nm,
        "load_inertia_kg_m2": drive.load_inertia_kg_m2,
        "ripple": ripple,
        "misalignment": misalignment,
        "effects": [{"kind": names[type(effect)], **asdict(effect)} for effect in effects],
    }
