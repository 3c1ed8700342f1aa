"""Is the calibration accepted? Limits of the profile, and the rule by which they decide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["Acceptance", "LimitTest", "decide"]

_RULES = {
    "simple": "simple acceptance: a value is accepted when it is at most its limit, whatever its "
    "uncertainty",
    "guarded": "guarded acceptance: the upper end of the 95 % interval of a value has to be at "
    "most its limit, where the value has an interval",
}


@dataclass(frozen=True, slots=True)
class LimitTest:
    """One value against its limit.

    Parameters
    ----------
    name : str
        What is tested.
    value : float or None
        Its size, at least 0; None where the data do not give it.
    limit : float
        Largest accepted size.
    upper : float or None
        Upper end of its 95 % interval; None where it has none.
    """

    name: str
    value: float | None
    limit: float
    upper: float | None = None

    def passed(self, rule: str) -> bool | None:
        """Return whether the limit is held under a rule; None where it cannot be tested."""
        if self.value is None:
            return None
        tested = self.upper if rule == "guarded" and self.upper is not None else self.value
        return bool(tested <= self.limit)


@dataclass(frozen=True, slots=True)
class Acceptance:
    """All tests and what follows from them.

    Parameters
    ----------
    accepted : bool or None
        True: every limit is held; False: one is not; None: none is broken and one could not be
        tested.
    rule : str
        ``simple`` or ``guarded``.
    tests : tuple of LimitTest
        The tests.
    """

    accepted: bool | None
    rule: str
    tests: tuple[LimitTest, ...]

    def to_dict(self) -> dict[str, object]:
        """Return the decision as results store it."""
        return {
            "decision_rule": self.rule,
            "statement": _RULES[self.rule],
            "tests": [
                {
                    "name": test.name,
                    "value": test.value,
                    "limit": test.limit,
                    "upper": test.upper,
                    "passed": test.passed(self.rule),
                }
                for test in self.tests
            ],
        }


def decide(tests: Sequence[LimitTest], rule: str) -> Acceptance:
    """Decide by all tests."""
    held = [test.passed(rule) for test in tests]
    accepted = False if False in held else None if None in held else True
    return Acceptance(accepted, rule, tuple(tests))
