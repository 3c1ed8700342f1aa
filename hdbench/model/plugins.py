"""Causes that installed packages bring, by the entry point group ``hdbench.causes``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from types import TracebackType

from hdbench.errors import DataError, HdbenchError
from hdbench.model.causes import ALL_CAUSES
from hdbench.model.definition import Cause

__all__ = ["CAUSES_GROUP", "plugin_causes"]

CAUSES_GROUP = "hdbench.causes"


@cache
def plugin_causes() -> tuple[Cause, ...]:
    """Return the causes of all installed packages."""
    found: dict[str, Cause] = {cause.name: cause for cause in ALL_CAUSES}
    own: list[Cause] = []
    for entry in sorted(entry_points(group=CAUSES_GROUP), key=lambda e: (e.name, e.value)):
        for cause in _causes_of(entry):
            if cause.name in found:
                raise _error(entry, f"brings the cause {cause.name!r}, a name that is taken")
            found[cause.name] = cause
            own.append(cause)
    return tuple(own)


def _causes_of(entry: EntryPoint) -> Iterator[Cause]:
    """Yield the causes of an entry point: a cause, a sequence of them, or a callable for those."""
    with _Blamed(entry):
        thing = entry.load()
        if callable(thing) and not isinstance(thing, Cause):
            thing = thing()
        several = [thing] if isinstance(thing, Cause) else thing
        causes = list(several) if isinstance(several, Sequence) else [several]
    for cause in causes:
        if not isinstance(cause, Cause):
            kind = type(cause).__name__
            raise _error(entry, f"gives {kind}; needed: hdbench.model.Cause, or a sequence of it")
        yield cause


def _error(entry: EntryPoint, what: str) -> DataError:
    name = entry.dist.name if entry.dist is not None else "unknown"
    return DataError(
        f"distribution {name!r} {what}",
        where=f"entry point {entry.name} = {entry.value} of group {CAUSES_GROUP}",
        fix=f"mend or uninstall {name}",
    )


@dataclass(frozen=True, slots=True)
class _Blamed:
    """A context: whatever a package's own code raises becomes an error that names the package."""

    entry: EntryPoint

    def __enter__(self) -> None:
        """Begin what the package's own code does."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Turn an error into one that names the package."""
        if isinstance(error, Exception) and not isinstance(error, HdbenchError):
            words = f"cannot give its causes: {type(error).__name__}: {error}"
            raise _error(self.entry, words) from error
