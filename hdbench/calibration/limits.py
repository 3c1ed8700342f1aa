"""What is tested against the limits of the profile."""

from __future__ import annotations

from hdbench.calibration.acceptance import LimitTest
from hdbench.calibration.budget import expanded_uncertainty
from hdbench.calibration.gains import PairedDifference
from hdbench.calibration.metrology import Metrology
from hdbench.calibration.metrologydict import overall_class
from hdbench.calibration.stepwise.classes import CLASSES
from hdbench.profile.calibrating import AcceptanceLimits

__all__ = ["limit_tests"]

# stands for a class that is worse than the worst: the next of the series
_WORSE = 2.0 * CLASSES[-1]


def limit_tests(
    found: Metrology,
    gain_nm_per_v: float,
    consistency: LimitTest,
    limits: AcceptanceLimits | None,
) -> list[LimitTest]:
    """Return every value that has a limit."""
    if limits is None:
        return [consistency]
    expanded = found.mean.expanded / abs(gain_nm_per_v)
    loops = found.loops.values()
    zeros = [
        abs(loop.zero_return_nm) / loop.largest_torque_nm
        for loop in loops
        if loop.zero_return_nm is not None
    ]
    rows = (
        ("expanded-uncertainty", expanded, limits.max_expanded_uncertainty),
        ("class", _grade(found), limits.max_class),
        ("zero-return", max(zeros, default=None), limits.max_zero_return),
        ("hysteresis", max((x.relative for x in loops), default=None), limits.max_hysteresis),
        (
            "lack-of-fit",
            max((x.relative for x in found.lack if x is not None), default=None),
            limits.max_lack_of_fit,
        ),
    )
    tests = [LimitTest(name, value, limit) for name, value, limit in rows if limit is not None]
    return [consistency, *tests, *_asymmetry(found.direction, limits.max_direction_asymmetry)]


def _grade(found: Metrology) -> float | None:
    grade = overall_class(found)
    if grade.value is None and any(c.allowed is None for c in grade.criteria):
        return _WORSE
    return grade.value


def _asymmetry(direction: PairedDifference | None, limit: float | None) -> list[LimitTest]:
    if limit is None:
        return []
    if direction is None:
        return [LimitTest("direction-asymmetry", None, limit)]
    value = abs(direction.relative)
    mean = abs(direction.mean_first + direction.mean_second) / 2.0
    own = expanded_uncertainty(direction.difference.std / mean, direction.difference.dof)
    return [LimitTest("direction-asymmetry", value, limit, value + own.expanded)]
