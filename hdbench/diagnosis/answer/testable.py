"""Testable names: which causes of the catalogue a record can show, and why not the others."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hdbench.diagnosis.evidence import PASSED
from hdbench.model import Cause, Motion, shape_bounds
from hdbench.records.trace import FloatArray
from hdbench.results.diagnosis import Testable

# middle, low and high of the shapes that this record can tell apart, as shares of their domain; not
# its very ends, where a step is one sample
_SHAPES = (0.5, 0.1, 0.9)
# causes without columns whose power is spread up to half the sampling rate
_WHITE = frozenset({"quantisation", "spikes", "speed-dependent-noise"})
# motor turns between two samples at which ripple of order 2 reaches half the sampling rate
_RIPPLE_TURNS = 0.25
_ANGLES = frozenset({"motor_angle_rad", "encoder_count", "motor_velocity_rad_s", "tacho_v"})


@dataclass(frozen=True, slots=True)
class TorqueChannel:
    """What limits the torque channel."""

    low_pass_hz: float  # infinite where nothing is hidden by one
    rate_hz: float
    step_nm: float
    noise_nm: float
    held_share: float  # of its samples

    @property
    def bandwidth_hz(self) -> float:
        """Where it ends; held samples leave a lower rate."""
        return min(self.low_pass_hz, 0.5 * self.rate_hz * (1.0 - self.held_share))

    @property
    def limit(self) -> str:
        """What ends it, in words."""
        end = self.bandwidth_hz
        if end < self.low_pass_hz:
            held = f"{100.0 * self.held_share:.2g} % of the torque samples are held"
            return f"{held}, it ends at {end:.3g} Hz"
        return f"torque low-passed at {end:.3g} Hz"

    @property
    def whole(self) -> bool:
        """Whether nothing is hidden by a low-pass."""
        # filters against aliases end at 0.8 of half the sampling rate
        return not self.bandwidth_hz < 0.4 * self.rate_hz

    def hides(self, from_hz: float) -> str:
        """Say that what stands above a frequency is not seen."""
        return f"{self.limit}; nine tenths of it would stand above {from_hz:.3g} Hz here"


def testable(
    causes: Iterable[Cause],
    motion: Motion,
    torque: TorqueChannel,
    derived: tuple[tuple[str, str], ...],
) -> tuple[Testable, ...]:
    """Say of each cause whether this record can show it.

    Its columns, at a low, a middle and a high shape, must change on stretches of this motion and
    hold a tenth of their power in the torque's band. Causes without columns are white noise or
    faults of angle and clock, shown by a ripple of order 2 or a second channel.
    """
    # two channels of the motion that do not come from one another
    second = motion.angle_source != "velocity" and not any(set(p) <= _ANGLES for p in derived)
    part, points = _stretches(motion, torque)
    told = []
    for cause in causes:
        reason, but = cause.applicable(motion) or "", ""
        if not reason and cause.additive:
            reason, but = _additive(cause, motion, part, points, torque)
        elif not reason:
            reason = _other(cause, part, points, torque, second)
        told.append(Testable(cause.name, not reason, reason or but))
    return tuple(told)


def _stretches(motion: Motion, torque: TorqueChannel) -> tuple[Motion, int]:
    """Return stretches of the motion, one after the other, and the points of each."""
    count = len(motion)
    # a stretch holds eight periods of the torque's bandwidth, to part what is below from above;
    # where nothing limits the torque it only has to change
    length = 256 if torque.whole else int(8.0 * torque.rate_hz / torque.bandwidth_hz) + 2
    length = min(length, 4096, count)
    # points at which columns are formed (1 ms a cause), in 32 stretches, fewer where they are long
    points = 16_384
    most = points // (length * 32)
    # points are up to 16 times finer than the samples, and at random times: a line above half the
    # sampling rate is spread, not taken for its alias
    finer = 1 if torque.whole else min(max(most, 1), 16)
    parts = min(max(8, points // (length * finer)), count // length)
    begins = np.linspace(0, count - length, parts).round()
    inside = np.arange(float(length))
    if not torque.whole:
        at_random = np.random.default_rng(0).random((length - 1) * finer)
        inside = (np.arange(len(at_random)) + at_random) / finer
    places = (begins[:, None] + inside).ravel()
    low = np.floor(places).astype(int)
    high = np.minimum(low + 1, count - 1)
    share = places - low

    def at(values: FloatArray) -> FloatArray:
        return np.asarray(values[low] + share * (values[high] - values[low]))

    arrays: dict[str, Any] = {
        name: at(values)
        for name in Motion.__dataclass_fields__
        if isinstance(values := getattr(motion, name), np.ndarray) and values.dtype.kind == "f"
    }
    starts = np.zeros(len(places), dtype=bool)
    starts[:: len(inside)] = True
    valid = motion.valid[low] & motion.valid[high]
    whole = replace(motion, bridged=None, shown_by_angle=None)
    return replace(whole, **arrays, valid=valid, starts=starts), len(inside)


def _shape(
    cause: Cause, bounds: Mapping[str, tuple[tuple[float, float], ...]], at: float
) -> dict[str, float]:
    """Return the shape at a share of each domain: 0 its low, 1 its high end."""
    shape = {}
    for parameter in cause.shape:
        bands = bounds[parameter.name]
        low, high = bands[round(at * (len(bands) - 1))]
        shape[parameter.name] = low * (high / low) ** at if low > 0.0 else low + at * (high - low)
    return shape


def _additive(
    cause: Cause, motion: Motion, part: Motion, points: int, torque: TorqueChannel
) -> tuple[str, str]:
    """Return why a cause cannot be shown, or what of it is not seen, by where its power is."""
    bounds = shape_bounds(cause, motion)
    empty = next((name for name, bands in bounds.items() if not bands), None)
    if empty is not None:
        return f"no {empty} of its domain can be seen on this record", ""
    looks = []
    for at in _SHAPES if cause.shape else _SHAPES[:1]:
        looks.append(_look(cause.columns(part, _shape(cause, bounds, at)), part, points, torque))
        if torque.whole and looks[-1].changes:
            break
    seen = [look for look in looks if look.changes]
    if not seen:
        return "it is the same all along this record; needed: a change, else it is a zero", ""
    hidden = [look for look in seen if look.inside < PASSED]
    if len(hidden) == len(seen):
        return torque.hides(min(one.from_hz for one in hidden)), ""
    return "", f"{torque.limit}; what stands above is not seen" if hidden else ""


@dataclass(frozen=True, slots=True)
class _Look:
    """Whether columns change on this motion, their share in the band, where nine tenths begin."""

    changes: bool
    inside: float
    from_hz: float


def _look(columns: FloatArray, part: Motion, points: int, torque: TorqueChannel) -> _Look:
    """Return where the power of the column that is best seen stands."""
    weight = (part.valid & np.isfinite(columns).all(axis=1)).astype(float)[:, None]
    columns = np.where(weight > 0.0, columns, 0.0)
    total = np.sum(columns**2, axis=0)
    left = (columns - columns.sum(axis=0) / max(weight.sum(), 1.0)) * weight
    # an effect that changes by less than 1 % of its size is a zero
    changes = np.sum(left**2, axis=0) > 1e-4 * total
    if not changes.any():
        return _Look(False, 0.0, 0.0)
    if torque.whole:
        return _Look(True, 1.0, 0.0)
    taper = np.hanning(points)[:, None]
    waves = np.fft.rfft(taper * left.reshape(-1, points, left.shape[1]), axis=1)
    power = np.sum(waves.real**2 + waves.imag**2, axis=0)[:, changes]
    step_s = float(part.time_s[points - 1] - part.time_s[0]) / (points - 1)
    frequency = np.fft.rfftfreq(points, step_s)
    below = np.cumsum(power, axis=0) / power.sum(axis=0)
    inside = below[np.searchsorted(frequency, torque.bandwidth_hz, side="right") - 1]
    best = int(np.argmax(inside))
    from_hz = frequency[int(np.searchsorted(below[:, best], 0.1))]
    return _Look(True, float(inside[best]), float(from_hz))


def _other(cause: Cause, part: Motion, points: int, torque: TorqueChannel, second: bool) -> str:
    """Return why a cause without columns cannot be shown: noise, or a fault of angle or clock."""
    if cause.change_motion is not None:
        return "" if second else _of_motion(cause, part, points, torque)
    # steps that are seen are there at any bandwidth
    stepped = cause.name == "quantisation" and torque.step_nm > 0.0
    share = torque.bandwidth_hz / (0.5 * torque.rate_hz)
    if cause.name in _WHITE and not stepped and not torque.whole and share < PASSED:
        return torque.hides(0.05 * torque.rate_hz)
    if cause.locked_to == "velocity":
        pace = float(np.quantile(np.abs(part.velocity_rad_s[part.valid]), 0.9))
        turns = pace / (2.0 * np.pi * torque.rate_hz)
        if turns > _RIPPLE_TURNS:
            return (
                f"the motor turns {turns:.2g} times between two samples; needed: less than "
                f"{_RIPPLE_TURNS:g}, else ripple looks like noise"
            )
        # noise that is less than a fifth of a step of the readings moves one reading in eighty
        if torque.noise_nm < 0.2 * torque.step_nm:
            return (
                f"torque in steps of {torque.step_nm:.3g} N m with a noise of "
                f"{torque.noise_nm:.3g} N m; needed: steps that show the noise"
            )
    return ""


def _of_motion(cause: Cause, part: Motion, points: int, torque: TorqueChannel) -> str:
    """Return why ripple alone cannot show a fault of angle, velocity or clock."""
    alone = "motor angle and velocity are one channel here"
    if "order" in {parameter.name for parameter in cause.shape}:
        return f"{alone}; needed: an angle beside the velocity"
    angle = 2.0 * part.angle_rad
    ripple = _look(np.column_stack((np.cos(angle), np.sin(angle))), part, points, torque)
    if ripple.changes and ripple.inside >= PASSED:
        return ""
    return f"{alone}; the torque shows no ripple whose phase would jump"
