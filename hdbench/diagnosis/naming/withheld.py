"""The line that is significant, and may be no more than what the form of a strong cause leaves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hdbench.diagnosis.detect.exact import exact_statistic
from hdbench.diagnosis.detect.looks import Look
from hdbench.diagnosis.fit.terms import term_columns
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.naming.left import Left
from hdbench.diagnosis.noise.whitened import Space

__all__ = ["withheld_line"]

_UNITS = {"motor-order": "1", "output-order": "1", "frequency": "Hz"}
# a line that the last names took half of is another's
_STILL = 0.5


def withheld_line(space: Space, record: Record, looks: Sequence[Look]) -> tuple[Left, ...]:
    """Return the place of the strongest of the lines that were not named.

    Parameters
    ----------
    space : Space
        Final residual.
    record : Record
        Record.
    looks : sequence of Look
        Looks that pass the false-alarm rate and were held back beside a strong cause.

    Returns
    -------
    tuple of Left
        One place, with the width that the record resolves; empty where no line was held back. It is
        no cause: what the form of the strong one leaves has a place too.
    """
    lines = [look for look in looks if look.name in _UNITS]
    if not lines:
        return ()
    look = max(lines, key=lambda one: one.statistic)
    term = look.terms[0]
    columns = term_columns(term, record)
    statistic, dof, linear = exact_statistic(space, columns)
    if dof < columns.shape[1] or statistic < _STILL * look.statistic or len(term.shape) != 1:
        return ()
    (place,) = term.shape.values()
    half = 0.5 / _span(record, look.name)
    effect = (columns @ linear)[record.valid]
    return (
        Left(
            look.name,
            _UNITS[look.name],
            place,
            (place - half, place + half),
            float(np.hypot(*linear)),
            look.false_alarm,
            float(effect.var()),
        ),
    )


def _span(record: Record, domain: str) -> float:
    """Return how far a record reaches on the axis of a line: turns, or seconds."""
    motion = record.motion
    if domain == "frequency":
        return float(np.ptp(motion.time_s[record.valid]))
    angle = motion.angle_rad if domain == "motor-order" else motion.output_angle_rad
    return float(np.ptp(angle[record.valid])) / (2.0 * np.pi)
