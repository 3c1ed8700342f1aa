"""One small log of a turning drive in every format that is imported.

Where there is one, another library writes a file than the one that reads it: MCAP by mcap, XLSX by
XlsxWriter, HDF5 by netCDF4, Parquet by polars; NumPy's, TDMS and the databases of ROS 2 by hand.
"""

from __future__ import annotations

import importlib
import importlib.util
import io
import json
import sqlite3
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["MAPS", "SAMPLES", "Signals", "have", "signals", "write_sample"]

_RATE_HZ = 500.0
_UNITS = {"time": "s", "speed": "rpm", "torque": "Nm"}
Signals = dict[str, np.ndarray[Any, Any]]
_MAPS = ["torque_nm=torque", "motor_velocity_rad_s=speed@rpm"]
_JOINT = ["torque_nm=effort", "motor_velocity_rad_s=velocity", "motor_angle_rad=position"]
# what maps each sample to a trace
MAPS = {
    "text": ["time_s=time", *_MAPS], "gz": ["time_s=time", *_MAPS], "json": ["time_s=time", *_MAPS],
    "npz": ["time_s=time", *_MAPS], "npy": ["time_s=time", *_MAPS],
    "mat5": ["time_s=time", *_MAPS], "mat73": ["time_s=time", *_MAPS],
    "hdf5": ["time_s=time", *_MAPS], "parquet": ["time_s=time", *_MAPS],
    "excel": ["time_s=time", *_MAPS], "tdms": _MAPS, "mdf": _MAPS,
    "db3": _JOINT, "mcap": _JOINT, "ros1": _JOINT,
}  # fmt: skip


def signals(rows: int = 200) -> Signals:
    """Return time, s, speed, rpm, and torque, N m."""
    time = np.arange(rows) / _RATE_HZ
    speed = 500.0 + 20.0 * np.sin(2.0 * np.pi * 3.0 * time)
    return {"time": time, "speed": speed, "torque": 0.3 * np.cos(2.0 * np.pi * 7.0 * time) + 1.0}


def have(*libraries: str) -> bool:
    """Return whether libraries are installed."""
    return all(importlib.util.find_spec(name) is not None for name in libraries)


def _text(path: Path, kept: Signals) -> None:
    lines = ["# made by a bench", "time,speed,torque", "s,rpm,Nm"]
    lines += [",".join(f"{v:.12g}" for v in row) for row in zip(*kept.values(), strict=True)]
    path.write_text("\n".join(lines) + "\n")


def _gz(path: Path, kept: Signals) -> None:
    import gzip

    plain = path.with_suffix(".plain")
    _text(plain, kept)
    path.write_bytes(gzip.compress(plain.read_bytes(), mtime=0))
    plain.unlink()


def _json(path: Path, kept: Signals) -> None:
    entries = [
        dict(zip(kept, row, strict=True)) for row in np.array(list(kept.values())).T.tolist()
    ]
    path.write_text(json.dumps({"drive": "one", "kp": 3.5, "entries": entries}))


def _npy_bytes(array: np.ndarray[Any, Any]) -> bytes:
    """Return an array as its format says, version 1.0."""
    shape = f"({', '.join(map(str, array.shape))},)"
    fields = array.dtype.descr if array.dtype.names else array.dtype.str
    head = f"{{'descr': {fields!r}, 'fortran_order': False, 'shape': {shape}, }}"
    head += " " * (-(len(head) + 11) % 64) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode() + array.tobytes()


def _npz(path: Path, kept: Signals) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, values in kept.items():
            archive.writestr(f"{name}.npy", _npy_bytes(values))


def _npy(path: Path, kept: Signals) -> None:
    table = np.zeros(len(kept["time"]), dtype=[(name, "<f8") for name in kept])
    for name, values in kept.items():
        table[name] = values
    path.write_bytes(_npy_bytes(table))


def _mat5(path: Path, kept: Signals) -> None:
    from scipy.io import savemat

    columns = {name: values[:, None] for name, values in kept.items()}
    savemat(path, {**columns, "kt": 2.5, "log": {"note": "a bench", "extra": np.arange(5.0)}})


def _mat73(path: Path, kept: Signals) -> None:
    """Write what MATLAB writes: HDF5 behind 512 bytes of its own, vectors lying."""
    h5py: Any = importlib.import_module("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in kept.items():
            data = file.create_dataset(name, data=values[None, :])
            data.attrs["MATLAB_class"] = np.bytes_("double")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, made for a test".ljust(124) + b"\x00\x02IM"
    with path.open("r+b") as file:
        file.write(head)


def _hdf5(path: Path, kept: Signals) -> None:
    netcdf: Any = importlib.import_module("netCDF4")
    with netcdf.Dataset(path, "w", format="NETCDF4") as file:
        file.createDimension("n", len(kept["time"]))
        for name, values in kept.items():
            column = file.createVariable(name, "f8", ("n",))
            column[:] = values
            column.units = _UNITS.get(name, "")


def _parquet(path: Path, kept: Signals) -> None:
    polars: Any = importlib.import_module("polars")
    polars.DataFrame(kept).write_parquet(path)


def _excel(path: Path, kept: Signals) -> None:
    xlsxwriter: Any = importlib.import_module("xlsxwriter")
    book = xlsxwriter.Workbook(str(path))
    sheet = book.add_worksheet("Log")
    sheet.write(0, 0, "made by a bench")
    for k, (name, values) in enumerate(kept.items()):
        sheet.write(2, k, name)
        sheet.write_column(3, k, [None if v != v else v for v in values.tolist()])
    book.close()


def _tdms(path: Path, kept: Signals) -> None:
    """Write one segment as National Instruments describes it ("TDMS File Format Internal")."""

    def text(word: str) -> bytes:
        return struct.pack("<I", len(word.encode())) + word.encode()

    def double(name: str, value: float) -> bytes:
        return text(name) + struct.pack("<Id", 10, value)

    units = {name: _UNITS.get(name, "") for name in kept if name != "time"}
    meta = struct.pack("<I", 2 + len(units))
    for name in ("/", "/'Bench'"):
        meta += text(name) + struct.pack("<II", 0xFFFFFFFF, 0)
    for name, unit in units.items():
        meta += text(f"/'Bench'/'{name}'") + struct.pack("<IIIQI", 20, 10, 1, len(kept[name]), 3)
        meta += double("wf_increment", 1.0 / _RATE_HZ) + double("wf_start_offset", 0.0)
        meta += text("unit_string") + struct.pack("<I", 0x20) + text(unit)
    data = b"".join(kept[name].astype("<f8").tobytes() for name in units)
    lead = b"TDSm" + struct.pack("<IIQQ", 0b1110, 4713, len(meta) + len(data), len(meta))
    path.write_bytes(lead + meta + data)


def _mdf(path: Path, kept: Signals) -> None:
    asammdf: Any = importlib.import_module("asammdf")
    units = {name: _UNITS.get(name, "") for name in kept if name != "time"}
    made = [
        asammdf.Signal(kept[name], kept["time"], unit=unit, name=name)
        for name, unit in units.items()
    ]
    file = asammdf.MDF(version="4.10")
    file.append(made)
    file.append([asammdf.Signal(kept["speed"][::4], kept["time"][::4], name="slow")])
    buffer = io.BytesIO()
    file.save(buffer, overwrite=True)
    file.close()
    path.write_bytes(buffer.getvalue())


def _joint_state(kept: Signals, k: int, *, ros2: bool) -> tuple[int, bytes]:
    """Return the time, ns, and the bytes of one sensor_msgs/JointState of two joints."""
    nanoseconds = round(1e9 * float(kept["time"][k])) + 1_700_000_000 * 10**9
    velocity = float(kept["speed"][k]) * np.pi / 30.0
    out = bytearray()

    def put(code: str, *values: float) -> None:
        size = struct.calcsize(f"<{code[0]}")
        if ros2:
            out.extend(b"\0" * (-len(out) % size))
        out.extend(struct.pack(f"<{code}", *values))

    def text(word: str) -> None:
        raw = word.encode() + (b"\0" if ros2 else b"")
        put("I", len(raw))
        out.extend(raw)

    if not ros2:
        put("I", k)
    put("I", nanoseconds // 10**9)
    put("I", nanoseconds % 10**9)
    text("base")
    put("I", 2)
    text("elbow")
    text("wrist")
    position = 52.0 * float(kept["time"][k])
    for pair in ((position, 0.0), (velocity, 0.0), (float(kept["torque"][k]), 0.0)):
        put("I", 2)
        put("dd", *pair)
    return nanoseconds, (b"\0\1\0\0" if ros2 else b"") + bytes(out)


def _db3(path: Path, kept: Signals) -> None:
    """Write the tables of a bag of ROS 2, as the older ones without definitions have them."""
    path.unlink(missing_ok=True)
    base = sqlite3.connect(path)
    base.executescript(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
        "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);"
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
        "timestamp INTEGER NOT NULL, data BLOB NOT NULL);"
    )
    row = (1, "/joint_states", "sensor_msgs/msg/JointState", "cdr", "")
    base.execute("INSERT INTO topics VALUES (?, ?, ?, ?, ?)", row)
    for k in range(len(kept["time"])):
        message = (k + 1, 1, *_joint_state(kept, k, ros2=True))
        base.execute("INSERT INTO messages VALUES (?, ?, ?, ?)", message)
    base.commit()
    base.close()


_DEFINITION = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def _mcap(path: Path, kept: Signals) -> None:
    writer_of: Any = importlib.import_module("mcap.writer")
    with path.open("wb") as file:
        writer = writer_of.Writer(file)
        writer.start(profile="ros2", library="")
        schema = writer.register_schema(
            name="sensor_msgs/msg/JointState", encoding="ros2msg", data=_DEFINITION.encode()
        )
        channel = writer.register_channel(
            topic="/joint_states", message_encoding="cdr", schema_id=schema
        )
        for k in range(len(kept["time"])):
            at, data = _joint_state(kept, k, ros2=True)
            writer.add_message(channel_id=channel, log_time=at, data=data, publish_time=at)
        writer.finish()


def _ros1(path: Path, kept: Signals) -> None:
    path.unlink(missing_ok=True)
    rosbag1: Any = importlib.import_module("rosbags.rosbag1")
    typesys: Any = importlib.import_module("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
    with rosbag1.Writer(path) as writer:
        name = "sensor_msgs/msg/JointState"
        connection = writer.add_connection("/joint_states", name, typestore=store)
        for k in range(len(kept["time"])):
            at, data = _joint_state(kept, k, ros2=False)
            writer.write(connection, at, data)


# ending, libraries that read and write it, writer
SAMPLES: dict[str, tuple[str, tuple[str, ...], Callable[[Path, Signals], None]]] = {
    "text": (".csv", (), _text),
    "gz": (".csv.gz", (), _gz),
    "json": (".json", (), _json),
    "npz": (".npz", (), _npz),
    "npy": (".npy", (), _npy),
    "mat5": (".mat", (), _mat5),
    "mat73": (".mat", ("h5py",), _mat73),
    "hdf5": (".h5", ("h5py", "netCDF4"), _hdf5),
    "parquet": (".parquet", ("pyarrow", "polars"), _parquet),
    "excel": (".xlsx", ("openpyxl", "xlsxwriter"), _excel),
    "tdms": (".tdms", ("nptdms",), _tdms),
    "mdf": (".mf4", ("asammdf",), _mdf),
    "db3": (".db3", ("rosbags",), _db3),
    "mcap": (".mcap", ("rosbags", "mcap"), _mcap),
    "ros1": (".bag", ("rosbags",), _ros1),
}


def write_sample(form: str, folder: Path, kept: Signals | None = None) -> Path:
    """Write one sample and return its path; `kept` has what `signals` gives, and perhaps more."""
    ending, _, writer = SAMPLES[form]
    path = folder / f"sample{ending}"
    writer(path, signals() if kept is None else kept)
    return path
