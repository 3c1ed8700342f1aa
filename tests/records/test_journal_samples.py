"""The trace that is written block by block is the one that is read at once."""

import numpy as np
import pytest

from hdbench.errors import DataError
from hdbench.records import read_trace, write_trace
from hdbench.records.counted import survey_samples
from hdbench.records.journal import JournalWriter, read_journal


def block(start, n=7):
    time_s = 1e-3 * np.arange(start, start + n)
    return {"time_s": time_s, "torque_v": np.sin(time_s), "tacho_v": np.cos(time_s)}


def write(path, *, attempts=False, n_blocks=9):
    with JournalWriter(path) as journal:
        for number in range(n_blocks):
            if attempts and number % 3 == 0:
                journal.append("event", {}, {"event": "acquisition", "step": 1, "attempt": number})
            journal.append("samples", block(7 * number), {"lost": 0})


@pytest.mark.parametrize("attempts", [False, True])
def test_both_ways_give_the_same_file(tmp_path, attempts):
    path = tmp_path / "journal.hdj"
    write(path, attempts=attempts)
    whole = survey_samples(read_journal(path)).trace("whole")
    write_trace(tmp_path / "whole.csv", whole)
    found = survey_samples(path)
    found.write(tmp_path / "streamed.csv")
    assert (tmp_path / "streamed.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()
    assert len(found) == len(whole) == (21 if attempts else 63)
    again = found.trace("again")
    assert all(np.array_equal(again[name], whole[name]) for name in whole.columns)


def test_a_torn_end_is_left_out_and_damage_in_the_middle_costs_its_block_alone(tmp_path):
    path = tmp_path / "journal.hdj"
    write(path)
    raw = bytearray(path.read_bytes())
    size = len(raw) // 9
    raw[4 * size + 40] ^= 0xFF
    path.write_bytes(raw[:-5])
    found = survey_samples(path)
    assert len(found) == 7 * 7
    assert len(found) == len(survey_samples(read_journal(path)))
    found.write(tmp_path / "trace.csv")
    assert len(read_trace(tmp_path / "trace.csv", require=())) == 49


def test_a_time_that_goes_back_is_refused_across_blocks(tmp_path):
    path = tmp_path / "journal.hdj"
    with JournalWriter(path) as journal:
        journal.append("samples", block(100))
        journal.append("samples", block(0))
    with pytest.raises(DataError, match="does not increase"):
        survey_samples(path).write(tmp_path / "trace.csv")
    assert not (tmp_path / "trace.csv").exists()
