"""Gain of the filter: orders that were found as blocks of it, before and after."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hdbench.diagnosis.answer.result import Diagnosis
from hdbench.errors import DataError
from hdbench.filter import FilterModel, OscillatorBlock, filter_trace, load_filter_model
from hdbench.model import Motion
from hdbench.profile import Profile
from hdbench.records.trace import FloatArray, Trace
from hdbench.results.diagnosis import BeforeAfter, FilterGain, GainedBlock, NamedCause

# causes at a whole multiple of the wave generator's or the output's turn that have no order in
# their parameters
_OF_TURNS: dict[str, tuple[Any, float]] = {
    "wave-generator-eccentricity": ("ripple", 1.0),
    "motor-unbalance": ("ripple", 1.0),
    "misalignment": ("misalignment", 1.0),
    "load-gravity": ("misalignment", 1.0),
    "angular-misalignment": ("misalignment", 2.0),
}
# orders that are no torque ripple but tones of the clock need a block of another kind
_RIPPLE_NAMES = ("ripple-harmonic", "bearing-defect", "cogging")


def further_blocks(causes: Sequence[NamedCause], base: FilterModel) -> tuple[OscillatorBlock, ...]:
    """Return the blocks that the causes add to a filter."""
    found: list[OscillatorBlock] = []
    for cause in causes:
        order, role = _place(cause, base.gear_ratio)
        taken = [block.order for block in (*base.blocks, *found)]
        # orders that differ by less are one line to the filter
        if order is None or any(abs(order - other) <= 1e-3 * order for other in taken):
            continue
        like = next((b for b in base.blocks if b.role == role), base.blocks[0])
        found.append(replace(like, order=order, role=role))
    return tuple(found)


def _place(cause: NamedCause, gear_ratio: float) -> tuple[float | None, Any]:
    if cause.name in _OF_TURNS:
        role, number = _OF_TURNS[cause.name]
        return number if role == "ripple" else number / gear_ratio, role
    order = cause.parameters.get("order") if cause.name in _RIPPLE_NAMES else None
    return None if order is None else order.value, "ripple"


def filter_gain(
    trace: Trace, motion: Motion, profile: Profile, found: Diagnosis
) -> FilterGain | None:
    """Filter a record without and with the orders that were found."""
    base = load_filter_model(profile.data.filter.model, profile.data)
    blocks = further_blocks(found.causes, base)
    if not blocks or found.pictures is None:
        return None
    model = replace(base, name=f"{base.name}-extended", blocks=(*base.blocks, *blocks))
    try:
        filtered = (filter_trace(trace, one, profile.data) for one in (base, model))
        left = [np.asarray(one.torque_filtered_nm) for one in filtered]
    except DataError:
        return None
    # what a filter should leave: the extended model without lines
    lines = (*_OF_TURNS, *_RIPPLE_NAMES)
    causes = tuple(term for term in found.model.causes if term.name not in lines)
    bare = replace(found.model, ripple=(), misalignment=(0.0, 0.0), causes=causes)
    target = bare.torque_nm(motion)
    time = trace.time_s
    # the filter settles within a fifth of the record, and within 5 s
    start = float(time[0]) + min(5.0, 0.2 * float(time[-1] - time[0]))
    pictures = found.pictures
    used = (time >= start) & np.isfinite(left[0] + left[1] + target) & ~pictures.masked
    used &= np.isfinite(pictures.motor_angle_rad)
    if not used.any():
        return None
    errors = [(values - target)[used] for values in left]
    angle = pictures.motor_angle_rad[used]
    gained = (
        GainedBlock(
            order=block.order,
            role=block.role,
            amplitude_nm=BeforeAfter(*(_amplitude(e, block.order * angle) for e in errors)),
        )
        for block in blocks
    )
    return FilterGain(
        model=model.name,
        from_s=start - float(time[0]),
        error_rms_nm=BeforeAfter(*(float(np.sqrt(np.mean(error**2))) for error in errors)),
        blocks=tuple(gained),
    )


def _amplitude(values: FloatArray, phase: FloatArray) -> float:
    columns = np.column_stack([np.cos(phase), np.sin(phase), np.ones(len(phase))])
    cosine, sine, _ = np.linalg.lstsq(columns, values, rcond=None)[0]
    return float(np.hypot(cosine, sine))
