"""Journal: keeps every synced block, cuts a torn end, reports damage."""

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

from hdbench.errors import DataError, StorageError
from hdbench.records.counted import survey_samples
from hdbench.records.journal import JournalWriter, read_journal


def write(path, n=4):
    with JournalWriter(path) as journal:
        for k in range(n):
            columns = {"time_s": np.arange(2) + 2.0 * k, "encoder_count": np.arange(2) - 2**40}
            journal.append("samples", columns, {"first_index": 2 * k})


def test_what_was_appended_comes_back_with_its_types(tmp_path):
    path = tmp_path / "j"
    with JournalWriter(path) as journal:
        journal.append("samples", {"a": np.array([0.1, np.nan]), "b": np.array([-(2**62), 3])})
        journal.append("reading", {}, {"experiment": "x", "torque_nm": 1.5})
        journal.append("event", {"flag": np.array([True, False])}, {})
    first, second, third = read_journal(path).blocks
    assert first.columns["a"].dtype == np.float64
    assert np.array_equal(first.columns["a"], [0.1, np.nan], equal_nan=True)
    assert first.columns["b"].tolist() == [-(2**62), 3]
    assert (second.kind, second.extra) == ("reading", {"experiment": "x", "torque_nm": 1.5})
    assert third.columns["flag"].tolist() == [1, 0]


def test_a_tail_torn_at_any_byte_is_cut_and_nothing_else(tmp_path):
    path = tmp_path / "j"
    write(path, 3)
    whole = path.read_bytes()
    # blocks of one length each
    before = len(whole) * 2 // 3
    for end in range(before, len(whole)):
        path.write_bytes(whole[:end])
        content = read_journal(path)
        assert (len(content.blocks), content.torn_bytes) == (2, end - before)
        assert content.problem is None


def test_zeroed_sectors_at_the_end_are_cut_like_a_torn_block(tmp_path):
    path = tmp_path / "j"
    write(path, 3)
    path.write_bytes(path.read_bytes() + b"\0" * 512)
    content = read_journal(path)
    assert (len(content.blocks), content.torn_bytes, content.problem) == (3, 512, None)


def test_a_flipped_bit_in_the_middle_is_reported_and_costs_one_block(tmp_path):
    path = tmp_path / "j"
    write(path, 4)
    raw = bytearray(path.read_bytes())
    size = len(raw) // 4
    for place in range(size, 2 * size):
        raw[place] ^= 0x10
        path.write_bytes(raw)
        raw[place] ^= 0x10
        content = read_journal(path)
        assert [block.sequence for block in content.blocks] == [0, 2, 3]
        assert "damaged" in content.problem


def test_random_damage_never_invents_a_block(tmp_path):
    path = tmp_path / "j"
    write(path, 6)
    whole = path.read_bytes()
    good = {b.sequence: b.columns["time_s"].tobytes() for b in read_journal(path).blocks}
    rng = random.Random(3)
    for _ in range(300):
        raw = bytearray(whole)
        for _ in range(rng.randint(1, 8)):
            start = rng.randrange(len(raw))
            raw[start : start + rng.randint(0, 20)] = rng.randbytes(rng.randint(0, 20))
        path.write_bytes(raw)
        try:
            blocks = read_journal(path).blocks
        except DataError:
            continue
        assert all(good[block.sequence] == block.columns["time_s"].tobytes() for block in blocks)


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    """Return a file to damage, and a whole journal of four samples."""
    path = tmp_path_factory.mktemp("journal") / "hostile.hdj"
    with JournalWriter(path) as writer:
        for number in range(4):
            writer.append("samples", {"time_s": [float(number)], "torque_v": [1.0]})
    return path, path.read_bytes()


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
def test_a_file_that_is_no_journal_is_refused(tmp_path, raw):
    path = tmp_path / "j"
    path.write_bytes(raw)
    with pytest.raises(DataError, match="not a journal"):
        read_journal(path)


def test_an_empty_journal_holds_nothing(tmp_path):
    path = tmp_path / "j"
    path.write_bytes(b"")
    assert read_journal(path).blocks == ()


def test_a_journal_is_never_overwritten(tmp_path):
    write(tmp_path / "j")
    with pytest.raises(StorageError):
        JournalWriter(tmp_path / "j")


def test_nothing_is_appended_after_a_failed_sync(tmp_path, monkeypatch):
    journal = JournalWriter(tmp_path / "j")
    journal.append("event", {}, {"k": 0})

    def fail(_handle):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "fdatasync", fail)
    with pytest.raises(StorageError):
        journal.append("event", {}, {"k": 1})
    monkeypatch.undo()
    with pytest.raises(StorageError, match="closed"):
        journal.append("event", {}, {"k": 2})
    assert read_journal(tmp_path / "j").blocks[0].extra == {"k": 0}


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
def test_a_full_disk_keeps_every_acknowledged_block(tmp_path):
    path = tmp_path / "j"
    process = forked(lambda: write_until_full(path), stdout=subprocess.PIPE, text=True)
    done, code = map(int, process.communicate()[0].split())
    content = read_journal(path)
    assert code == 7
    assert done > 10
    assert len(content.blocks) == done
    assert content.torn_bytes > 0
