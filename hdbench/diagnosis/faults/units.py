"""Units of the channels: wrong units, signs and places, and which channel can be trusted."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.faults.fault import Inspected
from hdbench.diagnosis.faults.scatter import fast_part
from hdbench.diagnosis.faults.shaft import ANGLES, VELOCITIES, Shaft, scaled, shaft_of, velocity_of
from hdbench.model import baseline_orders, integrate_velocity
from hdbench.model.motion import torque_from_trace, velocity_slope
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace
from hdbench.results.diagnosis import StretchFlag

# motor turns between two samples beyond which no order of the motor is in the record: a time in ms
# makes them a thousand times what they were
_MOST_TURNS = 2.0
# correlation of the increments below which they cannot be of one shaft; two channels of one shaft
# with a tenth of noise have .99
_SAME = 0.5
# of the expected torque's coefficient: +1 and -1 are then ten standard deviations apart
_SIGN_STD = 0.2
# share of the torque's fast variance that ripple explains on the right angle, and on a wrong one
_RIGHT, _WRONG = 0.3, 0.03
# samples of the running mean that takes load, gravity and misalignment out: some periods of ripple
# at walking pace
_SLOW = 301

# a gain is no further off: the nearest unit, 2 pi, is
_MOST_GAIN = 5.0

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


def check_channels(trace: Trace, profile: ProfileData) -> Inspected:
    """Return what the channels can be used for, by their units and by each other."""
    reason = _swapped(trace, profile) or _too_coarse(trace, profile)
    if reason:
        return _told(trace, "wrong-channel", reason, refuse=True)
    shaft = shaft_of(trace, profile)
    checked = _velocity_unit(trace, profile) if shaft is None else _compared(trace, profile, shaft)
    reason = "" if checked.reason else _too_large(checked.trace, profile)
    return _told(trace, "wrong-channel", reason, refuse=True) if reason else checked


def expected_nm(trace: Trace, profile: ProfileData, velocity_rad_s: FloatArray) -> FloatArray:
    """Return the torque that a velocity's acceleration takes, N m."""
    inertia = profile.drive.load_inertia_kg_m2 / profile.drive.gear_ratio
    return np.asarray(inertia * velocity_slope(trace.time_s, velocity_rad_s))


def _told(trace: Trace, name: str = "", detail: str = "", *, refuse: bool = False) -> Inspected:
    """Return the trace, with one flag over all of it where something is to be told."""
    time, none = trace.time_s, np.zeros(len(trace), dtype=bool)
    flag = StretchFlag(name, float(time[0]), float(time[-1]), len(time), detail)
    return Inspected(trace, none, flags=(flag,) if name else (), reason=detail if refuse else "")


def _velocity_times(trace: Trace, factor: float, why: str) -> Inspected:
    return _told(scaled(trace, VELOCITIES, factor), "velocity-scale", why)


def _usual(values: FloatArray) -> float:
    """Return the size that one present value in a hundred exceeds; 0 of none."""
    known = np.abs(values[np.isfinite(values)])
    return float(np.quantile(known, 0.99)) if len(known) else 0.0


def _too_large(trace: Trace, profile: ProfileData) -> str:
    """Return which channel is beyond anything that the bench can reach, or nothing."""
    # beyond three times the bench's limit a channel is in another unit; a converter does not read
    # beyond its range by more than its own gain error
    limits, volts = profile.limits, 1.05 * profile.daq.range_v
    for name, end, unit, guess in (
        ("torque_nm", 3.0 * limits.torque_nm, "N m", "mN m, N mm or mV"),
        ("torque_v", volts, "V", "mV"),
        ("tacho_v", volts, "V", "mV"),
        ("motor_velocity_rad_s", 3.0 * limits.velocity_rad_s, "rad/s", "rpm or deg/s"),
    ):
        reached = _usual(trace[name]) if name in trace else 0.0
        if reached > end:
            return (
                f"{name} reaches {reached:.4g} {unit}, {reached / end:.3g} times the {end:.4g} "
                f"{unit} that this bench has at most: is it in {guess}, or another channel?"
            )
    return ""


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


def _regressed(
    torque: FloatArray, angle: FloatArray, profile: ProfileData, *others: FloatArray
) -> tuple[float, float, float]:
    """Return the share of fast torque that ripple and others explain, and the first one's size."""
    good = np.isfinite(sum(others, torque + angle))
    if int(good.sum()) < 4 * _SLOW:
        return 0.0, 0.0, float(np.inf)
    orders = baseline_orders(profile)
    waves = [wave(order * angle) for order in orders for wave in (np.cos, np.sin)]
    columns = [fast_part(column[good], _SLOW) for column in (torque, *others, *waves)]
    # the ends have no running mean
    response, *columns = [column[_SLOW:-_SLOW] for column in columns]
    design = np.column_stack(columns)
    inverse = np.linalg.pinv(design.T @ design)
    solution = inverse @ (design.T @ response)
    left, power = float(np.sum((response - design @ solution) ** 2)), float(response @ response)
    std = float(np.sqrt(abs(inverse[0, 0]) * left / max(1, design.shape[0] - design.shape[1])))
    share = 1.0 - left / power if power > 0.0 else 0.0
    return share, float(solution[0]), std if std > 0.0 else float(np.inf)


def _share_over(
    velocity: FloatArray, torque: FloatArray, trace: Trace, bench: ProfileData
) -> float:
    """Return the share of the fast torque that ripple over an integrated velocity explains."""
    return _regressed(torque, integrate_velocity(trace.time_s, velocity)[0], bench)[0]


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
    # what turns slower than 10 rad/s makes no ripple that is fast against the running mean
    if not float(np.median(np.abs(np.nan_to_num(fast)))) > 10.0:
        return ""
    crossed = _share_over(fast, slow, trace, profile)
    straight = _share_over(velocity, torque, trace, profile)
    if not (crossed > _RIGHT and straight < _WRONG):
        return ""
    return (
        "torque and velocity stand in each other's place: ripple explains "
        f"{100.0 * crossed:.0f} % of the velocity and {100.0 * straight:.0f} % of the torque"
    )


def _velocity_unit(trace: Trace, profile: ProfileData) -> Inspected:
    """Return what to do where the ripple says that the velocity is in another unit."""
    velocity = velocity_of(trace, profile)
    torque = torque_from_trace(trace, profile)
    if velocity is not None and _share_over(velocity, torque, trace, profile) < _WRONG:
        for factor, _, says in _UNITS[1:]:
            if _share_over(factor * velocity, torque, trace, profile) > _RIGHT:
                why = f"the ripple fits the velocity times {factor:.4g}, which it is multiplied by"
                return _velocity_times(trace, factor, f"{why}: the velocity {says}")
    return _told(trace)


def _compared(trace: Trace, profile: ProfileData, shaft: Shaft) -> Inspected:
    """Return what angle and velocity say of each other."""
    turning = (shaft.moves_rad, shaft.pace_rad_s * shaft.steps_s)
    parts = [np.where(shaft.good, part, 0.0) for part in turning]
    # about one motor turn is needed to compare its channels, over blocks of 0.1 s: noise and
    # counting average out
    if max(float(np.abs(part).sum()) for part in parts) < 6.0:
        return _told(trace)
    block = np.floor((shaft.time_s[:-1] - shaft.time_s[0]) / 0.1).astype(np.int64)
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
    # gains of tachos are good to a percent
    return _unlike(trace, profile, shaft, ratio) if abs(ratio - 1.0) > 0.05 else _told(trace)


def _unlike(trace: Trace, profile: ProfileData, shaft: Shaft, ratio: float) -> Inspected:
    """Return what to do where angle and velocity differ by a factor: the torque decides."""
    unit, of_angle, of_velocity = min(_UNITS, key=lambda unit: abs(ratio / unit[0] - 1.0))
    known = abs(ratio / unit - 1.0) < 0.03
    text = f"{shaft.names[0]} turns {ratio:.4g} times as far as the integrated velocity"
    torque, velocity = torque_from_trace(trace, profile), shaft.velocity_rad_s
    # by its ripple or, where only the sign differs, by the expected torque of the right velocity
    if known and unit == -1.0:
        expected = expected_nm(trace, profile, velocity)
        _, sign, std = _regressed(torque, shaft.angle_rad, profile, expected)
        sure = abs(abs(sign) - 1.0) < 0.5 and std < _SIGN_STD
        angle_right, velocity_right = sure and sign < 0.0, sure and sign > 0.0
        seen = f"expected torque times {sign:.2f} +- {std:.2g}; needed: 1 or -1 to {_SIGN_STD:g}"
    else:
        by_angle = _regressed(torque, shaft.angle_rad, profile)[0]
        by_tacho = _share_over(velocity, torque, trace, profile)
        velocity_right = by_tacho > _RIGHT and by_angle < 0.5 * by_tacho
        angle_right = by_angle > _RIGHT and by_tacho < 0.5 * by_angle
        seen = (
            f"ripple explains {100.0 * by_angle:.0f} % over the angle, {100.0 * by_tacho:.0f} % "
            f"over the velocity; needed: {100.0 * _RIGHT:.0f} % over one of them"
        )
    if velocity_right:
        kept = {name: v for name, v in trace.columns.items() if name not in ANGLES}
        says = f"{of_angle}, and is left out" if known else "is left out"
        why = f"{text}; the torque agrees with the velocity: {shaft.names[0]} {says}"
        return _told(Trace(kept, trace.source, trace.metadata), "encoder-scale", why)
    if angle_right:
        says = f"{of_velocity}, and is multiplied by {ratio:.4g}" if known else "is scaled to it"
        why = f"{text}; the torque agrees with the angle: the velocity {says}"
        return _velocity_times(trace, ratio, why)
    guess = f"{shaft.names[0]} {of_angle}, or the velocity {of_velocity}; " if known else ""
    # not a unit but a range or a gain that the logger had wrong: what is dry or follows the
    # direction is still seen
    if 1.0 / _MOST_GAIN < ratio < _MOST_GAIN:
        why = (
            f"{text}: {guess}the torque does not tell which of them is right, and the velocity "
            "is scaled to the angle, which was counted"
        )
        return _velocity_times(trace, ratio, why)
    reason = f"{text}: {guess}the torque does not tell which of them is right ({seen})"
    return _told(trace, "encoder-scale", reason, refuse=True)
