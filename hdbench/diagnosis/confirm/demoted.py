"""A cause that a left-out condition speaks against: it loses its name and keeps its place."""

from __future__ import annotations

from hdbench.diagnosis.answer.result import NamedCause, Unexplained

__all__ = ["spoken_against"]

# a loss of less than this share of what the other conditions of that axis gain is a matter of the
# form that the cause has there, not of its name
_OUTWEIGHED = 0.25
# axis of a condition and domain of the residual
_DOMAINS = {"velocity": "velocity", "direction": "velocity", "torque": "torque"}


def spoken_against(cause: NamedCause) -> Unexplained | None:
    """Return what a cause is told as where a condition speaks against it.

    Parameters
    ----------
    cause : NamedCause
        Cause, with what it gains in left-out conditions.

    Returns
    -------
    Unexplained or None
        The condition in which the prediction is worst; None where none speaks against it, or
        the others outweigh that one.
    """
    worst = min(cause.left_out, key=lambda one: one.gain_nats, default=None)
    if worst is None or not worst.against:
        return None
    alike = [one for one in cause.left_out if one.condition.axis == worst.condition.axis]
    gained = sum(max(one.gain_nats, 0.0) for one in alike)
    if -worst.gain_nats < _OUTWEIGHED * gained:
        return None
    place = worst.condition
    size = cause.gain.heldout_rms_before_nm**2 - cause.gain.heldout_rms_after_nm**2
    return Unexplained(
        _DOMAINS[place.axis],
        0.5 * (place.low + place.high),
        (place.low, place.high),
        "rad/s" if place.unit == "1" else place.unit,
        max(size, 0.0) ** 0.5,
        cause.share_of_variance,
        cause.false_alarm_probability,
    )
