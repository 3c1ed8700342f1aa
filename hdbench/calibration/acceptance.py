"""Acceptance of a calibration: limits of the profile, and the rule by which they decide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from hdbench.calibration.budget import expanded_uncertainty
from hdbench.calibration.stepwise.classes import CLASSES, overall_class
from hdbench.profile.calibrating import AcceptanceLimits
from hdbench.results.calibration import Acceptance, LimitTest, LoadGroup, Loop, PairedDifference

# stands for a class that is worse than the worst: the next of the series
_WORSE = 2.0 * CLASSES[-1]
_RULES = {
    "simple": "simple acceptance: a value is accepted when it is at most its limit, whatever its "
    "uncertainty",
    "guarded": "guarded acceptance: the upper end of the 95 % interval of a value has to be at "
    "most its limit, where the value has an interval",
}


def decide(tests: Sequence[LimitTest], rule: str) -> tuple[bool | None, Acceptance]:
    """Decide by all tests: None where none is broken and one could not be tested."""
    told = tuple(replace(test, passed=_passed(test, rule)) for test in tests)
    held = [test.passed for test in told]
    accepted = False if False in held else None if None in held else True
    return accepted, Acceptance(decision_rule=rule, statement=_RULES[rule], tests=told)


def _passed(test: LimitTest, rule: str) -> bool | None:
    if test.value is None:
        return None
    tested = test.upper if rule == "guarded" and test.upper is not None else test.value
    return bool(tested <= test.limit)


def limit_tests(
    expanded: float,
    groups: Sequence[LoadGroup],
    loops: Sequence[Loop],
    direction: PairedDifference | None,
    limits: AcceptanceLimits,
) -> list[LimitTest]:
    """Return every value that has a limit beside the consistency."""
    zeros = [abs(x.zero_return_relative) for x in loops if x.zero_return_relative is not None]
    bends = [x.lack_of_fit.relative for x in groups if x.lack_of_fit is not None]
    rows = (
        ("expanded-uncertainty", expanded, limits.max_expanded_uncertainty),
        ("class", _grade(groups), limits.max_class),
        ("zero-return", max(zeros, default=None), limits.max_zero_return),
        ("hysteresis", max((x.relative for x in loops), default=None), limits.max_hysteresis),
        ("lack-of-fit", max(bends, default=None), limits.max_lack_of_fit),
    )
    tests = [LimitTest(name=n, value=v, limit=limit) for n, v, limit in rows if limit is not None]
    return [*tests, *_asymmetry(direction, limits.max_direction_asymmetry)]


def _grade(groups: Sequence[LoadGroup]) -> float | None:
    grade = overall_class(groups)
    if grade.value is None and any(c.allowed is None for c in grade.criteria):
        return _WORSE
    return grade.value


def _asymmetry(direction: PairedDifference | None, limit: float | None) -> list[LimitTest]:
    name = "direction-asymmetry"
    if limit is None:
        return []
    if direction is None:
        return [LimitTest(name=name, value=None, limit=limit)]
    value, relative = abs(direction.relative.value), direction.relative
    upper = value + expanded_uncertainty(relative.std, relative.dof).expanded
    return [LimitTest(name=name, value=value, limit=limit, upper=upper)]
