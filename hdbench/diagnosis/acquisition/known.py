"""Faults of the acquisition that the model at hand already holds."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.acquisition.channels import (
    later_from,
    scaled_velocity,
    shaft_of,
    turned_back,
)
from hdbench.model import BenchModel, Cause, CauseTerm, cause_named
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import Trace

__all__ = ["known_taken_out", "of_the_torque"]


def of_the_torque(cause: Cause) -> bool:
    """Return whether a cause is a torque that a fit can hold.

    Parameters
    ----------
    cause : Cause
        A cause.

    Returns
    -------
    bool
        False for causes of noise, angle and clock.
    """
    return cause.additive and cause.change_motion is None


def known_taken_out(trace: Trace, profile: ProfileData, model: BenchModel) -> Trace:
    """Return the trace without the faults of angle, tacho and clock that the model holds.

    Parameters
    ----------
    trace : Trace
        Channels.
    profile : ProfileData
        Bench.
    model : BenchModel
        Model.

    Returns
    -------
    Trace
        The others of its causes of the acquisition leave the channels as they are.
    """
    for term in model.causes:
        cause = cause_named(term.name, where="model", extra=model.extra_causes)
        if cause.change_motion is not None:
            trace = _taken_out(trace, profile, term)
    return trace


def _taken_out(trace: Trace, profile: ProfileData, term: CauseTerm) -> Trace:
    shape = term.shape
    if term.name == "tacho-ripple":
        shaft = shaft_of(trace, profile)
        if shaft is None:
            return trace
        angle = shape["order"] * np.where(np.isfinite(shaft.angle_rad), shaft.angle_rad, 0.0)
        factor = 1.0 + shape["cosine"] * np.cos(angle) + shape["sine"] * np.sin(angle)
        return scaled_velocity(trace, 1.0 / factor)
    if term.name not in ("encoder-slip", "missed-samples"):
        return trace
    first = int(np.searchsorted(trace.time_s, shape["step_time_s"]))
    if term.name == "encoder-slip":
        return turned_back(trace, profile, first, shape["slip_rad"])
    return later_from(trace, first, shape["missed_s"])
