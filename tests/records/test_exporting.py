"""Exported records equal the originals, read back by the programs' own libraries."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from runkit import write_run

from hdbench.errors import DataError, UsageError
from hdbench.profile import load_profile
from hdbench.records.exporting import FORMATS, export_records, gather
from hdbench.records.trace import unit_of_column
from hdbench_cli.options import declared

ARM = load_profile("cim-tr-97-06").data.arm


@pytest.fixture
def trace_file(tmp_path: Path) -> Path:
    file = tmp_path / "log.csv"
    head = "time_s,motor_velocity_rad_s,torque_nm,own column\n"
    file.write_text(head + "0,100.25,1.5,7\n0.001,100.5,,8\n")
    return file


@pytest.fixture
def loads_file(tmp_path: Path) -> Path:
    file = tmp_path / "loads.csv"
    file.write_text(
        "experiment,position_rad,range,direction,series,torque_nm,reading_v,settled\n"
        "e1,0.5,full,cw,up,4.9,0.7424,true\n"
        "e1,0.5,full,cw,down,0,0.0011,false\n"
    )
    return file


def test_parquet_holds_numbers_units_and_origin(trace_file, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    out = export_records(gather(trace_file, ARM), tmp_path / "out", "parquet")
    table = parquet.read_table(out)
    assert out.name == "trace.parquet"
    np.testing.assert_array_equal(table["motor_velocity_rad_s"].to_numpy(), [100.25, 100.5])
    np.testing.assert_array_equal(table["torque_nm"].to_numpy(), [1.5, np.nan])
    assert table.schema.field("torque_nm").metadata == {b"unit": b"N m"}
    assert table.schema.metadata[b"source"].decode() == str(trace_file)
    assert table["own column"].to_pylist() == [7.0, 8.0]


def test_hdf5_holds_numbers_units_and_words(loads_file, tmp_path):
    h5py = pytest.importorskip("h5py")
    out = export_records(gather(loads_file, ARM), tmp_path, "hdf5")
    with h5py.File(out) as file:
        assert file["loads/reading_v"][:].tolist() == [0.7424, 0.0011]
        assert file["loads/reading_v"].attrs["unit"] == "V"
        assert [word.decode() for word in file["loads/series"][:]] == ["up", "down"]
        assert [word.decode() for word in file["loads/settled"][:]] == ["true", "false"]
        assert "mass_kg" not in file["loads"]
        assert len(file.attrs["sha256"]) == 64


def test_mat_holds_a_structure_of_columns(trace_file, tmp_path):
    from scipy.io import loadmat

    trace_file.write_text(trace_file.read_text().replace("own column", "own_column"))
    out = export_records(gather(trace_file, ARM), tmp_path, "mat")
    body = loadmat(out, simplify_cells=True)
    np.testing.assert_array_equal(body["trace"]["torque_nm"], [1.5, np.nan])
    assert body["units"]["motor_velocity_rad_s"] == "rad/s"
    assert body["about"]["source"] == str(trace_file)


def test_a_name_that_matlab_cannot_hold_is_told(trace_file, tmp_path):
    with pytest.raises(DataError, match="own column"):
        export_records(gather(trace_file, ARM), tmp_path / "out", "mat")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("kind", sorted(FORMATS))
def test_a_run_takes_its_profile_and_result_along(kind, tmp_path):
    profile = {"name": "p", "sha256": "0" * 64, "text": "x" * 100_000}
    run = write_run(tmp_path / "run", "ripple", {"ripple": []}, profile=profile)
    (run / "trace.csv").write_text("time_s,tacho_v,torque_nm\n0,1,1\n0.001,1,2\n")
    content = gather(run, ARM)
    assert content.attributes["run_id"] == "run"
    assert len(content.attributes["profile_toml"]) == 100_000
    assert json.loads(content.attributes["result_json"])["ripple"] == []
    pytest.importorskip({"parquet": "pyarrow", "hdf5": "h5py", "mat": "scipy"}[kind])
    out = export_records(content, tmp_path / "out", kind)
    assert out.stat().st_size > 0


def test_a_library_that_is_missing_is_named_with_its_extra(trace_file, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(UsageError) as found:
        export_records(gather(trace_file, ARM), tmp_path, "hdf5")
    assert "hdbench[hdf5]" in found.value.fix


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        *(("time_s", "s"), ("temperature_c", "degC"), ("encoder_count", "1"), ("stage", "")),
        *(("motor_velocity_rad_s", "rad/s"), ("motor_acceleration_rad_s2", "rad/s^2")),
    ],
)
def test_units_are_read_off_the_names(name, unit):
    assert unit_of_column(name) == unit


def test_the_command_offers_every_form_and_names_what_it_wrote(trace_file, tmp_path, answer):
    # the names stand in options.toml as well, so that the help imports nothing of the library
    assert set(declared("options")["export"]["kind"]["choices"]) == set(FORMATS)
    second = trace_file.with_name("other.csv")
    second.write_text(trace_file.read_text().replace("own column", "own_column"))
    words = (trace_file, second, "--format", "parquet", "--out", tmp_path / "out")
    rows = answer("export", *words)["exported"]
    made = [tmp_path / "out" / name / "trace.parquet" for name in ("log", "other")]
    assert [row["file"] for row in rows] == [*map(str, made)]
    assert rows[0]["columns"]["torque_nm"] == "N m"


@pytest.mark.parametrize("words", [["--out", "x"], ["--format", "mat", "--out", "x"]])
def test_a_call_that_asks_for_nothing_is_told_what_to_ask(words, hdbench):
    hdbench("export", *words, code=2)
