"""Errors that a user of the bench can act on, and the exit codes of the contract."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Self


class HdbenchError(Exception):
    """Say what is wrong, where it can be seen, and one act that mends it.

    Parameters
    ----------
    what : str
        What was found and what is needed, with units.
    where : str
        A place that can be opened: ``file:line``, key, channel, sample.
    fix : str
        One next act.
    problems : tuple of HdbenchError, optional
        Every single problem, where one raise reports several of them.
    """

    exit_code = 1
    kind = "bug"

    def __init__(
        self, what: str, *, where: str, fix: str, problems: tuple[HdbenchError, ...] = ()
    ) -> None:
        super().__init__(what)
        self.what = what
        self.where = where
        self.fix = fix
        self.problems = problems

    @classmethod
    def several(cls, problems: Sequence[HdbenchError]) -> Self:
        """Return the first of several problems, with all of them."""
        first = problems[0]
        return cls(first.what, where=first.where, fix=first.fix, problems=tuple(problems))

    def __reduce__(self) -> tuple[object, ...]:
        """Carry the error between processes: the constructor's arguments have names."""
        return Exception.__new__, (type(self), self.what), self.__dict__

    def __str__(self) -> str:
        """Return the three parts as a person reads them."""
        return f"{self.where}: {self.what}\n  fix: {self.fix}"

    def to_dict(self) -> dict[str, object]:
        """Return the error as the object that ``--json`` prints."""
        body: dict[str, object] = {
            "kind": self.kind,
            "what": self.what,
            "where": self.where,
            "fix": self.fix,
            "exit_code": self.exit_code,
        }
        if self.problems:
            body["problems"] = [problem.to_dict() for problem in self.problems]
        return body


class UsageError(HdbenchError):
    """The command was called in a way that cannot work."""

    exit_code = 2
    kind = "usage"


class LimitError(HdbenchError):
    """A check that was asked for failed: a limit, a regression, an acceptance."""

    exit_code = 3
    kind = "check-failed"


class DataError(HdbenchError):
    """A trace, loads file, model, result or run folder is invalid."""

    exit_code = 4
    kind = "data"


class ProfileError(DataError):
    """A profile or plant file is invalid."""

    kind = "profile"


class DeviceError(HdbenchError):
    """A device or the communication with it failed."""

    exit_code = 5
    kind = "device"


class DoubtfulDataError(HdbenchError):
    """The run finished, but gaps or saturation make its data doubtful."""

    exit_code = 6
    kind = "doubtful-data"


class StorageError(HdbenchError):
    """The disk is full or failed; what was acknowledged is kept."""

    exit_code = 7
    kind = "storage"


class UnsafeError(HdbenchError):
    """The safe state could not be confirmed."""

    exit_code = 8
    kind = "unsafe"

    @classmethod
    def unconfirmed(cls, detail: str, *, where: str) -> UnsafeError:
        """Return the loudest message there is."""
        return cls(
            f"THE SAFE STATE COULD NOT BE CONFIRMED: {detail}",
            where=where,
            fix="press the emergency stop, then look at the bench before anything else",
        )


class BusyError(HdbenchError):
    """Another run holds the bench."""

    exit_code = 9
    kind = "busy"


class Stopped(HdbenchError):  # noqa: N818 - a stop that was asked for is not an error
    """The run was stopped by a signal after the safe state was confirmed.

    Parameters
    ----------
    what, where, fix : str
        As for `HdbenchError`.
    exit_code : int
        129 for SIGHUP, 130 for Ctrl-C, 143 for SIGTERM.
    """

    kind = "stopped"

    def __init__(self, what: str, *, where: str, fix: str, exit_code: int) -> None:
        super().__init__(what, where=where, fix=fix)
        self.exit_code = exit_code


def nothing_stored(path: object) -> DataError:
    """Return the error for a path where neither a file nor a run is."""
    return DataError(
        "no such file or run",
        where=str(path),
        fix="check the path; 'hdbench runs list' names the runs that are stored here",
    )


def told_error(body: Mapping[str, Any]) -> HdbenchError:
    """Return the error that another process has told as `HdbenchError.to_dict` gives it."""
    kinds = {kind.kind: kind for kind in (UsageError, DataError, ProfileError, StorageError)}
    kind = kinds.get(str(body["kind"]), DeviceError)
    return kind(str(body["what"]), where=str(body["where"]), fix=str(body["fix"]))
