"""Recent past of a run for the live view: numbers and short curves from frames, no drawing."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hdbench.filter import OscillatorBlock
from hdbench.session.recorder import Frame

Array = NDArray[np.float64]

# a number on the screen is a mean over this time, s
_NEWEST_S = 0.25


@dataclass(frozen=True, slots=True)
class Curve:
    """One line of the view.

    Parameters
    ----------
    label, unit : str
        What it is.
    column : str
        Column of the trace.
    span_s : float
        How much of the past is drawn, s.
    scale : str
        Curves of one scale are drawn to common ends.
    """

    label: str
    unit: str
    column: str
    span_s: float
    scale: str


@dataclass(frozen=True, slots=True)
class Order:
    """Amplitude of one oscillator of the online filter.

    Parameters
    ----------
    name : str
        ``order 2``, ``output`` or a frequency.
    amplitude_nm : float
        Now, N m.
    spread_nm : float
        Standard deviation over the last two seconds of the run, N m; NaN at first. It tells how
        far the amplitude has settled, for any tuning of the filter.
    """

    name: str
    amplitude_nm: float
    spread_nm: float


# torque over a second shows the ripple as a wave, velocity over twenty the course of the run
CURVES = (
    Curve("velocity", "rad/s", "motor_velocity_rad_s", 20.0, "velocity"),
    Curve("command", "rad/s", "command_rad_s", 20.0, "velocity"),
    Curve("torque", "N m", "torque_nm", 1.0, "torque"),
    Curve("filtered", "N m", "torque_filtered_online_nm", 1.0, "torque"),
    Curve("current", "A", "motor_current_a", 20.0, "current"),
)
_KEPT_S = 20.0
_RATE_S = 2.0
_SPREAD_S = 2.0


@dataclass(slots=True)
class History:
    """The last seconds of a run.

    Parameters
    ----------
    velocity_gain_rad_s_per_v : float
        Commanded motor speed per reference volt, rad/s/V.
    clock : callable
        Monotonic clock, s.
    """

    velocity_gain_rad_s_per_v: float
    clock: Callable[[], float] = time.monotonic
    last: Frame | None = field(default=None, init=False)
    columns: dict[str, Array] = field(default_factory=dict, init=False)
    _seen: list[tuple[float, int, float]] = field(default_factory=list, init=False)
    _amplitudes: list[tuple[float, tuple[float, ...]]] = field(default_factory=list, init=False)
    largest_amplitude_nm: float = field(default=0.0, init=False)

    def add(self, frames: Sequence[Frame]) -> None:
        """Take in new frames, oldest first."""
        if not frames:
            return
        self.last = frames[-1]
        for frame in frames:
            self._join(frame)
        self._seen.append((self.clock(), self.last.rows, self.last.done_s))
        while len(self._seen) > 2 and self._seen[-1][0] - self._seen[1][0] >= _RATE_S:
            self._seen.pop(0)
        for frame in frames:
            now = tuple(found.amplitude_nm for found in frame.amplitudes)
            self._amplitudes.append((frame.done_s, now))
            self.largest_amplitude_nm = max((self.largest_amplitude_nm, *now))
        old_s = self.last.done_s - _SPREAD_S
        self._amplitudes = [entry for entry in self._amplitudes if entry[0] >= old_s]

    def _join(self, frame: Frame) -> None:
        new = {name: np.asarray(values, dtype=float) for name, values in frame.columns.items()}
        if "reference_v" in new:
            new["command_rad_s"] = new["reference_v"] * self.velocity_gain_rad_s_per_v
        names = {"time_s", *(curve.column for curve in CURVES)}
        for name in names & set(new):
            old = self.columns.get(name)
            self.columns[name] = new[name] if old is None else np.concatenate([old, new[name]])
        time_s = self.columns.get("time_s", np.empty(0))
        first = int(np.searchsorted(time_s, time_s[-1] - _KEPT_S)) if len(time_s) else 0
        # cut rarely: a copy of twenty seconds per block would be most of the work
        if first > len(time_s) // 2:
            self.columns = {name: values[first:] for name, values in self.columns.items()}

    def rate_hz(self) -> float:
        """Return samples per second of the wall clock over the last two seconds; NaN at first."""
        (start_s, start, _), (end_s, end, _) = self._ends()
        return (end - start) / (end_s - start_s) if end_s > start_s else math.nan

    def eta_s(self) -> float:
        """Return what is left at the present pace, s; NaN where that is not known."""
        (start_s, _, start), (end_s, _, end) = self._ends()
        if self.last is None or not (end > start and end_s > start_s):
            return math.nan
        return (self.last.total_s - end) * (end_s - start_s) / (end - start)

    def _ends(self) -> tuple[tuple[float, int, float], tuple[float, int, float]]:
        nothing = (0.0, 0, 0.0)
        return (self._seen[0], self._seen[-1]) if self._seen else (nothing, nothing)

    def curve(self, curve: Curve, points: int) -> Array:
        """Return a curve as means of equal parts of its span, NaN where there is nothing."""
        values = self.columns.get(curve.column)
        out = np.full(points, math.nan)
        if values is None or not len(values):
            return out
        time_s = self.columns["time_s"]
        part = np.ceil((time_s - (time_s[-1] - curve.span_s)) / curve.span_s * points).astype(int)
        good = (part >= 1) & (part <= points) & np.isfinite(values)
        counts = np.bincount(part[good] - 1, minlength=points)
        sums = np.bincount(part[good] - 1, weights=values[good], minlength=points)
        out[counts > 0] = sums[counts > 0] / counts[counts > 0]
        return out

    def newest(self, curve: Curve) -> float:
        """Return the mean of the newest quarter of a second of a curve; NaN where it is empty."""
        values = self.columns.get(curve.column)
        if values is None or not len(values):
            return math.nan
        time_s = self.columns["time_s"]
        recent = values[time_s > time_s[-1] - _NEWEST_S]
        recent = recent[np.isfinite(recent)]
        return float(np.mean(recent)) if len(recent) else math.nan

    def largest(self, column: str) -> float:
        """Return the largest magnitude of a column that is still kept; NaN where there is none."""
        values = self.columns.get(column, np.empty(0))
        values = values[np.isfinite(values)]
        return float(np.max(np.abs(values))) if len(values) else math.nan

    def orders(self) -> list[Order]:
        """Return the amplitude of every oscillator of the online filter."""
        if self.last is None or not self._amplitudes:
            return []
        past = np.array([amplitudes for _, amplitudes in self._amplitudes])
        spread = np.std(past, axis=0, ddof=1) if len(past) > 1 else np.full(past.shape[1], math.nan)
        return [
            Order(_name(found.block), found.amplitude_nm, float(std))
            for found, std in zip(self.last.amplitudes, spread, strict=True)
        ]


def _name(block: OscillatorBlock) -> str:
    if block.frequency_hz:
        return f"{block.frequency_hz:.4g} Hz"
    return "output" if block.role == "misalignment" else f"order {block.order:.4g}"
