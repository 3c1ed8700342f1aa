"""Runs and records in the forms that other programs read: Parquet, HDF5, MATLAB."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.errors import DataError
from hdbench.records.jsonfile import read_json
from hdbench.records.loads import ArmLike, Loads, is_loads_file, read_loads
from hdbench.records.parquetfile import library
from hdbench.records.provenance import input_identity
from hdbench.records.recovery import resolve_input
from hdbench.records.runfolder import RUN_SCHEMA
from hdbench.records.storage import write_atomic
from hdbench.records.trace import unit_of_column
from hdbench.records.tracefile import read_trace

# columns of loads, words first
_LOADS = (
    *("experiment", "range", "direction", "series"),
    *("position_rad", "torque_nm", "reading_v", "mass_kg", "reading_std_v"),
    *("n_samples", "time_s", "temperature_c"),
)
# what identifies a run; its profile's text and the result go whole
_KEPT = ("schema", "run_id", "kind", "status", "started_utc", "ended_utc", "exit_reason")


@dataclass(frozen=True, slots=True)
class Channel:
    """One column."""

    values: NDArray[np.float64] | tuple[str, ...]  # numbers, NaN where one is missing; or words
    unit: str  # `1` for a count, empty for words and for what the name does not tell


@dataclass(frozen=True, slots=True)
class Content:
    """One record."""

    name: str  # `trace` or `loads`
    channels: Mapping[str, Channel]  # in the order of the file
    # file, its SHA-256, the run, and as JSON text what it holds beside the samples
    attributes: Mapping[str, str]


def gather(source: Path, arm: ArmLike) -> Content:
    """Read a run folder, a trace or a loads file for export."""
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
    found: dict[str, Channel] = {}
    for name in _LOADS:
        values = [getattr(row, name) for row in loads.readings]
        if isinstance(values[0], str):
            found[name] = Channel(tuple(values), "")
        elif any(value is not None for value in values):
            numbers = np.array([np.nan if value is None else float(value) for value in values])
            found[name] = Channel(numbers, "1" if name == "n_samples" else unit_of_column(name))
    return found | {name: _own(name, words) for name, words in loads.extra_columns.items()}


def _own(name: str, words: tuple[str, ...]) -> Channel:
    """Return a column that is not of ours as numbers where all its cells are some."""
    number = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|")
    if any(words) and all(number.fullmatch(word.strip()) for word in words):
        values = [float(word) if word.strip() else np.nan for word in words]
        return Channel(np.array(values), unit_of_column(name))
    return Channel(words, "")


_Writer = Callable[[Content], bytes]
# MATLAB's names end after 31 characters unless long names are asked for, and then after 63
_LONGEST_MATLAB = 63


def export_records(content: Content, folder: Path, kind: str) -> Path:
    """Write a record in another program's form."""
    ending, writer = FORMATS[kind]
    body = writer(content)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / f"{content.name}{ending}"
    write_atomic(target, body)
    return target


def _library(name: str, extra: str) -> ModuleType:
    return library(name, extra, f"--format {extra}", f"to write {extra}")


def _is_words(channel: Channel) -> bool:
    return isinstance(channel.values, tuple)


def _parquet(content: Content) -> bytes:
    arrow, parquet = _library("pyarrow", "parquet"), _library("pyarrow.parquet", "parquet")
    fields, arrays = [], []
    for name, channel in content.channels.items():
        kind = arrow.string() if _is_words(channel) else arrow.float64()
        unit = {"unit": channel.unit} if channel.unit else None
        fields.append(arrow.field(name, kind, metadata=unit))
        arrays.append(arrow.array(channel.values, type=kind))
    schema = arrow.schema(fields, metadata=dict(content.attributes))
    sink = io.BytesIO()
    parquet.write_table(arrow.table(arrays, schema=schema), sink, compression="zstd")
    return sink.getvalue()


def _hdf5(content: Content) -> bytes:
    h5py = _library("h5py", "hdf5")
    sink = io.BytesIO()
    with h5py.File(sink, "w") as file:
        group = file.create_group(content.name)
        for name, text in content.attributes.items():
            # an attribute holds 64 kB at most: long texts become data sets of their own
            if len(text.encode()) < 60_000:
                file.attrs[name] = text
            else:
                file.create_dataset(f"about/{name}", data=text)
        for name, channel in content.channels.items():
            values: Any = channel.values
            more: dict[str, Any] = {"compression": "gzip"} if len(values) > 1000 else {}
            if _is_words(channel):
                values, more = list(values), {"dtype": h5py.string_dtype()}
            # a slash makes groups, and a lone dot is the group itself
            named = name.replace("/", "_") if name != "." else "_"
            data = group.create_dataset(named, data=values, **more)
            if channel.unit:
                data.attrs["unit"] = channel.unit
    return sink.getvalue()


def _mat(content: Content) -> bytes:
    from scipy.io import savemat

    # any binary file will do; the stubs know paths alone
    sink: Any = io.BytesIO()
    columns: dict[str, Any] = {}
    for name, channel in content.channels.items():
        _check_matlab(name)
        words = _is_words(channel)
        columns[name] = np.array(channel.values, dtype=object if words else np.float64)
    units = {name: channel.unit for name, channel in content.channels.items()}
    body = {content.name: columns, "units": units, "about": dict(content.attributes)}
    savemat(sink, body, do_compression=True, oned_as="column", long_field_names=True)
    return bytes(sink.getvalue())


def _check_matlab(name: str) -> None:
    good = name.isascii() and name.isidentifier() and name[0] != "_"
    if not good or len(name) > _LONGEST_MATLAB:
        raise DataError(
            f"{name!r} is no name of a MATLAB field; needed: a letter, then letters, digits and "
            f"'_', at most {_LONGEST_MATLAB}",
            where=f"column {name!r}",
            fix="rename the column, or export to parquet or hdf5",
        )


FORMATS: dict[str, tuple[str, _Writer]] = {
    "parquet": (".parquet", _parquet),
    "hdf5": (".h5", _hdf5),
    "mat": (".mat", _mat),
}
"""Form: ending of its files, and what writes it."""
