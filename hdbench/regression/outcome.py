"""What a comparison with stored results showed."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from hdbench.errors import DataError
from hdbench.results.flatten import Leaf

__all__ = ["CaseReport", "Change", "RegressionReport"]


@dataclass(frozen=True, slots=True)
class Change:
    """One quantity that is not what it was.

    Parameters
    ----------
    key : str
        Its path in the result.
    what : {"moved", "changed", "missing", "new"}
        A number moved; another value changed; the key is gone; the key was not there before.
    expected, found : number, text, bool or None
        Before and now.
    allowed : float or None
        How far it may move, unit of the quantity; None for what is no number.
    in_tolerances : float or None
        How far it moved, in units of `allowed`; None where that is 0 or no number.
    reason : str
        Why the tolerance is what it is.
    regression : bool
        False where the change is told but allowed.
    """

    key: str
    what: Literal["moved", "changed", "missing", "new"]
    expected: Leaf
    found: Leaf
    allowed: float | None
    in_tolerances: float | None
    reason: str
    regression: bool

    def describe(self) -> str:
        """Return the change as one line for a person."""
        if self.what == "missing":
            return f"{self.key}: missing, was {self.expected!r}"
        if self.what == "new":
            return f"{self.key}: new, {self.found!r}"
        line = f"{self.key}: {self.expected!r} -> {self.found!r}"
        if self.in_tolerances is not None:
            return f"{line}, {self.in_tolerances:.3g} times its tolerance of {self.allowed:.3g}"
        return line


@dataclass(frozen=True, slots=True)
class CaseReport:
    """What one case showed.

    Parameters
    ----------
    name, kind : str
        Name of its folder and kind of evaluation.
    compared : int
        Quantities compared.
    changes : tuple of Change
        What is not what it was, regressions first.
    updated : bool
        Whether the expected results were written anew.
    error : DataError or None
        Why the case could not be compared at all.
    """

    name: str
    kind: str
    compared: int
    changes: tuple[Change, ...]
    updated: bool
    error: DataError | None = None

    @property
    def passed(self) -> bool:
        """True where the case was compared and nothing moved beyond its tolerance."""
        return self.error is None and not any(change.regression for change in self.changes)


@dataclass(frozen=True, slots=True)
class RegressionReport:
    """What all cases of a folder showed.

    Parameters
    ----------
    folder : str
        The folder.
    cases : tuple of CaseReport
        In the order of their names.
    """

    folder: str
    cases: tuple[CaseReport, ...]

    @property
    def passed(self) -> bool:
        """True where every case passed or was updated."""
        return all(case.passed or case.updated for case in self.cases)

    @property
    def errors(self) -> tuple[DataError, ...]:
        """Why cases could not be compared, one error each."""
        return tuple(case.error for case in self.cases if case.error is not None)

    def to_dict(self) -> dict[str, Any]:
        """Return the report as ``--json`` prints it (schema ``hdbench/regression/1``)."""
        from hdbench import __version__

        return {
            "schema": "hdbench/regression/1",
            "hdbench_version": __version__,
            "folder": self.folder,
            "passed": self.passed,
            "cases": [
                {
                    "name": case.name,
                    "kind": case.kind,
                    "passed": case.passed,
                    "updated": case.updated,
                    "compared": case.compared,
                    "changes": [asdict(change) for change in case.changes],
                    "error": None if case.error is None else case.error.to_dict(),
                }
                for case in self.cases
            ],
        }
