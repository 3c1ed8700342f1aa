"""Curves of a run with motion: measured, expected, filtered, low-passed; its steady stretch."""

from __future__ import annotations

import math
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
from hdbench.report.canvas import Panel, new_figure
from hdbench.report.pagemodel import Picture
from hdbench.report.source import Source
from hdbench.report.texts import page_text

# a motor slower than this share of its top speed stands still or starts
_MOVING_SHARE = 0.1
# turns of the wave generator in a close-up: enough to see orders 2 and 4, few enough to tell them
_ZOOM_TURNS = 4.0
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
    block = filter_trace(trace, model, profile.data)
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


def filter_picture(
    signals: Signals,
    filtered: Filtered,
    lowpass_hz: float | None,
    steady: SteadyStretch | None,
    name: str,
    *,
    figure_number: str,
) -> Picture:
    """Draw measured against filtered torque: the whole run and a close-up."""
    figure, (whole, close) = new_figure(2, 4.8)
    lowpass = None if lowpass_hz is None else signals.lowpass_nm
    for axes, cut in ((whole, slice(None)), (close, _close_up(signals, steady))):
        line, width = (":", 1.1) if axes is close else ("-", 0.7)
        time, torque, smooth = (
            v[cut] for v in (signals.time_s, signals.torque_nm, filtered.torque_nm)
        )
        axes.curve(time, torque, "measured", line, linewidth=width, label="measured")
        if lowpass is not None:
            axes.curve(time, lowpass[cut], "lowpass", "--", label="low-pass")
        axes.curve(time, smooth, "filtered", label="Kalman filtered")
        _limits(axes, torque, smooth)
    whole.label(None, "torque (N·m)")
    whole.legend_above()
    close.label("time (s)", "torque (N·m)", "close-up")
    rms = [_spread(signals, torque, steady) for torque in (signals.torque_nm, filtered.torque_nm)]
    orders = ", ".join(f"{block.order:g}" for block in filtered.model.blocks)
    smoothed = "" if lowpass is None else " " + page_text("lowpass", cutoff_hz=lowpass_hz)
    return Picture.drawn(
        figure,
        name,
        "filter",
        number=figure_number,
        model=filtered.model.name,
        how="computed while the run was sampled" if filtered.online else "computed from the trace",
        orders=orders,
        where="In the steady stretch" if steady is not None else "Over the whole run",
        measured=rms[0],
        filtered=rms[1],
        lowpass=smoothed,
    )


def _close_up(signals: Signals, steady: SteadyStretch | None) -> slice:
    if steady is None:
        first, last = float(signals.time_s[0]), float(signals.time_s[-1])
        middle = 0.5 * (first + last)
        return signals.during(middle, middle + 0.05 * (last - first))
    turn_s = 2.0 * math.pi / max(abs(steady.velocity_rad_s), 1e-9)
    middle = 0.5 * (steady.from_s + steady.to_s)
    return signals.during(middle, min(middle + _ZOOM_TURNS * turn_s, steady.to_s))


def _limits(axes: Panel, torque: FloatArray, filtered: FloatArray) -> None:
    """Hold all of the measured torque and 98 % of the filtered: its start may leave the frame."""
    present, settled = torque[np.isfinite(torque)], filtered[np.isfinite(filtered)]
    if len(settled):
        present = np.concatenate([present, np.percentile(settled, [1.0, 99.0])])
    if len(present):
        low, high = float(present.min()), float(present.max())
        margin = 0.1 * (high - low) or 1.0
        axes.set_ylim(low - margin, high + margin)


def _spread(signals: Signals, torque: FloatArray, steady: SteadyStretch | None) -> float:
    part = torque if steady is None else torque[signals.during(steady.from_s, steady.to_s)]
    return float(np.nanstd(part)) if np.isfinite(part).any() else 0.0
