"""What is exported: channels with their units, and everything known beside them."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.records.jsonfile import read_json
from hdbench.records.loads import Loads
from hdbench.records.loadsfile import ArmLike, is_loads_file, read_loads
from hdbench.records.manifest import RUN_SCHEMA
from hdbench.records.provenance import input_identity
from hdbench.records.recovery import resolve_input
from hdbench.records.tracefile import read_trace

__all__ = ["Channel", "Content", "gather", "unit_of_column"]

# longest first: `_rad_s` ends in `_s` too
_UNITS = {
    "_rad_s2": "rad/s^2",
    "_rad_s": "rad/s",
    "_rad": "rad",
    "_nm": "N m",
    "_hz": "Hz",
    "_kg": "kg",
    "_v": "V",
    "_a": "A",
    "_c": "degC",
    "_s": "s",
    "_count": "1",
}
_NUMBERS = ("position_rad", "torque_nm", "reading_v", "mass_kg", "reading_std_v")
_MORE_NUMBERS = ("n_samples", "time_s", "temperature_c")
_WORDS = ("experiment", "range", "direction", "series")
# what identifies a run; its profile's text and the result go whole
_KEPT = ("schema", "run_id", "kind", "status", "started_utc", "ended_utc", "exit_reason")


@dataclass(frozen=True, slots=True)
class Channel:
    """One column.

    Parameters
    ----------
    values : ndarray of float64, or tuple of str
        Numbers, NaN where one is missing; or words.
    unit : str
        ``1`` for a count, empty for words and for what the name does not tell.
    """

    values: NDArray[np.float64] | tuple[str, ...]
    unit: str


@dataclass(frozen=True, slots=True)
class Content:
    """One record.

    Parameters
    ----------
    name : str
        ``trace`` or ``loads``.
    channels : mapping of str to Channel
        In the order of the file.
    attributes : mapping of str to str
        File, its SHA-256, the run, and as JSON text what it holds beside the samples.
    """

    name: str
    channels: Mapping[str, Channel]
    attributes: Mapping[str, str]


def unit_of_column(name: str) -> str:
    """Return the unit that a column's name ends in.

    Examples
    --------
    >>> unit_of_column("motor_velocity_rad_s")
    'rad/s'
    """
    for ending, unit in _UNITS.items():
        if name.endswith(ending):
            return unit
    return ""


def gather(source: Path, arm: ArmLike) -> Content:
    """Read a run folder, a trace or a loads file for export.

    Parameters
    ----------
    source : Path
        Run folder or file.
    arm : ArmLike
        Makes torque of masses where a loads file has no torque.

    Returns
    -------
    Content
        Every column of the file, those of others' making too.

    Raises
    ------
    DataError
        If it holds neither a trace nor loads, or is damaged.
    """
    file = resolve_input(Path(source))
    identity = input_identity(file)
    attributes = {"source": str(file), "sha256": identity["sha256"], **_run(Path(source))}
    if "imported" in identity:
        attributes["imported"] = json.dumps(identity["imported"])
    if is_loads_file(file):
        return Content("loads", _load_channels(read_loads(file, arm)), attributes)
    trace = read_trace(file)
    channels = {
        name: Channel(values, unit_of_column(name)) for name, values in trace.columns.items()
    }
    return Content("trace", channels, attributes)


def _run(source: Path) -> dict[str, str]:
    if not (source / "run.json").is_file():
        return {}
    manifest = read_json(source / "run.json", RUN_SCHEMA)
    found = {name: str(manifest[name]) for name in _KEPT if manifest.get(name) is not None}
    profile = manifest.get("profile")
    if isinstance(profile, Mapping):
        found["profile_toml"] = str(profile.get("text", ""))
        found["profile_sha256"] = str(profile.get("sha256", ""))
    for name in ("calibration", "device", "versions"):
        if manifest.get(name) is not None:
            found[f"{name}_json"] = json.dumps(manifest[name], allow_nan=False)
    if (source / "result.json").is_file():
        body: Any = read_json(source / "result.json", None)
        found["result_json"] = json.dumps(body, allow_nan=False)
    return found


def _load_channels(loads: Loads) -> dict[str, Channel]:
    rows = loads.readings
    found: dict[str, Channel] = {}
    for name in _WORDS:
        found[name] = Channel(tuple(str(getattr(row, name)) for row in rows), "")
    for name in (*_NUMBERS, *_MORE_NUMBERS):
        values = [getattr(row, name) for row in rows]
        if any(value is not None for value in values):
            numbers = [np.nan if value is None else float(value) for value in values]
            unit = "1" if name == "n_samples" else unit_of_column(name)
            found[name] = Channel(np.array(numbers), unit)
    for name, words in loads.extra_columns.items():
        found[name] = _own(name, words)
    return found


def _own(name: str, words: tuple[str, ...]) -> Channel:
    """Return a column that is not of ours as numbers where all its cells are some."""
    number = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|")
    if any(words) and all(number.fullmatch(word.strip()) for word in words):
        values = [float(word) if word.strip() else np.nan for word in words]
        return Channel(np.array(values), unit_of_column(name))
    return Channel(words, "")
