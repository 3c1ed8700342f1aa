"""Jumps judged: a slip of the encoder, or samples lost behind even stamps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.acquisition.channels import shaft_of
from hdbench.diagnosis.acquisition.faults import Fault, lost_fault, restored, slip_fault
from hdbench.diagnosis.acquisition.measure import Residual, likelier_nats
from hdbench.diagnosis.acquisition.named import normal_tail
from hdbench.diagnosis.acquisition.phase import PhaseJump
from hdbench.diagnosis.acquisition.slips import Jump, find_jumps
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import Trace

__all__ = ["judge_jumps", "longest_fit"]

# names within this many nats are not told apart: a Bayes factor of 20
_RIVAL_NATS = 3.0
# a jump this many standard deviations from a whole number of samples is none of lost samples
_WHOLE_SIGMA = 4.0
# jumps that are judged one by one at most
_MOST = 8
# times the loss at the faster side's speed that a loss may last, and samples that it may have
_LONGEST = 4.0
_MOST_LOST = 5000
# half motor turns that may hide in a loss
_TURNS = 8


@dataclass(frozen=True, slots=True)
class _Lost:
    """Samples that a jump can stand for, how well their number is known, whether they fit it."""

    samples: int
    std: float
    near: bool


def judge_jumps(
    trace: Trace, profile: ProfileData, residual_of: Callable[[Trace], Residual]
) -> list[Fault]:
    """Return every jump between encoder and tacho as a slip or as lost samples.

    Parameters
    ----------
    trace : Trace
        Channels.
    profile : ProfileData
        Bench.
    residual_of : callable
        Gives the baseline's residual of a trace.

    Returns
    -------
    list of Fault
        A jump by a whole number of samples' turning can be both. With lost samples the encoder is
        right and the torque keeps its phase to it; with a slip it does not. Where the torque does
        not tell either by three nats, both names stand.
    """
    shaft = shaft_of(trace, profile)
    if shaft is None:
        return []
    jumps = find_jumps(shaft)
    count = len(trace)
    period = float(np.median(np.diff(trace.time_s)))
    faults = [slip_fault(jump, count, profile) for jump in jumps]
    largest = sorted(range(len(jumps)), key=lambda k: -abs(jumps[k].angle_rad))[:_MOST]
    for k in largest:
        lost = _lost_samples(jumps[k], period, shaft.count_rad)
        if lost is None:
            continue
        other = lost_fault(jumps[k].first, lost.samples, trace, faults[k].tail, lost.std)
        trial = [*faults[:k], other, *faults[k + 1 :]]
        slip, missed = (residual_of(restored(trace, some)) for some in (faults, trial))
        better = likelier_nats(missed, slip)
        if better > _RIVAL_NATS:
            faults[k] = other
        elif lost.near and better > -_RIVAL_NATS:
            faults[k] = _both(other, faults[k])
    return faults


def longest_fit(
    trace: Trace, jumps: list[PhaseJump], residual_of: Callable[[Trace], Residual]
) -> list[Fault]:
    """Return jumps of the ripple's phase as lost samples, each by the number that fits best.

    Parameters
    ----------
    trace : Trace
        Channels.
    jumps : list of PhaseJump
        Jumps, each with the smallest number that fits the ripple.
    residual_of : callable
        Gives the baseline's residual of a trace.

    Returns
    -------
    list of Fault
        What turns once per output turn tells apart the numbers that the ripple cannot.
    """
    count = len(trace)

    def fault(jump: PhaseJump, turns: int) -> Fault:
        tail = normal_tail(float(np.sqrt(jump.gain)), count, 2, count)
        samples = jump.samples + round(turns * jump.turn_samples)
        return lost_fault(jump.first, samples, trace, tail)

    faults = [fault(jump, 0) for jump in jumps]
    faults.reverse()
    for k, jump in enumerate(reversed(jumps)):
        trials = [fault(jump, turns) for turns in range(_TURNS if len(jumps) <= _MOST else 1)]
        residuals = [
            residual_of(restored(trace, [*faults[:k], one, *faults[k + 1 :]])) for one in trials
        ]
        best = int(np.argmin([residual.mean_square for residual in residuals]))
        if likelier_nats(residuals[best], residuals[0]) > _RIVAL_NATS:
            faults[k] = trials[best]
    return faults


def _lost_samples(jump: Jump, period_s: float, count_rad: float) -> _Lost | None:
    """Return how many lost samples turn by a jump; None where the shaft went the other way.

    In between the speed follows the cubic that has speed and acceleration of both sides.
    """
    (speed, slope), (later, later_slope) = jump.before, jump.after
    fastest = max(abs(speed), abs(later))
    if not fastest > 0.0:
        return None
    most = int(_LONGEST * abs(jump.angle_rad) / (fastest * period_s)) + 1
    time = period_s * np.arange(1, min(most, _MOST_LOST) + 1)
    turned = 0.5 * (speed + later) * time + (slope - later_slope) * time**2 / 12.0
    away = np.abs(jump.angle_rad - turned)
    best = int(np.argmin(away))
    if not turned[best] * jump.angle_rad > 0.0:
        return None
    # the course of the speed in between is not known: half of the bend's share
    bend = 0.5 * abs((slope - later_slope) * time[best] ** 2 / 12.0)
    near = away[best] < _WHOLE_SIGMA * jump.std_rad + 0.5 * count_rad + bend
    std = (bend + away[best]) / max(abs(0.5 * (speed + later)) * period_s, 1e-12)
    return _Lost(best + 1, float(min(std, best + 1)), bool(near))


def _both(lost: Fault, slip: Fault) -> Fault:
    parameters = {**lost.parameters, "slip_rad": slip.parameters["slip_rad"]}
    return Fault(lost.name, parameters, lost.tail, lost.apply, lost.span, lost.shape, (slip.name,))
