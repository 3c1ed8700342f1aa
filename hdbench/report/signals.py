"""The curves of a dynamic run: measured, expected, filtered, low-passed; its steady stretch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hdbench.errors import DataError
from hdbench.estimation.stretches import SteadyStretch
from hdbench.filter import FilterModel, butterworth_lowpass, filter_trace, preset
from hdbench.model.motion import Motion, motion_from_trace
from hdbench.profile import Profile
from hdbench.profile.scaling import profile_scale, stored_scale
from hdbench.records import FloatArray, Trace
from hdbench.report.source import Source

# a motor slower than this share of its top speed stands still or starts
_MOVING_SHARE = 0.1
# a shorter stretch shows neither a scatter nor a spectrum
_FEWEST_SAMPLES = 64


@dataclass(frozen=True, slots=True)
class Filtered:
    """A filtered torque, N m, and what made it; `online` where it was recorded while sampling."""

    model: FilterModel
    torque_nm: FloatArray
    online: bool


@dataclass(frozen=True, slots=True)
class Signals:
    """Curves over time, each of shape (n,); without a profile there are the first three only.

    `expected_nm` is load inertia times acceleration over gear ratio, without lag. `fourth` is the
    torque behind the filter of orders 2 and 4; `own` behind the run's own, or behind that with
    order 6 where the run has none.
    """

    time_s: FloatArray
    torque_nm: FloatArray
    velocity_rad_s: FloatArray
    motion: Motion | None = None
    expected_nm: FloatArray | None = None
    fourth: Filtered | None = None
    own: Filtered | None = None
    lowpass_nm: FloatArray | None = None

    def during(self, from_s: float, to_s: float) -> slice:
        """Return the samples of a stretch, two at least."""
        start, stop = np.searchsorted(self.time_s, (from_s, to_s))
        return slice(int(start), int(max(stop, start + 2)))


def make_signals(source: Source, doubts: list[str]) -> Signals | None:
    """Compute the curves of a run."""
    trace, profile = source.trace, source.profile
    if trace is None:
        return None
    trace = _with_torque(source, trace)
    time, torque, unknown = trace.time_s, trace["torque_nm"], np.full(len(trace), np.nan)
    if profile is None:
        doubts.append("No profile: nothing is filtered and no expected torque is drawn.")
        return Signals(time, torque, trace.columns.get("motor_velocity_rad_s", unknown))
    try:
        motion = motion_from_trace(trace, profile.data)
    except DataError as error:
        doubts.append(f"No motion could be read: {error.what}.")
        return Signals(time, torque, unknown)
    drive = profile.data.drive
    return Signals(
        time,
        torque,
        motion.velocity_rad_s,
        motion,
        drive.load_inertia_kg_m2 / drive.gear_ratio * motion.acceleration_rad_s2,
        _filtered(trace, preset("report-a1", profile.data), profile),
        _own(source, trace, profile),
        _lowpass(trace, profile),
    )


def _with_torque(source: Source, trace: Trace) -> Trace:
    if "torque_nm" in trace:
        return trace
    said = source.stored.get("torque_scale") or source.detail("calibration")
    scale = stored_scale(said, source.path)
    if scale is None and source.profile is not None:
        scale = profile_scale(source.profile)
    if scale is None:
        raise DataError(
            "the trace holds volts and nothing says how many newton metres they are",
            where=f"{trace.source}: torque_v",
            fix="give --profile, or report on the run folder",
        )
    return trace.with_columns(torque_nm=trace["torque_v"] * scale.gain_nm_per_v.value)


def filter_model_of(source: Source) -> FilterModel | None:
    """Return the run's own filter, or None where it names none."""
    stored = source.detail("filter")
    if not isinstance(stored, Mapping):
        return None
    return FilterModel.from_dict(stored, source=f"{source.run_id}: filter")


def _own(source: Source, trace: Trace, profile: Profile) -> Filtered:
    model = filter_model_of(source)
    online = trace.columns.get("torque_filtered_online_nm")
    if online is not None and model is not None:
        return Filtered(model, online, online=True)
    if model is None or len(model.blocks) < 3:
        model = preset("report-6", profile.data)
    return _filtered(trace, model, profile)


def _filtered(trace: Trace, model: FilterModel, profile: Profile) -> Filtered:
    block = filter_trace(
        trace,
        model,
        profile.data,
    )
    return Filtered(model, block.torque_filtered_nm, online=False)


def _lowpass(trace: Trace, profile: Profile) -> FloatArray | None:
    settings = profile.data.filter
    period = float(np.median(np.diff(trace.time_s))) if len(trace) > 1 else 0.0
    if not 0.0 < settings.butterworth_cutoff_hz * period < 0.5:
        return None
    return butterworth_lowpass(
        trace["torque_nm"],
        sample_period_s=period,
        cutoff_hz=settings.butterworth_cutoff_hz,
        order=settings.butterworth_order,
    )


def steady_stretch(signals: Signals, tolerance: float) -> SteadyStretch | None:
    """Return the longest stretch at the velocity that the motor held for most of the samples.

    That velocity is the fullest bin of a histogram, as wide as the tolerance at top speed.
    """
    time, velocity = signals.time_s, signals.velocity_rad_s
    present = np.isfinite(velocity) & np.isfinite(signals.torque_nm)
    top = float(np.max(np.abs(velocity[present]), initial=0.0))
    if not top > 0.0:
        return None
    moving = present & (np.abs(velocity) > _MOVING_SHARE * top)
    width = tolerance * top
    counts = np.bincount(np.round((velocity[moving] + top) / width).astype(np.intp))
    level = float(np.argmax(counts)) * width - top
    near = present & (np.abs(velocity - level) <= 2.0 * width)
    edges = np.flatnonzero(np.diff(near.astype(np.int8), prepend=0, append=0))
    starts, stops = edges[::2], edges[1::2]
    best = int(np.argmax(stops - starts))
    start, stop = int(starts[best]), int(stops[best])
    if stop - start < _FEWEST_SAMPLES:
        return None
    speed = float(np.mean(velocity[start:stop]))
    return SteadyStretch(start, stop, float(time[start]), float(time[stop - 1]), speed)
