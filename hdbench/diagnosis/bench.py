"""Bench out of a log: keys of the profile that its data tell, and what such a bench supports."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from hdbench.diagnosis.answer.testable import TorqueChannel, testable
from hdbench.diagnosis.inspection import inspect_log
from hdbench.diagnosis.inspection.log import Log
from hdbench.diagnosis.inspection.result import ChannelFacts, Inspection
from hdbench.errors import DataError
from hdbench.model import catalogue, motion_from_trace
from hdbench.profile import Profile, load_profile, new_profile, parse_profile
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace

# ratios of strain wave gears that are sold; outside of them the drive is another
_HARMONIC = (30.0, 320.0)
# volts of the reference and of the bridge at the greatest speed and torque, of 10 that there are
_FULL_V = 8.0


@dataclass(frozen=True, slots=True)
class Known:
    """What no log tells of a bench."""

    gear_ratio: float  # motor turns per output turn, at least 1
    load_inertia_kg_m2: float  # about the output
    rated_torque_nm: float | None = None  # the greatest torque of the log where None
    orders: tuple[float, ...] = ()  # per motor turn; those of the kind of drive where empty


@dataclass(frozen=True, slots=True)
class Support:
    """Whether an experiment or a cause can be evaluated on such a log, and why not."""

    name: str
    supported: bool
    because: str = ""


@dataclass(frozen=True, slots=True)
class BenchOfLog:
    """A new profile and where it comes from."""

    text: str  # TOML
    filled: dict[str, tuple[Any, str]]  # keys that are not those of the report's bench, and why
    experiments: tuple[Support, ...]  # what the log supports
    causes: tuple[Support, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON holds it."""
        filled = [
            {"key": key, "value": value, "because": why}
            for key, (value, why) in self.filled.items()
        ]
        return {**asdict(self), "filled": filled}


def bench_of_trace(trace: Trace, name: str, known: Known) -> BenchOfLog:
    """Make the profile of a bench by one of its traces."""
    start = load_profile("cim-tr-97-06").data
    log = Log.of_trace(trace)
    seen = inspect_log(log, start)
    filled = dict(_filled(log, seen, start, known))
    text = new_profile(name, filled)
    profile = parse_profile(text, f"profile {name}")
    experiments, causes = _supported(trace, seen, profile)
    return BenchOfLog(text, filled, experiments, causes)


def _up(value: float) -> float:
    """Return a value rounded up to three digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return float(f"{math.ceil(value / unit - 1e-9) * unit:.3g}")


def _reached(values: FloatArray | None) -> float:
    """Return the size that a channel reaches; 0 where there is none."""
    known = np.array([]) if values is None else np.abs(values[np.isfinite(values)])
    # what a limit is read from: a spike in a thousand samples does not set it
    return float(np.quantile(known, 0.999)) if len(known) else 0.0


def _filled(
    log: Log, seen: Inspection, start: ProfileData, known: Known
) -> Iterator[tuple[str, tuple[Any, str]]]:
    """Return keys with their values and where these come from."""
    yield "drive.gear_ratio", (known.gear_ratio, "given")
    yield "drive.load_inertia_kg_m2", (known.load_inertia_kg_m2, "given")
    facts = {one.name: one for one in seen.channels}
    velocity_v = start.tacho.gain_rad_s_per_v
    speed = max(
        _reached(log.role("motor_velocity_rad_s")), _reached(log.role("tacho_v")) * velocity_v
    )
    gain = start.sensor.gain_nm_per_v
    torque = max(_reached(log.role("torque_nm")), _reached(log.role("torque_v")) * gain)
    for what, size in (("motion", speed), ("torque", torque)):
        if not size > 0.0:
            raise DataError(
                f"the trace holds no {what}; needed: a run in which the drive works",
                where=log.source,
                fix="name another trace, or leave --from out",
            )
    speed, torque = _up(speed), _up(torque)
    yield "limits.velocity_rad_s", (speed, "greatest speed of the log; nothing beyond was tried")
    yield "limits.torque_nm", (torque, "greatest torque of the log; nothing beyond was tried")
    rated = known.rated_torque_nm
    yield "drive.rated_torque_nm", (rated or torque, "given" if rated else "greatest of the log")
    current = _reached(log.role("motor_current_a"))
    if current > 0.0:
        yield "limits.current_a", (_up(current), "greatest current of the log")
        yield "servo.max_current_a", (_up(current), "greatest current of the log")
    if (seen.sampling.span_s or 0.0) > start.limits.duration_s:
        yield "limits.duration_s", (_up(seen.sampling.span_s or 0.0), "length of the log")
    if seen.sampling.median_s:
        yield "daq.sample_period_s", (float(f"{seen.sampling.median_s:.6g}"), "median of the log")
    yield from _of_channels(facts, log, start)
    # plans and ranges that fit into the limits
    if "torque_v" not in log.roles:
        gain = torque / _FULL_V
        yield "sensor.gain_nm_per_v", (gain, f"no volts in the log: {_FULL_V:g} V at the limit")
    if "tacho_v" not in log.roles:
        velocity_v = speed / _FULL_V
        yield "tacho.gain_rad_s_per_v", (velocity_v, f"no volts: {_FULL_V:g} V at the limit")
    yield "servo.velocity_gain_rad_s_per_v", (speed / _FULL_V, f"{_FULL_V:g} V at the limit")
    slow = min(start.misalignment.velocity_rad_s, 0.5 * speed)
    yield "misalignment.velocity_rad_s", (slow, "at most half of the greatest speed")
    most = torque / (start.arm.gravity_m_s2 * start.arm.length_m)
    for key in ("full_masses_kg", "low_masses_kg"):
        masses = getattr(start.calibration, key)
        scale = min(1.0, most / max(start.calibration.full_masses_kg))
        scaled = tuple(math.floor(mass * scale * 1e4) / 1e4 for mass in masses)
        yield f"calibration.{key}", (scaled, "at most the greatest torque of the log")
    yield "model.ripple", ((), "not known before a fit")
    yield "model.misalignment.amplitude_nm", (0.0, "not known before a fit")
    harmonic = _HARMONIC[0] <= known.gear_ratio <= _HARMONIC[1]
    if known.orders:
        yield "model.baseline_orders", (known.orders, "given")
    elif not harmonic:
        yield (
            "model.baseline_orders",
            ((1.0,), "no strain wave gear has this ratio: once per turn only"),
        )


def _of_channels(
    facts: dict[str, ChannelFacts], log: Log, start: ProfileData
) -> Iterator[tuple[str, tuple[Any, str]]]:
    """Return noise and steps of the channels."""
    for role, key, scale in (
        ("torque_nm", "sensor.noise_nm", 1.0),
        ("torque_v", "sensor.noise_nm", start.sensor.gain_nm_per_v),
        ("tacho_v", "tacho.noise_v", 1.0),
    ):
        one = facts.get(log.roles.get(role, ""))
        # the floor of a filtered channel is none of the sensor
        if one is not None and one.noise is not None and not _limited(one):
            yield key, (float(f"{one.noise * scale:.3g}"), "floor of the spectrum of the log")
    angle = facts.get(log.roles.get("motor_angle_rad", ""))
    if angle is not None and angle.resolution and angle.resolution < np.pi:
        counts = round(2.0 * np.pi / angle.resolution)
        yield "encoder.counts_per_turn", (counts, "step of the angle of the log")


def _limited(one: ChannelFacts) -> bool:
    """Return whether a channel ends below half of its rate."""
    return (one.bandwidth_hz or math.inf) < 0.49 * (one.rate_hz or 0.0)


def _supported(
    trace: Trace, seen: Inspection, profile: Profile
) -> tuple[tuple[Support, ...], tuple[Support, ...]]:
    """Return which experiments and causes can be evaluated on such a log."""
    motion = motion_from_trace(trace, profile.data)
    angle = motion.output_angle_rad[motion.valid]
    turns = float(np.ptp(angle)) / (2.0 * np.pi) if len(angle) else 0.0
    short = "" if turns >= 1.0 else f"{turns:.3g} output turns; needed: at least 1"
    experiments = (
        Support("diagnose", True),
        Support("filter", True),
        Support("run-ripple", True),
        Support("run-misalignment", not short, short),
        Support("calibrate", False, "weights on an arm; a dynamic log holds none"),
    )
    torque = next(one for one in seen.channels if one.name in ("torque_nm", "torque_v"))
    gain = profile.data.sensor.gain_nm_per_v if torque.name == "torque_v" else 1.0
    derived = tuple((c.name, c.derived_from) for c in seen.channels if c.derived_from)
    channel = TorqueChannel(
        (torque.bandwidth_hz or 0.0) if _limited(torque) else math.inf,
        seen.sampling.rate_hz or 0.0,
        (torque.resolution or 0.0) * gain,
        (torque.noise or 0.0) * gain,
        torque.held_share,
    )
    told = testable(catalogue().values(), motion, channel, derived)
    return experiments, tuple(Support(t.name, t.testable, t.because) for t in told)
