"""A Parquet trace is read as its CSV is, and runs keep one beside the CSV on request."""

import json
from pathlib import Path

import numpy as np
import pytest
from swinging_shaft import record

from hdbench.errors import DataError
from hdbench.records import read_trace, write_trace
from hdbench.records.csvtext import read_header
from hdbench.records.exporting import export_records, gather
from hdbench.records.parquetfile import parquet_names
from hdbench.records.storage import sha256_file

parquet = pytest.importorskip("pyarrow.parquet")
arrow = pytest.importorskip("pyarrow")


def stored(tmp_path: Path, n: int = 3000, *, lost: bool = False) -> Path:
    """Write a trace of a shaft that turns to and fro."""
    trace = record(motion=(0.0, 150.0, 4.0), n=n, period_s=2e-3, noise_nm=0.01, seed=3)
    if lost:
        trace["torque_nm"][7] = np.nan
    write_trace(tmp_path / "trace.csv", trace)
    return tmp_path / "trace.csv"


def test_the_same_bits_come_back_from_parquet(tmp_path):
    source = stored(tmp_path, lost=True)
    made = export_records(gather(source, None), tmp_path / "out", "parquet")
    first, second = read_trace(source), read_trace(made)
    assert tuple(first.columns) == tuple(second.columns) == parquet_names(made)
    assert read_header(made) == read_header(source)
    for name in first.columns:
        assert np.array_equal(first[name], second[name], equal_nan=True)


@pytest.mark.parametrize(
    ("columns", "word"),
    [
        ({"time_s": [0.0, 0.0], "torque_nm": [1.0, 2.0]}, "strictly increasing"),
        ({"time_s": [0.0, 1.0], "torque_nm": [1.0, float("inf")]}, "infinite"),
        ({"time_s": [0.0, 1.0], "speed": [1.0, 2.0]}, "torque_nm"),
        ({"time_s": [0.0, 1.0], "torque_nm": [[1.0], [2.0]]}, "needed: numbers"),
        ({"time_s": [], "torque_nm": []}, "0 rows"),
    ],
)
def test_what_a_csv_may_not_hold_a_parquet_file_may_not(tmp_path, columns, word):
    file = tmp_path / "bad.parquet"
    parquet.write_table(arrow.table(columns), file)
    with pytest.raises(DataError) as caught:
        read_trace(file, require=("torque",))
    assert word in caught.value.what


def test_a_file_that_is_no_parquet_is_told(tmp_path):
    file = tmp_path / "bad.parquet"
    file.write_text("time_s,torque_nm\n0,1\n")
    with pytest.raises(DataError) as caught:
        read_trace(file)
    assert caught.value.where == str(file)
    with pytest.raises(DataError):
        read_trace(tmp_path / "missing.parquet")


def test_a_run_keeps_parquet_beside_its_csv_and_takes_it_as_input(tmp_path, hdbench, answer):
    source = stored(tmp_path)
    out = ("--no-report", "--out", tmp_path / "runs")
    first = answer("run-ripple", "--from", source, "--format", "parquet", *out)
    folder = Path(first["run_folder"])
    manifest = json.loads((folder / "run.json").read_text())
    assert manifest["files"]["trace.parquet"] == sha256_file(folder / "trace.parquet")
    hdbench("runs", "verify", folder)
    again = answer("run-ripple", "--from", folder / "trace.parquet", *out)
    assert again["ripple"] == first["ripple"]
