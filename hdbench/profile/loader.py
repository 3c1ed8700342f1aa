"""From TOML text to a checked, frozen profile."""

from __future__ import annotations

import difflib
import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from hdbench.errors import ProfileError
from hdbench.profile.problems import schema_problems
from hdbench.profile.schema import ProfileData
from hdbench.profile.toml_text import key_lines, read_toml, toml_text

__all__ = [
    "Profile",
    "check_profiles",
    "list_profiles",
    "load_profile",
    "parse_profile",
    "profile_from_json",
    "read_toml",
]

_PACKAGE = "hdbench_profiles"


@dataclass(frozen=True, slots=True)
class Profile:
    """A checked profile and the text that it came from.

    Parameters
    ----------
    data : ProfileData
        The bench.
    text : str
        TOML text.
    sha256 : str
        SHA-256 of that text in UTF-8.
    path : str
        Where it was read.
    drive : str
        Which drive is on the bench: ``identity.drive_serial``, or what was told beside the profile;
        empty where nobody says.
    """

    data: ProfileData
    text: str
    sha256: str
    path: str
    drive: str = ""

    @property
    def name(self) -> str:
        """Name of the profile."""
        return self.data.name

    @property
    def sensor(self) -> str:
        """Serial number of the flexspline, which carries the gauges; empty where nobody says."""
        return self.data.identity.flexspline_serial

    def describe(self) -> dict[str, str]:
        """Return ``name`` and ``sha256`` as results hold them."""
        return {"name": self.name, "sha256": self.sha256}


def list_profiles() -> tuple[str, ...]:
    """Return the names of the built-in profiles, sorted.

    Returns
    -------
    tuple of str
    """
    files = resources.files(_PACKAGE).iterdir()
    return tuple(sorted(f.name[:-5] for f in files if f.name.endswith(".toml")))


def load_profile(name_or_path: str) -> Profile:
    """Load a built-in profile by name, or any profile by path.

    Parameters
    ----------
    name_or_path : str
        A built-in name, such as ``cim-tr-97-06``, or the path of a TOML file.

    Returns
    -------
    Profile

    Raises
    ------
    ProfileError
        If there is no such profile, or it is invalid; then ``problems`` holds every problem.
    """
    if name_or_path in list_profiles():
        resource = resources.files(_PACKAGE) / f"{name_or_path}.toml"
        return parse_profile(resource.read_text(encoding="utf-8"), str(resource))
    path = Path(name_or_path)
    near = difflib.get_close_matches(path.stem, list_profiles(), n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    names = ", ".join(list_profiles())
    text = toml_text(path, f"{hint}name a TOML file or a built-in profile: {names}")
    return parse_profile(text, str(path))


def check_profiles(names: Sequence[str]) -> tuple[Profile, ...]:
    """Load several profiles and name the problems of all of them at once.

    Parameters
    ----------
    names : sequence of str
        As for `load_profile`.

    Returns
    -------
    tuple of Profile

    Raises
    ------
    ProfileError
        If any of them is invalid; ``problems`` holds every problem of every one.
    """
    profiles, errors = [], []
    for name in names:
        try:
            profiles.append(load_profile(name))
        except ProfileError as error:
            errors.append(error)
    if len(errors) == 1:
        raise errors[0]
    if errors:
        raise ProfileError(
            f"{len(errors)} of {len(names)} profiles are invalid",
            where=", ".join(error.where for error in errors),
            fix="correct each of them",
            problems=tuple(p for error in errors for p in error.problems or (error,)),
        )
    return tuple(profiles)


def _tuples(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _tuples(item) for name, item in value.items()}
    if isinstance(value, list):
        return tuple(_tuples(item) for item in value)
    return value


def profile_from_json(text: str) -> ProfileData:
    """Return the profile that another process has written as JSON.

    Notes
    -----
    JSON has lists where a profile has tuples, and a table that fills in keys before it is checked
    (a composite) is then checked strictly.
    """
    return ProfileData.model_validate(_tuples(json.loads(text)))


def parse_profile(text: str, path: str) -> Profile:
    """Check the text of a profile.

    Parameters
    ----------
    text : str
        TOML text.
    path : str
        Where it came from, for messages.

    Returns
    -------
    Profile

    Raises
    ------
    ProfileError
        If anything is wrong. ``problems`` holds every problem at once, in the order of the lines,
        each with file and line, key, what was found and what is needed with its unit.
    """
    raw = _tuples(read_toml(text, path))
    found: list[ProfileError] = []
    data = None
    lines = key_lines(text)
    try:
        data = ProfileData.model_validate(raw)
    except ValidationError as error:
        found = [
            one
            for entry in error.errors(include_url=False)
            for one in schema_problems(ProfileData, path, lines, entry)
        ]
    if data is None:
        raise _all_problems(path, found)
    digest = hashlib.sha256(text.encode()).hexdigest()
    return Profile(data, text, digest, path, data.identity.drive_serial)


def _all_problems(path: str, found: list[ProfileError]) -> ProfileError:
    found.sort(key=lambda error: int(error.where.rpartition(":")[2]))
    count = f"{len(found)} problems" if len(found) != 1 else "1 problem"
    return ProfileError(
        f"{count}: " + "; ".join(error.what for error in found[:5]),
        where=path,
        fix=found[0].fix if len(found) == 1 else "correct each of them",
        problems=tuple(found),
    )
