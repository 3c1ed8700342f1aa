"""One cause with its shape as it stands in a fit: columns, slopes, bounds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from hdbench.diagnosis.discovery.record import Record
from hdbench.model import Cause, shape_bounds
from hdbench.records.trace import FloatArray

# relative change of a shape, or of its domain, by which a slope is formed
_SLOPE = 1e-4
# the noise of an acceleration that is counted is far from normal: nearer than this many of its
# standard deviations an expected torque is noise
ABOVE_NOISE = 10.0
# a domain wider than this ratio is even in its logarithm
WIDE = 10.0
# a shape parameter may move by this share of its value in one step
_STRIDE = 0.3


@dataclass(frozen=True, slots=True)
class Term:
    """A cause with its shape.

    Parameters
    ----------
    cause : Cause
        Cause of the catalogue, or a table without a name.
    shape : mapping of str to float
        Shape parameters.
    known : bool
        True where the model that was handed in already held it.
    """

    cause: Cause
    shape: Mapping[str, float]
    known: bool = False

    @property
    def name(self) -> str:
        """Name of the cause."""
        return self.cause.name


def term_columns(term: Term, record: Record) -> FloatArray:
    """Return the columns of a term, N m per unit of each linear parameter; 0 where not known."""
    # a table is made for one record: its name does not say all
    key = (term.name, term.cause.columns, *term.shape.items())
    return record.remembered(key, lambda: _columns(term, record))


def _columns(term: Term, record: Record) -> FloatArray:
    motion = record.motion
    columns = term.cause.columns(motion, term.shape)
    seen = np.isfinite(columns)
    if term.cause.locked_to == "acceleration":
        floor = ABOVE_NOISE * motion.acceleration_noise_rad_s2
        seen &= (np.abs(motion.acceleration_rad_s2) > floor)[:, None]
    columns = columns if seen.all() else np.where(seen, columns, 0.0)
    return record.known_part(columns) if follows_motion(term.cause) else columns


def harmonics(cause: Cause) -> list[list[int]]:
    """Return the columns of each harmonic; empty for a cause that has none by name."""
    found: dict[str, list[int]] = {}
    for place, parameter in enumerate(cause.linear):
        pieces = parameter.name.split("_")
        number = pieces[1] if len(pieces) > 1 else ""
        if pieces[0] not in ("cosine", "sine") or not number.replace(".", "").isdigit():
            return []
        found.setdefault(number, []).append(place)
    return list(found.values())


def is_line(cause: Cause) -> bool:
    """Return whether a cause is one line, or harmonics of one, at a free order or frequency."""
    return [p.name for p in cause.shape] in (["order"], ["frequency_hz"], ["output_order"])


def follows_motion(cause: Cause) -> bool:
    """Return whether a cause follows speed, acceleration, load or the current that moves them."""
    return cause.locked_to in ("velocity", "acceleration", "load", "current")


def same_torque(one: Cause, other: Cause) -> bool:
    """Return whether two causes have one name, or are two forms of one torque."""
    return (one.form_of or one.name) == (other.form_of or other.name)


def is_other_torque(cause: Cause, held: Iterable[Cause]) -> bool:
    """Return whether a cause is no form of the torque of any of some others."""
    return not any(same_torque(cause, other) for other in held)


def is_whole_share(cause: Cause) -> bool:
    """Return whether the one linear parameter is 1 where the cause is what it says."""
    return bool(cause.shape) and [p.name for p in cause.linear] == ["share"]


def smooth_shapes(term: Term) -> tuple[str, ...]:
    """Return the shape parameters that have a slope: a step in time has none."""
    return tuple(p.name for p in term.cause.shape if p.name != "step_time_s")


def free_shapes(term: Term) -> tuple[str, ...]:
    """Return the shape parameters that a search moves along their slopes.

    Lobes, poles and teeth repeat a whole number of times in a turn: such an order stays.
    """
    whole = is_line(term.cause) and term.shape.get("order", 0.5) % 1.0 == 0.0
    return () if whole else smooth_shapes(term)


def tangent_columns(term: Term, linear: FloatArray, record: Record) -> FloatArray:
    """Return the slope of a term's torque over each smooth shape, N m per unit, (n, n_smooth)."""
    torque = term_columns(term, record) @ linear
    slopes = []
    bounds = shape_bounds(term.cause, record.motion)
    for name in smooth_shapes(term):
        value = term.shape[name]
        width = sum(high - low for low, high in bounds.get(name, ()))
        step = _SLOPE * (abs(value) if abs(value) > 0.0 else min(width, 1.0))
        if name in ("order", "frequency_hz", "output_order"):
            step = _SLOPE * resolution(name, term, record)
        ahead = replace(term, shape={**term.shape, name: value + step})
        slopes.append((term_columns(ahead, record) @ linear - torque) / step)
    return np.column_stack(slopes) if slopes else np.zeros((len(torque), 0))


def resolution(name: str, term: Term, record: Record) -> float:
    """Return one over the turns or seconds of the record: the width of a line on its axis."""
    motion = record.motion
    if name == "frequency_hz":
        return 1.0 / max(record.span_s, 1e-9)
    on_output = term.cause.locked_to == "output" or name == "output_order"
    angle = motion.output_angle_rad if on_output else motion.angle_rad
    return 2.0 * np.pi / max(float(np.ptp(angle[record.valid])), 1e-9)


def at_shape(term: Term, name: str, value: float, record: Record) -> Term | None:
    """Return the term with one shape at a value; None outside of its domain."""
    bands = shape_bounds(term.cause, record.motion).get(name, ())
    inside = any(low <= value <= high for low, high in bands)
    return replace(term, shape={**term.shape, name: value}) if inside else None


def moved_term(term: Term, moves: Mapping[str, float], record: Record) -> Term:
    """Return the term with its shape moved, cut to its bands and to a stride."""
    bounds = shape_bounds(term.cause, record.motion)
    shape = dict(term.shape)
    for name, move in moves.items():
        value = shape[name]
        if name in ("order", "frequency_hz", "output_order"):
            limit = 0.5 * resolution(name, term, record)
        else:
            width = sum(high - low for low, high in bounds.get(name, ()))
            limit = _STRIDE * abs(value) if abs(value) > 0.0 else 0.1 * width
        target = value + float(np.clip(move, -limit, limit))
        bands = bounds.get(name) or ((value, value),)
        inside = [float(np.clip(target, low, high)) for low, high in bands]
        shape[name] = min(inside, key=lambda x: abs(x - target))
    return replace(term, shape=shape)
