"""Causes that follow the clock."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdbench.model.causes._needs import lasts
from hdbench.model.causes._parts import pair, pair_parameters
from hdbench.model.definition import Cause, Parameter
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = ["MAINS_HUM", "STRUCTURAL_TONE"]

# European and American mains keep within 1 % of nominal; a record's own clock is far better
_MAINS_BANDS = ((49.5, 50.5), (59.5, 60.5))


def _tone(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    return pair(2.0 * np.pi * shape["frequency_hz"] * motion.time_s)


def _mains_applicable(motion: Motion) -> str | None:
    steps = np.diff(motion.time_s)
    rate = 1.0 / float(np.median(steps)) if len(steps) else 0.0
    if rate > 2.0 * _MAINS_BANDS[0][1]:
        return None
    return f"{rate:.4g} samples/s; needed: more than {2.0 * _MAINS_BANDS[0][1]:g} to see 50 Hz"


MAINS_HUM = Cause(
    name="mains-hum",
    equation="A cos(2 pi f t + phase), f near 50 or 60 Hz",
    shape=(
        Parameter("frequency_hz", "Hz", 49.5, 60.5, "frequency of the mains", bands=_MAINS_BANDS),
    ),
    linear=pair_parameters("the hum"),
    locked_to="clock",
    parity="does not depend on speed or load; present at rest",
    channel="acquisition",
    look_alikes=("structural-tone", "ripple-harmonic"),
    experiment="rest with the drive off, then a second speed",
    source="nominal mains frequencies 50 and 60 Hz",
    columns=_tone,
    harmonic=True,
    applicable=_mains_applicable,
)
STRUCTURAL_TONE = Cause(
    name="structural-tone",
    equation="A cos(2 pi f t + phase)",
    shape=(Parameter("frequency_hz", "Hz", 0.5, 5000.0, "frequency of the tone"),),
    linear=pair_parameters("the tone"),
    locked_to="clock",
    parity="frequency does not depend on speed or load",
    channel="mechanical",
    look_alikes=("mains-hum", "ripple-harmonic", "torsional-resonance", "tooth-mesh"),
    experiment="rest and a second speed: a tone keeps its frequency in Hz",
    source="one line of a spectrum over time",
    columns=_tone,
    harmonic=True,
    # shorter than this, a tone and the trend of the motion cannot be separated
    applicable=lasts(1.0),
)
