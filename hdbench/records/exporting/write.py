"""Content written by the libraries that own the forms."""

from __future__ import annotations

import importlib
import io
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from hdbench.errors import DataError, UsageError
from hdbench.records.exporting.content import Channel, Content
from hdbench.records.storage import write_atomic

__all__ = ["FORMATS", "export_records"]

_Writer = Callable[[Content], bytes]
# MATLAB's names end after 31 characters unless long names are asked for, and then after 63
_LONGEST_MATLAB = 63


def export_records(content: Content, folder: Path, kind: str) -> Path:
    """Write a record in another program's form.

    Parameters
    ----------
    content : Content
        What `gather` read.
    folder : Path
        Folder to write into; made if need be.
    kind : {"parquet", "hdf5", "mat"}
        The form.

    Returns
    -------
    Path
        ``trace`` or ``loads`` with the form's ending. Written whole or not at all.

    Raises
    ------
    UsageError
        If the form is unknown, or its library is not installed.
    DataError
        If the form cannot hold a column's name.
    StorageError
        If the file cannot be written.
    """
    if kind not in FORMATS:
        raise UsageError(
            f"{kind!r} is no form to export to; needed: {', '.join(FORMATS)}",
            where="--format",
            fix="take parquet for data tools, hdf5 for archives, mat for MATLAB",
        )
    ending, writer = FORMATS[kind]
    body = writer(content)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / f"{content.name}{ending}"
    write_atomic(target, body)
    return target


def _library(name: str, extra: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise UsageError(
            f"{name.partition('.')[0]} is not installed; needed to write {extra}",
            where=f"--format {extra}",
            fix=f"pip install 'hdbench[{extra}]'",
        ) from error


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
            if _is_words(channel):
                data = group.create_dataset(
                    _hdf5_name(name), data=list(channel.values), dtype=h5py.string_dtype()
                )
            else:
                large = len(channel.values) > 1000
                data = group.create_dataset(
                    _hdf5_name(name), data=channel.values, compression="gzip" if large else None
                )
            if channel.unit:
                data.attrs["unit"] = channel.unit
    return sink.getvalue()


def _hdf5_name(name: str) -> str:
    # a slash makes groups, and a lone dot is the group itself
    return name.replace("/", "_") if name != "." else "_"


def _mat(content: Content) -> bytes:
    from scipy.io import savemat

    # any binary file will do; the stubs know paths alone
    sink: Any = io.BytesIO()
    columns: dict[str, Any] = {}
    units: dict[str, str] = {}
    for name, channel in content.channels.items():
        _check_matlab(name)
        words = _is_words(channel)
        columns[name] = np.array(channel.values, dtype=object if words else np.float64)
        units[name] = channel.unit
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
