"""What a bench can reach: a channel beyond it is in another unit, or another channel."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.acquisition.channels import velocity_of
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import Trace

__all__ = ["BEYOND", "beyond", "too_coarse", "too_large"]

# beyond this many times the bench's limit a channel is in another unit
BEYOND = 3.0
# a converter does not read beyond its range by more than its own gain error
_RANGE = 1.05
# motor turns between two samples beyond which no order of the motor is in the record: a time in ms
# makes them a thousand times what they were
_MOST_TURNS = 2.0
# share of the samples that a limit is held against, so that spikes do not count
_MOST = 0.99


def beyond(trace: Trace, profile: ProfileData) -> str:
    """Return which channel is beyond anything that the bench can reach.

    Parameters
    ----------
    trace : Trace
        Channels.
    profile : ProfileData
        Limits of the bench and range of its converter.

    Returns
    -------
    str
        One reason in words, or an empty text.
    """
    ends = (
        ("torque_nm", profile.limits.torque_nm * BEYOND, "N m", "mN m, N mm or mV"),
        ("torque_v", profile.daq.range_v * _RANGE, "V", "mV"),
        ("tacho_v", profile.daq.range_v * _RANGE, "V", "mV"),
    )
    return next((text for end in ends if (text := too_large(trace, *end))), "")


def too_coarse(trace: Trace, profile: ProfileData) -> str:
    """Return why the time cannot be in seconds.

    Parameters
    ----------
    trace : Trace
        Channels.
    profile : ProfileData
        Tacho of the bench.

    Returns
    -------
    str
        One reason in words, or an empty text.
    """
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
        f"{float(np.median(steps_s)):.3g} s apart: is time_s in ms, or the velocity in rpm?"
    )


def too_large(trace: Trace, name: str, end: float, unit: str, guess: str) -> str:
    """Return why a channel is beyond its end.

    Parameters
    ----------
    trace : Trace
        Channels.
    name : str
        The channel.
    end : float
        What the bench can reach, in `unit`.
    unit, guess : str
        Unit of the channel, and units that it may be in instead.

    Returns
    -------
    str
        One reason in words, or an empty text.
    """
    if name not in trace:
        return ""
    known = np.abs(trace[name][np.isfinite(trace[name])])
    reached = float(np.quantile(known, _MOST)) if len(known) else 0.0
    if not reached > end:
        return ""
    return (
        f"{name} reaches {reached:.4g} {unit}; this bench has {end:.4g} {unit} at most: "
        f"is it in {guess}, or another channel?"
    )
