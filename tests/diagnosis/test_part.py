"""Part of a record that is diagnosed: a named one, or as much as one diagnosis takes."""

import json

import numpy as np
import pytest

from hdbench.diagnosis.run import part_of
from hdbench.errors import DataError
from hdbench.records import Trace


def trace(n: int = 100) -> Trace:
    time_s = 5.0 + 0.01 * np.arange(n)
    return Trace({"time_s": time_s, "torque_nm": np.arange(n, dtype=float)})


def test_a_whole_record_is_itself():
    whole = trace()
    assert part_of(whole) == (whole, None)
    assert part_of(whole, 0.0, 100.0) == (whole, None)


def test_both_ends_belong_to_the_part():
    held, part = part_of(trace(), 5.2, 5.4)
    assert held["torque_nm"].tolist() == list(range(20, 41))
    assert (part.from_s, part.to_s) == pytest.approx((5.2, 5.4))
    assert (part.samples, part.of_samples, part.cut) == (21, 100, False)


def test_a_long_record_is_cut_and_says_so():
    held, part = part_of(trace(), from_s=5.5, most=30)
    assert held["torque_nm"][[0, -1]].tolist() == [50.0, 79.0]
    assert part.cut


@pytest.mark.parametrize(("from_s", "to_s"), [(7.0, None), (None, 4.0), (5.4, 5.2)])
def test_an_empty_part_is_told_with_the_records_ends(from_s, to_s):
    with pytest.raises(DataError, match=r"runs from 5 to 5\.99 s"):
        part_of(trace(), from_s, to_s)


def test_loads_have_no_clock(tmp_path, hdbench):
    loads = tmp_path / "loads.csv"
    loads.write_text("experiment,direction,torque_nm,reading_v\n1,cw,1,0.1\n")
    words = ("diagnose", loads, "--from-s", "1", "--out", tmp_path, "--json")
    assert "no clock" in json.loads(hdbench(*words, code=2)[0])["error"]["what"]
