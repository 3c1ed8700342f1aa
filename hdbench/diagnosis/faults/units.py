"""Units of the channels: wrong units, signs and places, and which channel can be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from hdbench.diagnosis.answer.records import DataFlag
from hdbench.diagnosis.faults.shaft import (
    ANGLES,
    VELOCITIES,
    Shaft,
    scaled,
    shaft_of,
    velocity_of,
)
from hdbench.model import baseline_orders, integrate_velocity
from hdbench.model.kinematics import velocity_slope
from hdbench.model.motion import torque_from_trace
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace

__all__ = ["Channels", "check_channels"]

# beyond this many times the bench's limit a channel is in another unit
_BEYOND = 3.0
# a converter does not read beyond its range by more than its own gain error
_RANGE = 1.05
# motor turns between two samples beyond which no order of the motor is in the record: a time in ms
# makes them a thousand times what they were
_MOST_TURNS = 2.0
# share of the samples that a limit is held against, so that spikes do not count
_MOST = 0.99
# encoder and tacho that differ by more than this are not in the same unit; gains of tachos are
# good to a percent
_SCALE = 0.05
# a named factor is met within this part
_NAMED = 0.03
# a factor nearer to 1 than this, and none of the named, is a gain that is off, not a unit
_GAIN = 0.3
# blocks over which increments are summed before they are compared: noise and counting average out
_BLOCK_S = 0.1
# correlation of the increments below which they cannot be of one shaft; two channels of one shaft
# with a tenth of noise have .99
_SAME = 0.5
# the motor has to turn this far for its channels to be compared, rad
_TURNED = 6.0
# of the expected torque's coefficient: +1 and -1 are then ten standard deviations apart
_SIGN_STD = 0.2
# share of the torque's fast variance that ripple explains on the right angle, and on a wrong one
_RIGHT, _WRONG = 0.3, 0.03
# samples of the running mean that takes slow torque out: some periods of ripple at walking pace
_SLOW = 301
# rad/s: what turns slower makes no ripple that is fast against the running mean
_TURNING = 10.0

# factor of angle over velocity, what it says of the angle, what it says of the velocity
_UNITS = (
    (-1.0, "counts backwards", "has the other sign"),
    (180.0 / np.pi, "looks like degrees", "looks like turns per radian of the angle"),
    (0.5 / np.pi, "looks like turns", "looks like rad/s times 2 pi"),
    (np.pi / 30.0, "looks like min per rad/s", "looks like rpm"),
    (np.pi / 180.0, "looks too small by 57.3", "looks like deg/s"),
    (2.0 * np.pi, "looks too large by 2 pi", "looks like turns per second"),
    (2.0, "counts twice what the profile says", "reads half the speed"),
    (0.5, "counts half of what the profile says", "reads twice the speed"),
    (4.0, "counts four times what the profile says", "reads a quarter of the speed"),
    (0.25, "counts a quarter of what the profile says", "reads four times the speed"),
)


@dataclass(frozen=True, slots=True)
class Channels:
    """What the channels of a trace can be used for.

    Parameters
    ----------
    trace : Trace
        Channels that can be trusted.
    flags : tuple of DataFlag
        What is wrong with the others.
    reason : str
        Why nothing can be said, with the margin; empty where something can.
    """

    trace: Trace
    flags: tuple[DataFlag, ...] = ()
    reason: str = ""


def check_channels(trace: Trace, profile: ProfileData) -> Channels:
    """Return what the channels can be used for, by their units and by each other.

    Parameters
    ----------
    trace : Trace
        Channels.
    profile : ProfileData
        Limits, converter and gains of the bench.

    Returns
    -------
    Channels
        Where angle and velocity differ by a factor, the one that the torque agrees with is kept.
        `reason` is set where the torque does not tell which of them is wrong, a channel is beyond
        anything that the bench can reach, or torque and velocity are swapped.
    """
    reason = _swapped(trace, profile) or _too_coarse(trace, profile) or _beyond(trace, profile)
    if reason:
        return _told(trace, "wrong-channel", reason, refuse=True)
    shaft = shaft_of(trace, profile)
    checked = _velocity_unit(trace, profile) if shaft is None else _compared(trace, profile, shaft)
    fastest = profile.limits.velocity_rad_s * _BEYOND
    reason = _too_large(checked.trace, "motor_velocity_rad_s", fastest, "rad/s", "rpm or deg/s")
    if reason and not checked.reason:
        return _told(trace, "wrong-channel", reason, refuse=True)
    return checked


def _told(trace: Trace, name: str, detail: str, *, refuse: bool = False) -> Channels:
    """Return the trace with one flag over all of it."""
    time = trace.time_s
    flag = DataFlag(name, float(time[0]), float(time[-1]), len(time), detail)
    return Channels(trace, (flag,), detail if refuse else "")


def _velocity_times(trace: Trace, factor: float, why: str) -> Channels:
    return _told(scaled(trace, VELOCITIES, factor), "velocity-scale", why)


def _beyond(trace: Trace, profile: ProfileData) -> str:
    """Return which channel is beyond anything that the bench can reach, or nothing."""
    ends = (
        ("torque_nm", profile.limits.torque_nm * _BEYOND, "N m", "mN m, N mm or mV"),
        ("torque_v", profile.daq.range_v * _RANGE, "V", "mV"),
        ("tacho_v", profile.daq.range_v * _RANGE, "V", "mV"),
    )
    return next((text for end in ends if (text := _too_large(trace, *end))), "")


def _usual(values: FloatArray) -> float:
    """Return the size that one present value in a hundred exceeds; 0 of none."""
    known = np.abs(values[np.isfinite(values)])
    return float(np.quantile(known, _MOST)) if len(known) else 0.0


def _too_large(trace: Trace, name: str, end: float, unit: str, guess: str) -> str:
    reached = _usual(trace[name]) if name in trace else 0.0
    if not reached > end:
        return ""
    return (
        f"{name} reaches {reached:.4g} {unit}, {reached / end:.3g} times the {end:.4g} {unit} that "
        f"this bench has at most: is it in {guess}, or another channel?"
    )


def _too_coarse(trace: Trace, profile: ProfileData) -> str:
    """Return why the time cannot be in seconds, or nothing."""
    velocity, steps_s = velocity_of(trace, profile), np.diff(trace.time_s)
    turns = 0.0 if velocity is None else _usual(velocity[:-1] * steps_s) / (2.0 * np.pi)
    if not turns > _MOST_TURNS:
        return ""
    return (
        f"the motor turns {turns:.3g} times between two samples, which are "
        f"{float(np.median(steps_s)):.3g} s apart; more than {_MOST_TURNS:g} show no order: is "
        "time_s in ms, or the velocity in rpm?"
    )


def _fast(values: FloatArray) -> FloatArray:
    """Return values less their running mean, twice: load, gravity and misalignment are slow.

    The ends, where the mean is one-sided, are left out.
    """
    for _ in range(2):
        values = values - uniform_filter1d(values, min(_SLOW, len(values)))
    return values[_SLOW:-_SLOW]


def _waves(angle: FloatArray, profile: ProfileData) -> list[FloatArray]:
    orders = baseline_orders(profile)
    return [_fast(wave(order * angle)) for order in orders for wave in (np.cos, np.sin)]


def _explained(torque: FloatArray, angle: FloatArray, profile: ProfileData) -> float:
    """Return the share of the fast torque's variance that ripple over this angle explains."""
    good = np.isfinite(torque) & np.isfinite(angle)
    if int(good.sum()) < 4 * _SLOW:
        return 0.0
    design, response = np.column_stack(_waves(angle[good], profile)), _fast(torque[good])
    power = float(response @ response)
    solution = np.linalg.lstsq(design.T @ design, design.T @ response, rcond=None)[0]
    left = response - design @ solution
    return 1.0 - float(left @ left) / power if power > 0.0 else 0.0


def _swapped(trace: Trace, profile: ProfileData) -> str:
    """Return that the ripple is in the velocity, over the integral of the torque, or nothing."""
    velocity = velocity_of(trace, profile)
    if velocity is None:
        return ""
    torque = torque_from_trace(trace, profile)
    fast, slow = torque, velocity
    if "tacho_v" in trace and "torque_v" in trace:
        fast = trace["torque_v"] * profile.tacho.gain_rad_s_per_v
        slow = trace["tacho_v"] * profile.sensor.gain_nm_per_v
    known = np.abs(fast[np.isfinite(fast)])
    if not (len(known) and float(np.median(known)) > _TURNING):
        return ""
    crossed = _explained(slow, integrate_velocity(trace.time_s, fast)[0], profile)
    if not crossed > _RIGHT:
        return ""
    straight = _explained(torque, integrate_velocity(trace.time_s, velocity)[0], profile)
    if not straight < _WRONG:
        return ""
    return (
        "torque and velocity stand in each other's place: ripple explains "
        f"{100.0 * crossed:.0f} % of the velocity and {100.0 * straight:.0f} % of the torque"
    )


def _velocity_unit(trace: Trace, profile: ProfileData) -> Channels:
    """Return what to do where the ripple says that the velocity is in another unit."""
    velocity = velocity_of(trace, profile)
    if velocity is None:
        return Channels(trace)
    torque = torque_from_trace(trace, profile)
    angle = integrate_velocity(trace.time_s, velocity)[0]
    if _explained(torque, angle, profile) < _WRONG:
        for factor, _, says in _UNITS[1:]:
            if _explained(torque, factor * angle, profile) > _RIGHT:
                why = f"the ripple fits the velocity times {factor:.4g}, which it is multiplied by"
                return _velocity_times(trace, factor, f"{why}: the velocity {says}")
    return Channels(trace)


def _compared(trace: Trace, profile: ProfileData, shaft: Shaft) -> Channels:
    """Return what angle and velocity say of each other."""
    parts = [np.where(shaft.good, p, 0.0) for p in (shaft.moves_rad, shaft.by_velocity_rad())]
    turned = max(float(np.abs(part).sum()) for part in parts)
    if int(shaft.good.sum()) < 100 or turned < _TURNED:
        return Channels(trace)
    block = np.floor((shaft.time_s[:-1] - shaft.time_s[0]) / _BLOCK_S).astype(np.int64)
    encoder, tacho = (np.bincount(block, part) for part in parts)
    # one slip of some turns must not count for the scale of all: the median of large blocks
    moving = np.abs(tacho) > max(0.1 * _usual(np.asarray(tacho, dtype=float)), 1e-300)
    ratio = float(np.median(encoder[moving] / tacho[moving])) if moving.any() else 1.0
    sizes = float(np.linalg.norm(encoder) * np.linalg.norm(tacho))
    alike = abs(float(encoder @ tacho)) / sizes if sizes > 0.0 else 0.0
    close = np.abs(encoder - ratio * tacho) <= 0.1 * np.abs(ratio * tacho)
    if max(alike, float(np.mean(close[moving]))) < _SAME:
        reason = (
            "angle and velocity are not of the same shaft: their increments have a correlation of "
            f"{alike:.2f}; needed: {_SAME:g}"
        )
        return _told(trace, "wrong-channel", reason, refuse=True)
    return _unlike(trace, profile, shaft, ratio) if abs(ratio - 1.0) > _SCALE else Channels(trace)


def _unlike(trace: Trace, profile: ProfileData, shaft: Shaft, ratio: float) -> Channels:
    """Return what to do where angle and velocity differ by a factor: the torque decides.

    By its ripple, or, where only the sign differs, by the expected torque, which is that of the
    velocity that has the right sign.
    """
    named = min(_UNITS, key=lambda unit: abs(ratio / unit[0] - 1.0))
    known = abs(ratio / named[0] - 1.0) < _NAMED
    text = f"{shaft.names[0]} turns {ratio:.4g} times as far as the integrated velocity"
    if known and named[0] == -1.0:
        sign, std = _drive_sign(trace, profile, shaft)
        sure = abs(abs(sign) - 1.0) < 0.5 and std < _SIGN_STD
        angle_right, velocity_right = sure and sign < 0.0, sure and sign > 0.0
        seen = f"expected torque times {sign:.2f} +- {std:.2g}; needed: 1 or -1 to {_SIGN_STD:g}"
    else:
        torque = torque_from_trace(trace, profile)
        tacho = integrate_velocity(trace.time_s, shaft.velocity_rad_s)[0]
        by_angle, by_tacho = (_explained(torque, a, profile) for a in (shaft.angle_rad, tacho))
        velocity_right = by_tacho > _RIGHT and by_angle < 0.5 * by_tacho
        angle_right = by_angle > _RIGHT and by_tacho < 0.5 * by_angle
        seen = (
            f"ripple explains {100.0 * by_angle:.0f} % over the angle, {100.0 * by_tacho:.0f} % "
            f"over the velocity; needed: {100.0 * _RIGHT:.0f} % over one of them"
        )
    if velocity_right:
        kept = {name: v for name, v in trace.columns.items() if name not in ANGLES}
        says = f"{named[1]}, and is left out" if known else "is left out"
        why = f"{text}; the torque agrees with the velocity: {shaft.names[0]} {says}"
        return _told(Trace(kept, trace.source, trace.metadata), "encoder-scale", why)
    if angle_right:
        says = f"{named[2]}, and is multiplied by {ratio:.4g}" if known else "is scaled to it"
        why = f"{text}; the torque agrees with the angle: the velocity {says}"
        return _velocity_times(trace, ratio, why)
    if not known and abs(ratio - 1.0) < _GAIN:
        why = f"{text}: an encoder counts, a tacho has a gain; the velocity is scaled to the angle"
        return _velocity_times(trace, ratio, why)
    guess = f"{shaft.names[0]} {named[1]}, or the velocity {named[2]}; " if known else ""
    reason = f"{text}: {guess}the torque does not tell which of them is right ({seen})"
    return _told(trace, "encoder-scale", reason, refuse=True)


def _drive_sign(trace: Trace, profile: ProfileData, shaft: Shaft) -> tuple[float, float]:
    """Return the coefficient of the velocity's expected torque and its standard uncertainty."""
    inertia = profile.drive.load_inertia_kg_m2 / profile.drive.gear_ratio
    expected = inertia * velocity_slope(shaft.time_s, shaft.velocity_rad_s)
    torque = torque_from_trace(trace, profile)
    good = np.isfinite(torque) & np.isfinite(expected) & np.isfinite(shaft.angle_rad)
    if int(good.sum()) < 4 * _SLOW:
        return 0.0, float(np.inf)
    waves = _waves(shaft.angle_rad[good], profile)
    design, response = np.column_stack([_fast(expected[good]), *waves]), _fast(torque[good])
    inverse = np.linalg.pinv(design.T @ design)
    solution = inverse @ (design.T @ response)
    left = response - design @ solution
    freedom = max(1, len(response) - design.shape[1])
    std = float(np.sqrt(max(0.0, float(inverse[0, 0])) * float(left @ left) / freedom))
    return float(solution[0]), std if std > 0.0 else float(np.inf)
