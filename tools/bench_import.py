"""Read 10^6 rows of ten channels of each format, beside the library that reads it alone.

    python tools/bench_import.py [--rows N] [FORMAT...]

Both give the ten channels as arrays of numbers, each in a new process, with the import of the
library. The time is that of the processor, children included, so that a busy machine does not
decide. Ends 1 where reading here takes more than 1.5 times as long.
"""

from __future__ import annotations

import argparse
import importlib
import multiprocessing
import resource
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from import_samples import SAMPLES, have, signals, write_sample

MOST = 1.5
COLUMNS = 10


def _text(path: Path) -> Any:
    return np.loadtxt(path, delimiter=",", skiprows=3)


def _json(path: Path) -> Any:
    import json

    entries = json.loads(path.read_text())["entries"]
    return [np.array([entry[name] for entry in entries]) for name in entries[0]]


def _npz(path: Path) -> Any:
    with np.load(path, allow_pickle=False) as file:
        return [file[name] for name in file.files]


def _npy(path: Path) -> Any:
    table = np.load(path, allow_pickle=False)
    return [np.ascontiguousarray(table[name]) for name in table.dtype.names]


def _mat5(path: Path) -> Any:
    from scipy.io import loadmat

    return loadmat(path)


def _hdf5(path: Path) -> Any:
    library: Any = importlib.import_module("h5py")
    with library.File(path) as file:
        return [file[name][...] for name in file]


def _parquet(path: Path) -> Any:
    library: Any = importlib.import_module("pyarrow.parquet")
    table = library.read_table(path)
    return [table[name].to_numpy() for name in table.column_names]


def _excel(path: Path) -> Any:
    library: Any = importlib.import_module("openpyxl")
    book = library.load_workbook(path, read_only=True)
    rows = list(book.worksheets[0].iter_rows(min_row=4, values_only=True))
    return np.array(rows, dtype=np.float64)


def _tdms(path: Path) -> Any:
    library: Any = importlib.import_module("nptdms")
    file = library.TdmsFile.read(path)
    return [channel[:] for group in file.groups() for channel in group.channels()]


def _mdf(path: Path) -> Any:
    library: Any = importlib.import_module("asammdf")
    with library.MDF(path) as file:
        return [signal.samples for signal in file.iter_channels()]


def _db3(path: Path) -> Any:
    """Read a database without metadata: the library alone asks for its messages only."""
    library: Any = importlib.import_module("rosbags.rosbag2")
    types: Any = importlib.import_module("rosbags.typesys")
    store = types.get_typestore(types.Stores.LATEST)
    found = []
    with library.Reader(path) as reader:
        for connection, _, raw in reader.messages():
            message = store.deserialize_cdr(raw, connection.msgtype)
            found.append((*message.position, *message.velocity, *message.effort))
    return np.array(found)


def _bag(path: Path) -> Any:
    library: Any = importlib.import_module("rosbags.highlevel")
    found = []
    with library.AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found.append((*message.position, *message.velocity, *message.effort))
    return np.array(found)


BARE: dict[str, Callable[[Path], Any]] = {
    "text": _text, "json": _json, "npz": _npz, "npy": _npy, "mat5": _mat5, "hdf5": _hdf5,
    "parquet": _parquet, "excel": _excel, "tdms": _tdms, "mdf": _mdf,
    "db3": _db3, "mcap": _bag, "ros1": _bag,
}  # fmt: skip

# formats that take minutes at a million rows: fewer, for both
FEWER = {"excel": 20, "db3": 10, "mcap": 10, "ros1": 10}


def _ours(path: Path) -> Any:
    """Read every channel as `hdbench import` does before it converts."""
    from hdbench.importing.registry import end_reader, open_source
    from hdbench.importing.source import Column

    source = open_source(path)
    columns = {c.name: Column(c.rows) for c in source.channels}
    for clock in dict.fromkeys(c.clock for c in source.channels):
        names = [c.name for c in source.channels if c.clock == clock]
        source.rounded = frozenset(names)
        for piece in source.read(names):
            for name in names:
                columns[name].add(piece[name])
    source.close()
    end_reader()
    return {name: column.whole() for name, column in columns.items()}


def _time(work: Callable[[Path], Any], path: Path, end: Any) -> None:
    work(path)
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    end.send(sum(one.ru_utime + one.ru_stime for one in used))


def seconds(work: Callable[[Path], Any], path: Path) -> float:
    """Return the time of one read in a new process, s, with the import of its library."""
    context = multiprocessing.get_context("spawn")
    results, end = context.Pipe(duplex=False)
    process = context.Process(target=_time, args=(work, path, end))
    process.start()
    end.close()  # then a process that ended without a result is no wait for ever
    took = float(results.recv())
    process.join()
    return took


def main() -> int:
    """Print one row a format."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("forms", nargs="*", metavar="FORMAT")
    asked = parser.parse_args()
    slow = False
    for form in asked.forms or BARE:
        libraries = SAMPLES[form][1]
        if not have(*libraries):
            print(f"{form:<8} not run: needs {', '.join(libraries)}")
            continue
        rows = asked.rows // FEWER.get(form, 1)
        kept = signals(rows)
        kept |= {f"channel{k}": np.cos(k * kept["time"]) for k in range(COLUMNS - len(kept))}
        with tempfile.TemporaryDirectory() as folder:
            path = write_sample(form, Path(folder), kept)
            # in turns, so that what else the machine does falls on both
            took = [(seconds(BARE[form], path), seconds(_ours, path)) for _ in range(asked.rounds)]
        bare, ours = (min(column) for column in zip(*took, strict=True))
        slow |= ours > MOST * bare
        print(f"{form:<8} {rows:8d} rows: {bare:7.2f} s alone {ours:7.2f} s here, "
              f"times {ours / bare:.2f}", flush=True)  # fmt: skip
    return int(slow)


if __name__ == "__main__":
    sys.exit(main())
