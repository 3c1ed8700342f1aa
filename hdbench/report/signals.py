"""The curves of a dynamic run: measured, expected, filtered, low-passed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdbench.errors import DataError
from hdbench.filter import FilterModel, butterworth_lowpass, filter_trace, preset
from hdbench.model.motion import Motion, motion_from_trace
from hdbench.profile import Profile
from hdbench.profile.scaling import profile_scale, stored_scale
from hdbench.records import FloatArray, Trace
from hdbench.report.source import Source

__all__ = ["Filtered", "Signals", "filter_model_of", "make_signals", "window"]


@dataclass(frozen=True, slots=True)
class Filtered:
    """A filtered torque and what made it.

    Parameters
    ----------
    name : str
        Name of the filter.
    orders : tuple of float
        Motor orders of its blocks.
    torque_nm : ndarray, shape (n,)
        Filtered torque, N m.
    online : bool
        True where it was recorded while sampling.
    """

    name: str
    orders: tuple[float, ...]
    torque_nm: FloatArray
    online: bool


@dataclass(frozen=True, slots=True)
class Signals:
    """Curves over time, each of shape (n,).

    Parameters
    ----------
    time_s, torque_nm, velocity_rad_s : ndarray
        Time, s; measured torque, N m; motor velocity, rad/s.
    motion : Motion or None
        Angles and acceleration; None without a profile.
    expected_nm : ndarray or None
        Load inertia times acceleration over gear ratio, N m, without lag.
    fourth, own : Filtered or None
        Filter with orders 2 and 4; the run's own filter, sixth order where it has none.
    lowpass_nm : ndarray or None
        Butterworth low-pass of the profile, N m.
    """

    time_s: FloatArray
    torque_nm: FloatArray
    velocity_rad_s: FloatArray
    motion: Motion | None
    expected_nm: FloatArray | None
    fourth: Filtered | None
    own: Filtered | None
    lowpass_nm: FloatArray | None


def make_signals(source: Source, doubts: list[str]) -> Signals | None:
    """Compute the curves of a run."""
    trace, profile = source.trace, source.profile
    if trace is None:
        return None
    trace = _with_torque(source, trace)
    if profile is None:
        velocity = trace.columns.get("motor_velocity_rad_s", np.full(len(trace), np.nan))
        doubts.append("No profile: nothing is filtered and no expected torque is drawn.")
        return Signals(trace.time_s, trace["torque_nm"], velocity, None, None, None, None, None)
    try:
        motion = motion_from_trace(trace, profile.data)
    except DataError as error:
        doubts.append(f"No motion could be read: {error.what}.")
        return Signals(trace.time_s, trace["torque_nm"], np.full(len(trace), np.nan), *(None,) * 5)
    drive = profile.data.drive
    expected = drive.load_inertia_kg_m2 / drive.gear_ratio * motion.acceleration_rad_s2
    return Signals(
        trace.time_s,
        trace["torque_nm"],
        motion.velocity_rad_s,
        motion,
        expected,
        _filtered(trace, preset("report-a1", profile.data), profile),
        _own(source, trace, profile),
        _lowpass(trace, profile),
    )


def _with_torque(source: Source, trace: Trace) -> Trace:
    if "torque_nm" in trace:
        return trace
    said = source.result.get("torque_scale") or source.detail("calibration")
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


def filter_model_of(source: Source) -> tuple[FilterModel, str] | None:
    """Return the run's own filter and where it stands, or None where it names none."""
    stored = source.detail("filter")
    if isinstance(stored, Mapping):
        return FilterModel.from_dict(stored, source=f"{source.run_id}: filter"), "run.json"
    return None


def _own(source: Source, trace: Trace, profile: Profile) -> Filtered:
    found = filter_model_of(source)
    model = found[0] if found else preset("report-6", profile.data)
    online = trace.columns.get("torque_filtered_online_nm")
    if online is not None and found:
        return Filtered(model.name, tuple(b.order for b in model.blocks), online, True)
    if len(model.blocks) < 3:
        model = preset("report-6", profile.data)
    return _filtered(trace, model, profile)


def _filtered(trace: Trace, model: FilterModel, profile: Profile) -> Filtered:
    block = filter_trace(
        trace,
        model,
        velocity_gain_rad_s_per_v=profile.data.tacho.gain_rad_s_per_v,
        encoder_counts_per_turn=profile.data.encoder.counts_per_turn,
    )
    orders = tuple(b.order for b in model.blocks)
    return Filtered(model.name, orders, block.torque_filtered_nm, False)


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


def window(time_s: FloatArray, from_s: float, length_s: float) -> Any:
    """Return the slice of samples from `from_s` on, `length_s` long."""
    start, stop = np.searchsorted(time_s, (from_s, from_s + length_s))
    return slice(int(start), int(max(stop, start + 2)))
