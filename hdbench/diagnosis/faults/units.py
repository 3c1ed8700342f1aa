"""Units of the channels: wrong units, signs and places, and which channel can be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from hdbench.diagnosis.faults.shaft import (
    ANGLES,
    VELOCITIES,
    Shaft,
    angle_of,
    scaled,
    shaft_of,
    velocity_of,
)
from hdbench.diagnosis.measured.preflight import DataFlag
from hdbench.errors import DataError
from hdbench.model import baseline_orders, integrate_velocity
from hdbench.model.kinematics import velocity_slope
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace

__all__ = ["Channels", "check_channels", "torque_of"]

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
    """What the channels can be used for.

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


def torque_of(trace: Trace, profile: ProfileData) -> FloatArray:
    """Return the torque, N m, measured or from the converter's volts."""
    if "torque_nm" in trace:
        return trace["torque_nm"]
    if "torque_v" in trace:
        return np.asarray(trace["torque_v"] * profile.sensor.gain_nm_per_v)
    raise DataError(
        f"no torque among the columns {', '.join(trace.columns)}; needed: torque_nm in N m, or "
        "torque_v in V",
        where=f"{trace.source}: header",
        fix="add the column, or name it with `hdbench import --map torque_nm=COLUMN`",
    )


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
        Where angle and velocity differ by a factor, the one that the ripple agrees with is kept.
        `reason` is set where the torque does not tell which of them is wrong, a channel is beyond
        anything that the bench can reach, or torque and velocity are swapped.
    """
    if _swapped(trace, profile):
        return _refused(
            trace, "torque and velocity stand in each other's place: the ripple is in the velocity"
        )
    reason = _too_coarse(trace, profile) or _beyond(trace, profile)
    if reason:
        return _refused(trace, reason)
    checked = _compared(trace, profile)
    fastest = profile.limits.velocity_rad_s * _BEYOND
    reason = _too_large(checked.trace, "motor_velocity_rad_s", fastest, "rad/s", "rpm or deg/s")
    return _refused(trace, reason) if reason and not checked.reason else checked


def _whole(trace: Trace, name: str, detail: str) -> DataFlag:
    time = trace.time_s
    return DataFlag(name, float(time[0]), float(time[-1]), len(time), detail)


def _refused(trace: Trace, reason: str) -> Channels:
    return Channels(trace, (_whole(trace, "wrong-channel", reason),), reason)


def _without_angle(trace: Trace, why: str) -> Channels:
    kept = {name: v for name, v in trace.columns.items() if name not in ANGLES}
    flag = _whole(trace, "encoder-scale", why)
    return Channels(Trace(kept, trace.source, trace.metadata), (flag,))


def _velocity_times(trace: Trace, factor: float, why: str) -> Channels:
    flag = _whole(trace, "velocity-scale", why)
    return Channels(scaled(trace, VELOCITIES, factor), (flag,))


def _beyond(trace: Trace, profile: ProfileData) -> str:
    """Return which channel is beyond anything that the bench can reach, or nothing."""
    ends = (
        ("torque_nm", profile.limits.torque_nm * _BEYOND, "N m", "mN m, N mm or mV"),
        ("torque_v", profile.daq.range_v * _RANGE, "V", "mV"),
        ("tacho_v", profile.daq.range_v * _RANGE, "V", "mV"),
    )
    return next((text for end in ends if (text := _too_large(trace, *end))), "")


def _too_large(trace: Trace, name: str, end: float, unit: str, guess: str) -> str:
    if name not in trace:
        return ""
    known = np.abs(trace[name][np.isfinite(trace[name])])
    reached = float(np.quantile(known, _MOST)) if len(known) else 0.0
    if not reached > end:
        return ""
    return (
        f"{name} reaches {reached:.4g} {unit}, {reached / end:.3g} times the {end:.4g} {unit} that "
        f"this bench has at most: is it in {guess}, or another channel?"
    )


def _too_coarse(trace: Trace, profile: ProfileData) -> str:
    """Return why the time cannot be in seconds, or nothing."""
    velocity = velocity_of(trace, profile)
    if velocity is None:
        return ""
    steps_s = np.diff(trace.time_s)
    turns = np.abs(velocity[:-1] * steps_s) / (2.0 * np.pi)
    turns = turns[np.isfinite(turns)]
    most = float(np.quantile(turns, _MOST)) if len(turns) else 0.0
    if not most > _MOST_TURNS:
        return ""
    return (
        f"the motor turns {most:.3g} times between two samples, which are "
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


def _explained(torque: FloatArray, angle: FloatArray, orders: tuple[float, ...]) -> float:
    """Return the share of the fast torque's variance that ripple over this angle explains."""
    good = np.isfinite(torque) & np.isfinite(angle)
    if int(good.sum()) < 4 * _SLOW:
        return 0.0
    waves = [wave(order * angle[good]) for order in orders for wave in (np.cos, np.sin)]
    design, response = np.column_stack([_fast(wave) for wave in waves]), _fast(torque[good])
    power = float(response @ response)
    solution = np.linalg.lstsq(design.T @ design, design.T @ response, rcond=None)[0]
    left = response - design @ solution
    return 1.0 - float(left @ left) / power if power > 0.0 else 0.0


def _swapped(trace: Trace, profile: ProfileData) -> bool:
    """Return whether the ripple is in the velocity, over the integral of the torque, alone."""
    velocity = velocity_of(trace, profile)
    if velocity is None:
        return False
    torque, orders = torque_of(trace, profile), baseline_orders(profile)
    if "tacho_v" in trace and "torque_v" in trace:
        fast = trace["torque_v"] * profile.tacho.gain_rad_s_per_v
        slow = trace["tacho_v"] * profile.sensor.gain_nm_per_v
    else:
        fast, slow = torque, velocity
    known = np.abs(fast[np.isfinite(fast)])
    if not (len(known) and float(np.median(known)) > _TURNING):
        return False
    other = integrate_velocity(trace.time_s, fast)[0]
    if not _explained(slow, other, orders) > _RIGHT:
        return False
    angle = integrate_velocity(trace.time_s, velocity)[0]
    return _explained(torque, angle, orders) < _WRONG


def _compared(trace: Trace, profile: ProfileData) -> Channels:
    """Return what angle and velocity, or ripple and velocity, say of each other."""
    shaft = shaft_of(trace, profile)
    if shaft is None:
        return _velocity_unit(trace, profile)
    good = shaft.good
    parts = [np.where(good, part, 0.0) for part in (shaft.moves_rad, shaft.by_velocity_rad())]
    turned = max(float(np.abs(part).sum()) for part in parts)
    if int(good.sum()) < 100 or turned < _TURNED:
        return Channels(trace)
    block = np.floor((shaft.time_s[:-1] - shaft.time_s[0]) / _BLOCK_S).astype(np.int64)
    encoder, tacho = (np.bincount(block, part) for part in parts)
    # one slip of some turns must not count for the scale of all: the median of large blocks
    moving = np.abs(tacho) > 0.1 * float(np.quantile(np.abs(tacho), _MOST))
    moving &= tacho != 0.0
    ratio = float(np.median(encoder[moving] / tacho[moving])) if moving.any() else 1.0
    sizes = float(np.linalg.norm(encoder) * np.linalg.norm(tacho))
    alike = abs(float(encoder @ tacho)) / sizes if sizes > 0.0 else 0.0
    close = np.abs(encoder - ratio * tacho) <= 0.1 * np.abs(ratio * tacho)
    if alike < _SAME and not float(np.mean(close[moving])) > _SAME:
        return _refused(
            trace,
            "angle and velocity are not of the same shaft: their increments have a correlation of "
            f"{alike:.2f}; needed: {_SAME:g}",
        )
    if abs(ratio - 1.0) > _SCALE:
        return _unlike(trace, profile, shaft, ratio)
    return Channels(trace)


def _velocity_unit(trace: Trace, profile: ProfileData) -> Channels:
    """Return what to do where the ripple says that the velocity is in another unit."""
    velocity = velocity_of(trace, profile)
    if velocity is None:
        return Channels(trace)
    torque, orders = torque_of(trace, profile), baseline_orders(profile)
    angle = integrate_velocity(trace.time_s, velocity)[0]
    if _explained(torque, angle, orders) < _WRONG:
        for factor, _, says in _UNITS[1:]:
            if _explained(torque, factor * angle, orders) > _RIGHT:
                why = f"the ripple fits the velocity times {factor:.4g}, which it is multiplied by"
                return _velocity_times(trace, factor, f"{why}: the velocity {says}")
    return Channels(trace)


def _unlike(trace: Trace, profile: ProfileData, shaft: Shaft, ratio: float) -> Channels:
    """Return what to do where encoder and tacho differ by a factor."""
    if abs(ratio + 1.0) < _NAMED:
        return _signed(trace, profile, shaft)
    torque, orders = torque_of(trace, profile), baseline_orders(profile)
    by_tacho = integrate_velocity(trace.time_s, shaft.velocity_rad_s)[0]
    with_encoder = _explained(torque, shaft.angle_rad, orders)
    with_tacho = _explained(torque, by_tacho, orders)
    named = min(_UNITS, key=lambda unit: abs(ratio / unit[0] - 1.0))
    known = abs(ratio / named[0] - 1.0) < _NAMED
    name = shaft.names[0]
    text = f"{name} turns {ratio:.4g} times as far as the integrated velocity"
    if with_tacho > _RIGHT and with_encoder < 0.5 * with_tacho:
        says = f"{named[1]}, and is left out" if known else "is left out"
        return _without_angle(trace, f"{text}; the ripple agrees with the velocity: {name} {says}")
    if with_encoder > _RIGHT and with_tacho < 0.5 * with_encoder:
        says = f"{named[2]}, and is multiplied by {ratio:.4g}" if known else "is scaled to it"
        why = f"{text}; the ripple agrees with the angle: the velocity {says}"
        return _velocity_times(trace, ratio, why)
    if not known and abs(ratio - 1.0) < _GAIN:
        why = f"{text}: an encoder counts, a tacho has a gain; the velocity is scaled to the angle"
        return _velocity_times(trace, ratio, why)
    guess = f"{name} {named[1]}, or the velocity {named[2]}; " if known else ""
    reason = (
        f"{text}: {guess}the torque does not tell which of them is right (ripple explains "
        f"{100.0 * with_encoder:.0f} % over the angle, {100.0 * with_tacho:.0f} % over the "
        f"velocity; needed: {100.0 * _RIGHT:.0f} % over one of them)"
    )
    return Channels(trace, (_whole(trace, "encoder-scale", reason),), reason)


def _signed(trace: Trace, profile: ProfileData, shaft: Shaft) -> Channels:
    """Return what to do where angle and velocity have opposite signs.

    The expected torque is that of the velocity that has the right sign.
    """
    text = "angle and velocity turn in opposite directions"
    sign, std = _drive_sign(trace, profile, shaft)
    if not (abs(abs(sign) - 1.0) < 0.5 and std < _SIGN_STD):
        reason = (
            f"{text}: the torque does not tell which of them is right (expected torque times "
            f"{sign:.2f} +- {std:.2g}; needed: 1 or -1 to within {_SIGN_STD:g})"
        )
        return Channels(trace, (_whole(trace, "encoder-scale", reason),), reason)
    if sign > 0.0:
        why = f"{text}; the expected torque agrees with the velocity: the angle is left out"
        return _without_angle(trace, why)
    why = f"{text}; the expected torque agrees with the angle: the velocity's sign is changed"
    return _velocity_times(trace, -1.0, why)


def _drive_sign(trace: Trace, profile: ProfileData, shaft: Shaft) -> tuple[float, float]:
    """Return the coefficient of the velocity's expected torque and its standard uncertainty."""
    drive = profile.drive
    slope = velocity_slope(shaft.time_s, shaft.velocity_rad_s)
    expected = drive.load_inertia_kg_m2 / drive.gear_ratio * slope
    torque, angle = torque_of(trace, profile), angle_of(trace, profile)
    if angle is None:
        return 0.0, np.inf
    good = np.isfinite(torque) & np.isfinite(expected) & np.isfinite(angle)
    if int(good.sum()) < 4 * _SLOW:
        return 0.0, np.inf
    orders = baseline_orders(profile)
    waves = [wave(order * angle[good]) for order in orders for wave in (np.cos, np.sin)]
    design = np.column_stack([_fast(expected[good]), *(_fast(wave) for wave in waves)])
    response = _fast(torque[good])
    inverse = np.linalg.pinv(design.T @ design)
    solution = inverse @ (design.T @ response)
    left = response - design @ solution
    freedom = max(1, len(response) - design.shape[1])
    std = float(np.sqrt(max(0.0, float(inverse[0, 0])) * float(left @ left) / freedom))
    return float(solution[0]), std if std > 0.0 else float(np.inf)
