"""A fault of angle, tacho or clock that can be taken out of a trace."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.acquisition.channels import (
    VELOCITY_COLUMNS,
    later_from,
    scaled_velocity,
    shaft_of,
    turned_back,
)
from hdbench.diagnosis.acquisition.named import Tail, entry, normal_tail
from hdbench.diagnosis.acquisition.slips import Jump
from hdbench.diagnosis.acquisition.tacho import TachoRipple, find_tacho_ripple, tacho_factor
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace

__all__ = ["Fault", "lost_fault", "restored", "slip_fault", "tacho_faults"]


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault of angle, tacho or clock that can be taken out.

    Parameters
    ----------
    name : str
        Name of the contract.
    parameters : dict
        As of a named cause.
    tail : Tail
        Evidence.
    apply : callable
        ``apply(trace)`` gives the trace without it.
    span : tuple of (int, int)
        First and last sample that it touches.
    shape : dict of str to float
        Its shape parameters in the catalogue's terms.
    group : tuple of str
        Other names that these data cannot tell from it.
    """

    name: str
    parameters: dict[str, dict[str, float | str | None]]
    tail: Tail
    apply: Callable[[Trace], Trace]
    span: tuple[int, int]
    shape: dict[str, float]
    group: tuple[str, ...] = ()


def restored(trace: Trace, faults: list[Fault]) -> Trace:
    """Return the trace without faults.

    Parameters
    ----------
    trace : Trace
        Channels.
    faults : list of Fault
        Faults.

    Returns
    -------
    Trace
    """
    for fault in faults:
        trace = fault.apply(trace)
    return trace


def slip_fault(jump: Jump, count: int, profile: ProfileData) -> Fault:
    """Return a jump as a slip of the encoder.

    Parameters
    ----------
    jump : Jump
        Jump.
    count : int
        Samples of the record.
    profile : ProfileData
        Encoder counts.

    Returns
    -------
    Fault
    """

    def apply(trace: Trace) -> Trace:
        return turned_back(trace, profile, jump.first, jump.angle_rad)

    return Fault(
        "encoder-slip",
        {
            "slip_rad": entry(jump.angle_rad, jump.std_rad, "rad"),
            "step_time_s": entry(jump.time_s, None, "s"),
        },
        normal_tail(jump.angle_rad / jump.std_rad, count, 2, count),
        apply,
        (jump.first, count - 1),
        {"slip_rad": jump.angle_rad, "step_time_s": jump.time_s},
    )


def lost_fault(
    first: int, samples: int, trace: Trace, tail: Tail, std: float | None = None
) -> Fault:
    """Return samples that the stamps hide.

    Parameters
    ----------
    first : int
        First sample after the loss.
    samples : int
        How many.
    trace : Trace
        Channels.
    tail : Tail
        Evidence.
    std : float or None
        Standard uncertainty of the number; None where it is not known.

    Returns
    -------
    Fault
    """
    time = trace.time_s
    delay = samples * float(np.median(np.diff(time)))

    def apply(one: Trace) -> Trace:
        return later_from(one, first, delay)

    place = 0.5 * float(time[first - 1] + time[first])
    return Fault(
        "missed-samples",
        {
            "samples": entry(samples, std, "1"),
            "step_time_s": entry(place, None, "s"),
            "missed_s": entry(delay, None if std is None else std * delay / samples, "s"),
        },
        tail,
        apply,
        (first - 1, first),
        {"missed_s": delay, "step_time_s": place},
    )


def tacho_faults(trace: Trace, profile: ProfileData) -> list[Fault]:
    """Return the tacho's ripple, one fault for each line.

    Parameters
    ----------
    trace : Trace
        Channels, jumps taken out.
    profile : ProfileData
        Bench.

    Returns
    -------
    list of Fault
    """
    shaft = shaft_of(trace, profile)
    if shaft is None or not any(name in trace for name in VELOCITY_COLUMNS):
        return []
    return [_tacho_fault(line, shaft.angle_rad) for line in find_tacho_ripple(shaft)]


def _tacho_fault(line: TachoRipple, angle_rad: FloatArray) -> Fault:
    known = np.where(np.isfinite(angle_rad), angle_rad, 0.0)

    def apply(trace: Trace) -> Trace:
        return scaled_velocity(trace, 1.0 / tacho_factor(known, (line,)))

    count = len(angle_rad)
    # an exponential power of that many times its mean is 2^-ratio likely
    nats = min(line.power_ratio, (line.amplitude / line.std) ** 2) * float(np.log(2.0))
    tail = Tail(nats - float(np.log(count)), float(min(1.0, 128.0 * np.exp(-nats))))
    cosine = line.amplitude * float(np.cos(line.phase_rad))
    sine = -line.amplitude * float(np.sin(line.phase_rad))
    return Fault(
        "tacho-ripple",
        {
            "order": entry(line.order, None, "1"),
            "relative_amplitude": entry(line.amplitude, line.std, "1"),
            "phase_rad": entry(line.phase_rad, line.phase_std_rad, "rad"),
        },
        tail,
        apply,
        (0, count - 1),
        {"order": line.order, "cosine": cosine, "sine": sine},
    )
