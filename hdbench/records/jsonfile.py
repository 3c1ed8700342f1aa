"""Results as JSON: full double precision, no NaN, written whole or not at all."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, NoReturn, Protocol

import numpy as np

from hdbench.errors import DataError
from hdbench.records.storage import file_bytes, write_atomic

# a diagnosis of an hour with every spectrum point stays below 100 MB
_LIMIT_BYTES = 256 << 20


class ProfileIdentity(Protocol):
    """What a result says about the profile it was made with."""

    @property
    def name(self) -> str:
        """Name of the profile."""
        ...

    @property
    def text(self) -> str:
        """Its TOML text."""
        ...

    @property
    def sha256(self) -> str:
        """SHA-256 of that text."""
        ...

    @property
    def drive(self) -> str:
        """Which drive is on the bench; empty where nobody says."""
        ...

    @property
    def sensor(self) -> str:
        """Which sensor is on the bench; empty where nobody says."""
        ...


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no JSON form")


def dumps(obj: object) -> str:
    """Return `obj` as JSON text with two blanks of indent."""
    return json.dumps(obj, allow_nan=False, indent=2, default=_plain) + "\n"


def write_json(path: Path, obj: object) -> None:
    """Write `obj` to `path` atomically.

    Parameters
    ----------
    path : Path
        File to write or replace.
    obj : object
        As for `dumps`.

    Raises
    ------
    StorageError
        If the disk is full or failed; an old file is then untouched.
    ValueError
        If a number is NaN or infinite.
    """
    write_atomic(Path(path), dumps(obj).encode("utf-8"))


def _refuse_constant(word: str) -> NoReturn:
    raise ValueError(f"{word} is not JSON")


def _finite(word: str) -> float:
    value = float(word)
    if not math.isfinite(value):
        raise ValueError(f"{word} exceeds the range of a double")
    return value


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) != len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"key {twice!r} occurs twice in one object")
    return result


def _parse(path: Path) -> object:
    raw = file_bytes(path, limit=_LIMIT_BYTES, what="JSON file")
    where = str(path)
    try:
        return json.loads(
            raw.decode("utf-8"),
            parse_constant=_refuse_constant,
            parse_float=_finite,
            object_pairs_hook=_unique,
        )
    except json.JSONDecodeError as error:
        where, what = f"{path}:{error.lineno}:{error.colno}", error.msg
    except UnicodeDecodeError as error:
        what = f"byte {error.start} is not UTF-8"
    except RecursionError:
        what = "nested too deeply"
    except ValueError as error:
        what = str(error)
    raise DataError(f"not valid JSON: {what}", where=where, fix="make the file again with hdbench")


def read_json(path: Path, schema: str | None = None) -> dict[str, Any]:
    """Read a JSON object, and check its ``schema``.

    Parameters
    ----------
    path : Path
        File to read.
    schema : str, optional
        Needed value of the key ``schema``, such as ``hdbench/ripple/1``; None takes any object.

    Returns
    -------
    dict

    Raises
    ------
    DataError
        If the file is missing, not JSON (NaN and infinities are not), not an object, or of
        another schema.
    """
    body = _parse(Path(path))
    if not isinstance(body, dict):
        raise DataError(
            f"found a JSON {type(body).__name__}; needed: an object",
            where=str(path),
            fix="name a file that hdbench wrote",
        )
    if schema is not None and body.get("schema") != schema:
        raise DataError(
            f"key 'schema' is {body.get('schema')!r:.60}; needed: {schema!r}",
            where=str(path),
            fix=f"name a file of the kind {schema!r}",
        )
    return body


def result_header(kind: str, profile: ProfileIdentity | None) -> dict[str, Any]:
    """Return the keys with which every JSON result starts (contract section 5).

    Parameters
    ----------
    kind : str
        ``calibration``, ``misalignment``, ``ripple``, ``diagnosis``, ...
    profile : Profile or None
        The bench that the result is about.

    Returns
    -------
    dict
        ``schema``, ``hdbench_version``, ``profile`` (``name``, ``sha256``; None without one).
    """
    from hdbench import __version__

    identity = None if profile is None else {"name": profile.name, "sha256": profile.sha256}
    return {"schema": f"hdbench/{kind}/1", "hdbench_version": __version__, "profile": identity}
