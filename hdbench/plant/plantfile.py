"""Plant files: read, checked, frozen."""

from __future__ import annotations

import difflib
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from hdbench.errors import ProfileError
from hdbench.plant.plantschema import PlantFile
from hdbench.profile.loader import read_toml
from hdbench.profile.problems import problem
from hdbench.profile.toml_map import Key, key_lines

__all__ = ["PlantSpec", "list_plants", "load_plant"]

_PACKAGE = "hdbench_profiles"


@dataclass(frozen=True, slots=True)
class PlantSpec:
    """A checked plant file.

    Parameters
    ----------
    data : PlantFile
        What the file says.
    text : str
        The file as it was read.
    sha256 : str
        SHA-256 of that text in UTF-8, hexadecimal.
    source : str
        Where it came from.
    """

    data: PlantFile
    text: str
    sha256: str
    source: str

    @property
    def name(self) -> str:
        """The plant's name."""
        return self.data.name


def list_plants() -> tuple[str, ...]:
    """Return the names of the plants that come with the package, sorted."""
    files = (resources.files(_PACKAGE) / "plants").iterdir()
    return tuple(sorted(f.name[:-5] for f in files if f.name.endswith(".toml")))


def load_plant(name_or_path: str) -> PlantSpec:
    """Return a plant by name or from a file."""
    text, source = _read(name_or_path)
    raw = read_toml(text, source)
    try:
        data = PlantFile.model_validate(raw)
    except ValidationError as error:
        lines = key_lines(text)
        found = [_problem(source, lines, entry) for entry in error.errors(include_url=False)]
        raise _all_problems(source, found) from None
    return PlantSpec(data, text, hashlib.sha256(text.encode()).hexdigest(), source)


def _read(name_or_path: str) -> tuple[str, str]:
    """Return text and source of a plant."""
    if name_or_path in list_plants():
        resource = resources.files(_PACKAGE) / "plants" / f"{name_or_path}.toml"
        return resource.read_text(encoding="utf-8"), str(resource)
    names = ", ".join(list_plants())
    try:
        return Path(name_or_path).read_text(encoding="utf-8"), name_or_path
    except FileNotFoundError:
        near = difflib.get_close_matches(name_or_path, list_plants(), n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise ProfileError(
            "no such plant",
            where=name_or_path,
            fix=f"{hint}name a TOML file or a built-in plant: {names}",
        ) from None
    except (OSError, ValueError) as error:
        raise ProfileError(
            f"cannot read the plant file: {error}",
            where=name_or_path,
            fix=f"name a readable UTF-8 TOML file or a built-in plant: {names}",
        ) from None


def _problem(source: str, lines: Mapping[Key, int], error: Mapping[str, Any]) -> ProfileError:
    """Return one finding of pydantic with file, line and key."""
    kind = str(error["type"])
    # pydantic names the kind of an effect as a part of the path, which the file does not have
    key: Key = tuple(
        part for i, part in enumerate(error["loc"]) if not (i == 2 and error["loc"][0] == "effects")
    )
    if kind == "missing":
        return problem(source, lines, key, "missing", f"add {key[-1]} = ... ({_HELP})")
    if kind == "extra_forbidden":
        near = difflib.get_close_matches(str(key[-1]), _known_keys(), n=1)
        fix = f"did you mean {near[0]!r}?" if near else f"take it out ({_HELP})"
        return problem(source, lines, key, "unknown", fix)
    while key and key not in lines:
        key = key[:-1]
    needed = str(error["msg"]).removeprefix("Value error, ")
    found = "" if isinstance(error["input"], dict) else f"found {error['input']!r}; "
    return problem(source, lines, key, f"{found}{needed}", f"correct the value ({_HELP})")


_HELP = "docs/plant.md lists keys, units and domains"


def _known_keys() -> list[str]:
    """Return every key that a plant file may have anywhere."""
    definitions = PlantFile.model_json_schema()["$defs"].values()
    nested = {name for table in definitions for name in table.get("properties", {})}
    return sorted(nested | set(PlantFile.model_fields))


def _all_problems(source: str, found: list[ProfileError]) -> ProfileError:
    """Return one error that holds every problem, in the order of the lines."""
    if len(found) == 1:
        return found[0]
    found.sort(key=lambda each: int(each.where.rpartition(":")[2]))
    return ProfileError(
        f"{len(found)} problems: " + "; ".join(each.what for each in found[:5]),
        where=source,
        fix="correct each of them",
        problems=tuple(found),
    )
