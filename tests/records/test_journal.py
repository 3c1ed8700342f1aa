"""Journal: keeps every synced block, cuts a torn end, reports damage, gives its samples back."""

import itertools
import os
import random
import signal
import subprocess

import numpy as np
import pytest
from forked import forked
from hypothesis import given, settings
from hypothesis import strategies as st

from hdbench.errors import BusyError, DataError, StorageError
from hdbench.records import read_trace, write_trace
from hdbench.records.counted import all_samples, reading_entries, survey_samples
from hdbench.records.journal import JournalWriter, read_journal


@pytest.fixture
def path(tmp_path):
    return tmp_path / "j"


def written(path, entries):
    """Write a journal of kinds, columns and further keys; return its bytes."""
    with JournalWriter(path) as journal:
        for entry in entries:
            journal.append(*entry)
    return path.read_bytes()


def samples(start, n=7, **more):
    """Return a block of samples at 1 kHz."""
    time_s = 1e-3 * np.arange(start, start + n)
    return "samples", {"time_s": time_s, "torque_v": np.sin(time_s), "tacho_v": time_s}, more


def blocks(n):
    return [samples(7 * k, lost=0) for k in range(n)]


def event(name, **more):
    return "event", {}, {"event": name, **more}


def reading(volts, **more):
    return "reading", {}, {"reading_v": volts, **more}


def test_what_was_appended_comes_back_with_its_types(path):
    flags = {"flag": np.array([True, False])}
    numbers = {"a": np.array([0.1, np.nan]), "b": np.array([-(2**62), 3])}
    told = {"experiment": "x", "torque_nm": 1.5}
    written(path, [("samples", numbers), ("reading", {}, told), ("event", flags, {})])
    first, second, third = read_journal(path).blocks
    assert first.columns["a"].dtype == np.float64
    assert np.array_equal(first.columns["a"], [0.1, np.nan], equal_nan=True)
    assert first.columns["b"].tolist() == [-(2**62), 3]
    assert (second.kind, second.extra) == ("reading", told)
    assert third.columns["flag"].tolist() == [1, 0]


def test_a_tail_torn_at_any_byte_is_cut_and_nothing_else(path):
    whole = written(path, blocks(3))
    # blocks of one length each
    before = len(whole) * 2 // 3
    for end in range(before, len(whole)):
        path.write_bytes(whole[:end])
        content = read_journal(path)
        assert (len(content.blocks), content.torn_bytes) == (2, end - before)
        assert content.problem is None


def test_zeroed_sectors_at_the_end_are_cut_like_a_torn_block(path):
    path.write_bytes(written(path, blocks(3)) + b"\0" * 512)
    content = read_journal(path)
    assert (len(content.blocks), content.torn_bytes, content.problem) == (3, 512, None)


def test_a_flipped_bit_in_the_middle_is_reported_and_costs_one_block(path):
    raw = bytearray(written(path, blocks(4)))
    size = len(raw) // 4
    for place in range(size, 2 * size):
        raw[place] ^= 0x10
        path.write_bytes(raw)
        raw[place] ^= 0x10
        content = read_journal(path)
        assert [block.sequence for block in content.blocks] == [0, 2, 3]
        assert "damaged" in content.problem


def test_random_damage_never_invents_a_block(path):
    whole = written(path, blocks(6))
    good = {b.sequence: b.columns["time_s"].tobytes() for b in read_journal(path).blocks}
    rng = random.Random(3)
    for _ in range(300):
        raw = bytearray(whole)
        for _ in range(rng.randint(1, 8)):
            start = rng.randrange(len(raw))
            raw[start : start + rng.randint(0, 20)] = rng.randbytes(rng.randint(0, 20))
        path.write_bytes(raw)
        try:
            found = read_journal(path).blocks
        except DataError:
            continue
        assert all(good[block.sequence] == block.columns["time_s"].tobytes() for block in found)


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    """Return a file to damage, and a whole journal of four samples."""
    path = tmp_path_factory.mktemp("journal") / "hostile.hdj"
    return path, written(path, [samples(k, 1) for k in range(4)])


@settings(max_examples=60)
@given(data=st.data())
def test_both_ways_of_reading_find_the_same_in_a_damaged_file(hostile, data):
    path, whole = hostile
    raw = bytearray(whole)
    for at, value in data.draw(
        st.lists(st.tuples(st.integers(0, len(raw) - 1), st.integers(0, 255)), max_size=4)
    ):
        raw[at] = value
    path.write_bytes(raw[: data.draw(st.integers(0, len(raw)))])
    try:
        found = read_journal(path)
    except DataError as error:
        told = (error.what, error.where, error.fix)
        assert all(told)
        return
    samples = [block for block in found.blocks if block.kind == "samples"]
    assert len(survey_samples(path)) == sum(len(b.columns["time_s"]) for b in samples)


@pytest.mark.parametrize("raw", [b"something else altogether", b"HDJX" * 100])
def test_a_file_that_is_no_journal_is_refused(path, raw):
    path.write_bytes(raw)
    with pytest.raises(DataError, match="not a journal"):
        read_journal(path)


def test_an_empty_journal_holds_nothing(path):
    path.write_bytes(b"")
    assert read_journal(path).blocks == ()


def test_a_journal_is_never_overwritten(path):
    written(path, blocks(4))
    with pytest.raises(StorageError):
        JournalWriter(path)


def test_nothing_is_appended_after_a_failed_sync(path, monkeypatch):
    journal = JournalWriter(path)
    journal.append("event", {}, {"k": 0})

    def fail(_handle):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "fdatasync", fail)
    with pytest.raises(StorageError):
        journal.append("event", {}, {"k": 1})
    monkeypatch.undo()
    with pytest.raises(StorageError, match="closed"):
        journal.append("event", {}, {"k": 2})
    assert read_journal(path).blocks[0].extra == {"k": 0}


def write_until_full(path):
    import resource

    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
    journal = JournalWriter(path)
    for done in itertools.count():
        try:
            journal.append("samples", {"a": np.arange(100.0) + done})
        except StorageError as error:
            os.write(1, b"%d %d" % (done, error.exit_code))
            return


@pytest.mark.skipif(os.name != "posix", reason="file size limit")
def test_a_full_disk_keeps_every_acknowledged_block(path):
    process = forked(lambda: write_until_full(path), stdout=subprocess.PIPE, text=True)
    done, code = map(int, process.communicate()[0].split())
    content = read_journal(path)
    assert code == 7
    assert done > 10
    assert len(content.blocks) == done
    assert content.torn_bytes > 0


# -- readings that were taken again: the last one counts, the others stay


def test_a_reopened_point_counts_with_its_last_reading(path):
    story = [
        reading(0.1, point=1),
        reading(0.2, point=2),
        event("reopened", point=2, why="back"),
        reading(0.3, point=2),
        reading(0.4, point=2),
        event("reopened", point=1, why="repeat"),
        event("reopened", point=9, why="repeat"),
    ]
    written(path, story)
    found = [(e.entry["reading_v"], e.superseded) for e in reading_entries(read_journal(path))]
    assert found == [(0.1, "repeat"), (0.2, "back"), (0.3, "repeat"), (0.4, None)]


def test_readings_without_a_point_all_count(path):
    written(path, [reading(0.1), reading(0.1)])
    assert [e.superseded for e in reading_entries(read_journal(path))] == [None, None]


def test_a_broken_off_acquisition_counts_until_it_is_taken_again(tmp_path):
    first = [
        event("acquisition", step=1, attempt=1),
        samples(0, part=1),
        event("acquired", step=1),
        event("acquisition", step=2, attempt=1),
        samples(10, part=2),
    ]
    second = [*first, event("acquisition", step=2, attempt=2)]
    third = [*second, samples(20, part=3), event("acquired", step=2)]
    for number, (entries, counts) in enumerate(
        ((first, [1, 2]), (second, [1, 2]), (third, [1, 3]))
    ):
        path = tmp_path / str(number)
        written(path, entries)
        for source in (path, read_journal(path)):
            found = survey_samples(source)
            assert [block.extra["part"] for block in found.blocks()] == counts
            assert len(found.trace("here")) == 7 * len(counts)
    groups = all_samples(tmp_path / "2").groups
    assert [(g.step, g.attempt, g.complete, g.superseded) for g in groups] == [
        (1, 1, True, False),
        (2, 1, False, True),
        (2, 2, True, False),
    ]


def test_a_resumed_journal_goes_on_behind_the_last_whole_block(path):
    whole = written(path, [reading(0.1, point=1), reading(0.2, point=2)])
    for cut in (0, 1, 20, 60):
        path.write_bytes(whole[: len(whole) - cut])
        writer, content = JournalWriter.resume(path)
        kept = 2 if cut == 0 else 1
        assert len(content.blocks) == kept
        writer.append(*reading(0.3, point=3))
        with pytest.raises(BusyError, match="another process records this run"):
            JournalWriter.resume(path)
        writer.close()
        after = read_journal(path)
        assert (len(after.blocks), after.torn_bytes, after.problem) == (kept + 1, 0, None)
        assert after.blocks[-1].extra["point"] == 3


def test_a_damaged_middle_is_told_and_does_not_stop_a_resumed_journal(path):
    raw = bytearray(written(path, [reading(0.1 * k, point=k) for k in range(1, 5)]))
    raw[len(raw) // 2] ^= 0xFF
    path.write_bytes(raw)
    writer, content = JournalWriter.resume(path)
    writer.append(*reading(0.5, point=5))
    writer.close()
    assert content.problem is not None
    found = [e.entry["point"] for e in reading_entries(read_journal(path))]
    assert found[-1] == 5
    assert len(found) == 4


# -- the trace that is written block by block is the one that is read at once


@pytest.mark.parametrize("attempts", [False, True])
def test_both_ways_give_the_same_file(path, tmp_path, attempts):
    entries = blocks(9)
    for number in (6, 3, 0) if attempts else ():
        entries.insert(number, event("acquisition", step=1, attempt=number))
    written(path, entries)
    whole = survey_samples(read_journal(path)).trace("whole")
    write_trace(tmp_path / "whole.csv", whole)
    found = survey_samples(path)
    found.write(tmp_path / "streamed.csv")
    assert (tmp_path / "streamed.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()
    assert len(found) == len(whole) == (21 if attempts else 63)
    again = found.trace("again")
    assert all(np.array_equal(again[name], whole[name]) for name in whole.columns)


def test_a_torn_end_is_left_out_and_damage_in_the_middle_costs_its_block_alone(path, tmp_path):
    raw = bytearray(written(path, blocks(9)))
    raw[4 * (len(raw) // 9) + 40] ^= 0xFF
    path.write_bytes(raw[:-5])
    found = survey_samples(path)
    assert len(found) == 7 * 7
    assert len(found) == len(survey_samples(read_journal(path)))
    found.write(tmp_path / "trace.csv")
    assert len(read_trace(tmp_path / "trace.csv", require=())) == 49


def test_a_time_that_goes_back_is_refused_across_blocks(path, tmp_path):
    written(path, [samples(100), samples(0)])
    with pytest.raises(DataError, match="does not increase"):
        survey_samples(path).write(tmp_path / "trace.csv")
    assert not (tmp_path / "trace.csv").exists()
