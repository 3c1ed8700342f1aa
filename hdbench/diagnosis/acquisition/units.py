"""Channels in another unit, with another sign, or in each other's place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.acquisition.channels import (
    ANGLE_COLUMNS,
    Shaft,
    scaled_velocity,
    shaft_of,
    velocity_of,
    without_angle,
)
from hdbench.diagnosis.acquisition.flags import DataFlag
from hdbench.diagnosis.acquisition.reach import BEYOND, beyond, too_coarse, too_large
from hdbench.diagnosis.acquisition.ripplecheck import (
    RIGHT,
    WRONG,
    drive_sign,
    explained,
    swapped,
)
from hdbench.diagnosis.measured.record import torque_from_trace
from hdbench.model import baseline_orders, integrate_velocity
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import Trace

__all__ = ["Channels", "check_channels"]

# encoder and tacho that differ by more than this are not in the same unit; gains of tachos are
# good to a percent
_SCALE = 0.05
# a named factor is met within this part
_NAMED = 0.03
# blocks over which increments are summed before they are compared: noise and counting average out
_BLOCK_S = 0.1
# correlation of the two increments below which they are not the same shaft
_SAME = 0.9
# the motor has to turn this far for its channels to be compared, rad
_TURNED = 6.0

# of the expected torque's coefficient: +1 and -1 are then ten standard deviations apart
_SIGN_STD = 0.2

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
        Why no baseline can be fitted; empty where one can.
    """

    trace: Trace
    flags: tuple[DataFlag, ...] = ()
    reason: str = ""


def _whole(trace: Trace, name: str, detail: str) -> DataFlag:
    time = trace.time_s
    return DataFlag(name, float(time[0]), float(time[-1]), len(time), detail)


def _velocity_unit(trace: Trace, profile: ProfileData) -> Channels:
    """Return what to do where the ripple says that the velocity is in another unit."""
    velocity = velocity_of(trace, profile)
    if velocity is None:
        return Channels(trace)
    torque, orders = torque_from_trace(trace, profile), baseline_orders(profile)
    angle = integrate_velocity(trace.time_s, velocity)[0]
    if not explained(torque, angle, orders) < WRONG:
        return Channels(trace)
    for factor, _, says in _UNITS[1:]:
        if explained(torque, factor * angle, orders) > RIGHT:
            why = f"the ripple fits the velocity times {factor:.4g}, which it is multiplied by: "
            flag = _whole(trace, "velocity-scale", f"{why}the velocity {says}")
            return Channels(scaled_velocity(trace, factor), (flag,))
    return Channels(trace)


def _ratio(shaft: Shaft) -> tuple[float, float]:
    """Return angle over integrated velocity, and their correlation over blocks of 0.1 s."""
    block = np.floor((shaft.time_s[:-1] - shaft.time_s[0]) / _BLOCK_S).astype(np.int64)
    count = int(block[-1]) + 1
    sums = [
        np.bincount(block, np.where(shaft.good, part, 0.0), count)
        for part in (shaft.by_encoder_rad, shaft.by_tacho_rad)
    ]
    # one slip of some turns must not count for the scale of all: the median of large blocks
    encoder, tacho = sums
    power = float(tacho @ tacho)
    if not power > 0.0:
        return 1.0, 1.0
    moving = np.abs(tacho) > 0.1 * float(np.abs(tacho).max())
    ratio = float(np.median(encoder[moving] / tacho[moving]))
    close = np.abs(encoder - ratio * tacho) <= 0.1 * np.abs(ratio * tacho)
    return ratio, float(np.mean(close[moving]))


def _unlike(trace: Trace, profile: ProfileData, shaft: Shaft) -> Channels:
    """Return what to do where encoder and tacho differ by a factor."""
    ratio, _ = _ratio(shaft)
    torque, orders = torque_from_trace(trace, profile), baseline_orders(profile)
    by_tacho = integrate_velocity(trace.time_s, shaft.velocity_rad_s)[0]
    with_encoder = explained(torque, shaft.angle_rad, orders)
    with_tacho = explained(torque, by_tacho, orders)
    if abs(ratio + 1.0) < _NAMED:
        return _signed(trace, profile, shaft)
    named = min(_UNITS, key=lambda unit: abs(ratio / unit[0] - 1.0))
    known = abs(ratio / named[0] - 1.0) < _NAMED
    angle_name = next(name for name in ANGLE_COLUMNS if name in trace)
    text = f"{angle_name} turns {ratio:.4g} times as far as the integrated velocity"
    if with_tacho > RIGHT and with_encoder < 0.5 * with_tacho:
        why = f"{text}; the ripple agrees with the velocity: {angle_name} "
        why += f"{named[1]}, and is left out" if known else "is left out"
        return Channels(without_angle(trace), (_whole(trace, "encoder-scale", why),))
    if with_encoder > RIGHT and with_tacho < 0.5 * with_encoder:
        why = f"{text}; the ripple agrees with the angle: the velocity "
        why += f"{named[2]}, and is multiplied by {ratio:.4g}" if known else "is scaled to it"
        return Channels(scaled_velocity(trace, ratio), (_whole(trace, "velocity-scale", why),))
    guess = f"{angle_name} {named[1]}, or the velocity {named[2]}; " if known else ""
    reason = f"{text}: {guess}the torque does not tell which of them is right"
    return Channels(trace, (_whole(trace, "encoder-scale", reason),), reason)


def _signed(trace: Trace, profile: ProfileData, shaft: Shaft) -> Channels:
    """Return what to do where angle and velocity have opposite signs.

    The expected torque is that of the velocity that has the right sign.
    """
    text = "angle and velocity turn in opposite directions"
    sign, std = drive_sign(trace, profile, shaft)
    if not (abs(abs(sign) - 1.0) < 0.5 and std < _SIGN_STD):
        reason = f"{text}: the torque does not tell which of them is right"
        return Channels(trace, (_whole(trace, "encoder-scale", reason),), reason)
    if sign > 0.0:
        why = f"{text}; the expected torque agrees with the velocity: the angle is left out"
        return Channels(without_angle(trace), (_whole(trace, "encoder-scale", why),))
    why = f"{text}; the expected torque agrees with the angle: the velocity's sign is changed"
    return Channels(scaled_velocity(trace, -1.0), (_whole(trace, "velocity-scale", why),))


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
        Where angle and velocity differ by a factor, the one that the ripple agrees with is kept;
        where the torque does not tell, or a channel is beyond anything the bench can reach, or
        torque and velocity are swapped, `reason` says so and no baseline should be fitted.
    """
    if swapped(trace, profile):
        return _refused(
            trace, "torque and velocity stand in each other's place: the ripple is in the velocity"
        )
    reason = too_coarse(trace, profile) or beyond(trace, profile)
    if reason:
        return _refused(trace, reason)
    checked = _compared(trace, profile)
    fastest = profile.limits.velocity_rad_s * BEYOND
    reason = too_large(checked.trace, "motor_velocity_rad_s", fastest, "rad/s", "rpm or deg/s")
    return _refused(trace, reason) if reason and not checked.reason else checked


def _refused(trace: Trace, reason: str) -> Channels:
    return Channels(trace, (_whole(trace, "wrong-channel", reason),), reason)


def _compared(trace: Trace, profile: ProfileData) -> Channels:
    """Return what angle and velocity, or ripple and velocity, say of each other."""
    shaft = shaft_of(trace, profile)
    if shaft is None:
        return _velocity_unit(trace, profile)
    parts = (shaft.by_encoder_rad, shaft.by_tacho_rad)
    turned = max(float(np.abs(part[shaft.good]).sum()) for part in parts)
    if int(shaft.good.sum()) < 100 or turned < _TURNED:
        return Channels(trace)
    ratio, same = _ratio(shaft)
    if same < _SAME:
        return _refused(
            trace,
            "angle and velocity are not of the same shaft: their increments agree in "
            f"{100.0 * same:.0f} % of the record; needed: {100.0 * _SAME:.0f} %",
        )
    if abs(ratio - 1.0) > _SCALE:
        return _unlike(trace, profile, shaft)
    return Channels(trace)
