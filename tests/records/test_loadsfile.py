"""Loads: torque by arm and weight, domains checked, read back as written."""

import pytest

from hdbench.errors import DataError
from hdbench.profile import load_profile
from hdbench.records import LoadReading, Loads, is_loads_file, read_loads
from hdbench.records.loads import write_loads

HEAD = "experiment,position_rad,range,direction,series,torque_nm,reading_v,n_samples\n"
ROW = "a,0.5,full,cw,up,9.8,1.48,100\n"


def put(tmp_path, text):
    path = tmp_path / "loads.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_mass_becomes_weight_times_arm_with_the_sign_of_its_direction(tmp_path):
    text = "experiment,position_rad,range,direction,series,mass_kg,reading_v\n"
    path = put(tmp_path, text + "a,0,full,cw,up,4,2.97\nb,0,full,ccw,down,4,-2.97\n")
    arm = load_profile("cim-tr-97-06").data.arm
    torques = [reading.torque_nm for reading in read_loads(path, arm).readings]
    # 4 kg at 0.5 m and 9.8065 m/s^2
    assert torques == pytest.approx([19.613, -19.613], rel=1e-12, abs=0)
    with pytest.raises(DataError, match="without an arm"):
        read_loads(path, None)


def test_loads_come_back_as_written(tmp_path):
    readings = (
        LoadReading("a,b", 0.1, "low", "cw", "up", 1 / 3, 2 / 3, reading_std_v=1e-5, n_samples=7),
        LoadReading("c", -0.1, "full", "ccw", "down", -1e-300, 0.0, mass_kg=0.1, time_s=3.0),
    )
    loads = Loads(readings, extra_columns={"note": ("x", 'say "y"')})
    path = tmp_path / "out.csv"
    write_loads(path, loads)
    back = read_loads(path, None)
    assert back.readings == readings
    assert back.extra_columns == loads.extra_columns
    assert is_loads_file(path)


def test_a_trace_is_told_from_loads_by_its_columns(tmp_path):
    assert is_loads_file(put(tmp_path, HEAD + ROW))
    assert not is_loads_file(put(tmp_path, "time_s,torque_nm,tacho_v\n0,1,2\n"))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("full", "Full", ["'range'", "low or full"]),
        ("cw", "clockwise", ["'direction'", "cw or ccw"]),
        ("up", "", ["'series'", "up or down"]),
        *(("a,", ",", ["'experiment'"]), ("0.5", "x", ["'position_rad'"])),
        ("9.8", "nan", ["'torque_nm'", "finite"]),
        *(("1.48", wrong, ["'reading_v'", "finite"]) for wrong in ("", "inf")),
        *(("100", "0", ["'n_samples'", "at least 1"]), ("100", "1.5", ["'n_samples'", "whole"])),
    ],
)
def test_a_cell_out_of_its_domain_is_named_with_its_line(tmp_path, old, new, words):
    path = put(tmp_path, HEAD + ROW + ROW.replace(old, new, 1))
    with pytest.raises(DataError) as caught:
        read_loads(path, None)
    assert caught.value.where == f"{path}:3"
    for word in words:
        assert word in caught.value.what


@pytest.mark.parametrize("name", HEAD.strip().split(",")[:-1])
def test_a_missing_column_is_named(tmp_path, name):
    with pytest.raises(DataError, match=rf"\A.*: .*{name}"):
        read_loads(put(tmp_path, HEAD.replace(name, "other") + ROW), None)
