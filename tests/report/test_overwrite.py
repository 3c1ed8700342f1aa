"""A report replaces reports, and nothing else."""

import pytest
from swinging_shaft import record

from hdbench.errors import UsageError
from hdbench.profile import load_profile
from hdbench.records import write_trace
from hdbench.report import write_report
from hdbench.report.pagefiles import refuse_foreign


@pytest.fixture
def trace(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    write_trace(folder / "trace.csv", record(n=2000))
    return folder / "trace.csv"


@pytest.mark.parametrize("ending", [".csv", ".json", ".html"])
def test_a_file_of_somebody_else_is_left_as_it_is(tmp_path, trace, ending):
    mine = tmp_path / f"bench{ending}"
    mine.write_text("time_s,torque_nm\n0,1\n")
    with pytest.raises(UsageError) as caught:
        write_report([trace], tmp_path / "bench.html", profile=load_profile("cim-tr-97-06"))
    assert str(mine) in caught.value.where
    assert mine.read_text() == "time_s,torque_nm\n0,1\n"
    assert [file.name for file in tmp_path.iterdir() if file.is_file()] == [mine.name]


def test_a_report_is_written_again_over_itself(tmp_path, trace):
    profile = load_profile("cim-tr-97-06")
    first = write_report([trace], tmp_path / "bench.html", profile=profile)
    before = {file: file.read_bytes() for file in (first.html, first.csv, first.json)}
    write_report([trace], tmp_path / "bench.html", profile=profile)
    assert {file: file.read_bytes() for file in before} == before


def test_what_is_not_there_or_empty_may_be_written(tmp_path):
    (tmp_path / "a.csv").touch()
    refuse_foreign([tmp_path / "a.csv", tmp_path / "b.json"])
