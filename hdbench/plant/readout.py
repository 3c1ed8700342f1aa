"""From the true channels of a timeline to volts with noise, as they stand before a converter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hdbench.plant.converter import AnalogueSamples
from hdbench.plant.timeline import Timeline
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray

__all__ = ["read_out"]


def read_out(
    timeline: Timeline,
    n_samples: int,
    *,
    profile: ProfileData,
    noise: np.random.Generator,
    added_v: Callable[[NDArray[np.int64], FloatArray], FloatArray],
) -> AnalogueSamples:
    """Return the next samples of `timeline`."""
    first = timeline.served
    true = timeline.advance(n_samples)
    white = noise.standard_normal((n_samples, 2))
    stamps = np.arange(first, first + n_samples)
    added = added_v(stamps, timeline.sample_period_s * stamps.astype(np.float64))
    sensor = profile.sensor
    return AnalogueSamples(
        torque_v=true.volts[0] + added + white[:, 0] * (sensor.noise_nm / sensor.gain_nm_per_v),
        tacho_v=true.volts[1] + white[:, 1] * profile.tacho.noise_v,
        current_v=true.volts[2],
        reference_v=true.reference_v,
        angle_rad=true.angle_rad,
    )
