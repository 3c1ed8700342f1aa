"""What a report may write over: nothing, or what an earlier report made."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from hdbench.errors import DataError, UsageError
from hdbench.records.storage import storage_error

__all__ = ["refuse_foreign"]

# the first bytes of every file that a report makes hold one of these
_MARKS = {
    ".html": ("hdbench</title>",),
    ".htm": ("hdbench</title>",),
    ".csv": (
        "quantity,value,std,dof,unit,source",
        "part,group,torque_nm,name,value,unit",
        "case,key,what,expected,found,allowed,in_tolerances,regression",
        "name,series,unit,run,time_utc,value,std",
        "kind,drive,run,figure,value,std,score,outlier",
    ),
    ".json": tuple(
        f'"schema": "hdbench/{kind}/'
        for kind in ("report", "comparison", "regression", "trend", "fleet")
    ),
}
# the title stands behind the page's security policy, the schema on the first lines
_HEAD_BYTES = 4096


def refuse_foreign(files: Iterable[Path]) -> None:
    """Refuse to write over a file that no report made."""
    for file in files:
        if not file.exists():
            continue
        if not file.is_file():
            raise DataError(
                "not a regular file", where=str(file), fix="name another file with --out"
            )
        try:
            with file.open("rb") as stream:
                head = stream.read(_HEAD_BYTES).decode("utf-8", errors="replace")
        except OSError as error:
            raise storage_error(error, file) from error
        if head and not any(mark in head for mark in _MARKS.get(file.suffix.lower(), ())):
            raise UsageError(
                "the file exists and is no report's; a report writes .html, .csv and .json of "
                "one name",
                where=str(file),
                fix="name another file with --out, or move this one away",
            )
