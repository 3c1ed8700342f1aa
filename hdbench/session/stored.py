"""What a run folder remembers of how it was asked for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdbench.errors import DataError
from hdbench.profile import Profile, parse_profile
from hdbench.records.runfolder import RunFolder

__all__ = ["stored_address", "stored_profile", "stored_table"]


def stored_profile(folder: RunFolder) -> Profile:
    """Return the profile that a run was made with."""
    text = folder.manifest["profile"].get("text")
    if not isinstance(text, str):
        raise DataError(
            "run.json holds no profile",
            where=str(folder.path),
            fix="start the experiment anew; what was recorded is kept in this run",
        )
    return parse_profile(text, f"{folder.path / 'run.json'}: profile")


def stored_address(folder: RunFolder) -> str | None:
    """Return the address of the bench controller that a run was asked for."""
    address = stored_table(folder.manifest, "bench").get("address")
    return address if isinstance(address, str) else None


def stored_table(manifest: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return a table of the details that a run remembers."""
    details = manifest.get("details")
    found = details.get(name) if isinstance(details, Mapping) else None
    return found if isinstance(found, Mapping) else {}
