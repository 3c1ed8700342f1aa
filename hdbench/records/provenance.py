"""Provenance of an imported file, stored beside it: it goes into every result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hdbench.errors import DataError
from hdbench.records.jsonfile import read_json, write_json
from hdbench.records.storage import sha256_file

_SCHEMA = "hdbench/import-provenance/1"


def provenance_path(file: Path) -> Path:
    """Return where the provenance of a file stands."""
    return file.with_name(f"{file.name}.provenance.json")


def write_provenance(
    file: Path, sources: Sequence[tuple[Path, str]], described: Mapping[str, Any]
) -> None:
    """Write what a file was made from beside it."""
    from hdbench import __version__

    if not file.is_file():
        return
    body = {
        "schema": _SCHEMA,
        "hdbench_version": __version__,
        "sha256": sha256_file(file),
        "sources": [{"path": str(path), "form": form, **_digest(path)} for path, form in sources],
        **described,
    }
    write_json(provenance_path(file), body)


def _digest(path: Path) -> dict[str, str]:
    return {"sha256": sha256_file(path)} if path.is_file() else {}


def input_identity(file: Path) -> dict[str, Any]:
    """Return path and digest of an input, and what it was made from where it was imported.

    Parameters
    ----------
    file : Path
        A trace or loads file.

    Returns
    -------
    dict
        ``path``, ``sha256``, and ``imported`` where the provenance beside it is of this content.

    Raises
    ------
    DataError
        If the file cannot be read.
    """
    digest = sha256_file(file)
    identity: dict[str, Any] = {"path": str(file), "sha256": digest}
    beside = provenance_path(file)
    if beside.is_file():
        try:
            body = read_json(beside, _SCHEMA)
        except DataError:
            return identity
        if body.get("sha256") == digest:
            kept = ("sources", "columns", "notes", "time_origin_s")
            identity["imported"] = {key: body[key] for key in kept if key in body}
    return identity
