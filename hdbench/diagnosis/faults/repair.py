"""Repair: a trace without faults of angle, tacho and clock that have a name and numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from hdbench.diagnosis.faults.shaft import ANGLES, VELOCITIES, angle_of, scaled
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import Trace

__all__ = ["without_faults"]


def without_faults(
    trace: Trace, profile: ProfileData, faults: Iterable[tuple[str, Mapping[str, float]]]
) -> Trace:
    """Return the trace without faults, each a name of the catalogue and its shape."""
    timed = []
    angle = angle_of(trace, profile)
    for name, shape in faults:
        if name == "tacho-ripple" and angle is not None:
            turned = shape["order"] * np.nan_to_num(angle)
            ripple = shape["cosine"] * np.cos(turned) + shape["sine"] * np.sin(turned)
            trace = scaled(trace, VELOCITIES, 1.0 / (1.0 + ripple))
        elif name in ("encoder-slip", "missed-samples"):
            timed.append((shape["step_time_s"], shape))
    # the last ones first: a loss moves the stamps of all samples after it
    for place, shape in sorted(timed, key=lambda one: -one[0]):
        later = trace.time_s > place
        columns = {"time_s": trace.time_s + later * shape.get("missed_s", 0.0)}
        counts = profile.encoder.counts_per_turn / (2.0 * np.pi)
        for name, scale in zip(ANGLES, (1.0, counts), strict=True):
            if name in trace and "slip_rad" in shape:
                columns[name] = trace[name] - later * (shape["slip_rad"] * scale)
        trace = trace.with_columns(**columns)
    return trace
