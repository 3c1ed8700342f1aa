"""Readings that were taken again: the last one counts, the others stay."""

from pathlib import Path

import numpy as np
import pytest

from hdbench.errors import BusyError
from hdbench.records.counted import all_samples, reading_entries, survey_samples
from hdbench.records.journal import JournalWriter, read_journal


def journal(path: Path, *entries: tuple) -> Path:
    with JournalWriter(path) as writer:
        for kind, body in entries:
            columns = {"time_s": np.full(3, float(body.get("n", 0)))} if kind == "samples" else {}
            writer.append(kind, columns, body)
    return path


def reading(point: int | None, volts: float) -> tuple:
    body = {"reading_v": volts}
    return "reading", body if point is None else {**body, "point": point}


def event(name: str, **body) -> tuple:
    return "event", {"event": name, **body}


def test_a_reopened_point_counts_with_its_last_reading(tmp_path):
    path = journal(
        tmp_path / "j",
        reading(1, 0.1),
        reading(2, 0.2),
        event("reopened", point=2, why="back"),
        reading(2, 0.3),
        reading(2, 0.4),
        event("reopened", point=1, why="repeat"),
        event("reopened", point=9, why="repeat"),
    )
    found = [(e.entry["reading_v"], e.superseded) for e in reading_entries(read_journal(path))]
    assert found == [(0.1, "repeat"), (0.2, "back"), (0.3, "repeat"), (0.4, None)]


def test_readings_without_a_point_all_count(tmp_path):
    path = journal(tmp_path / "j", reading(None, 0.1), reading(None, 0.1))
    assert [e.superseded for e in reading_entries(read_journal(path))] == [None, None]


def test_a_broken_off_acquisition_counts_until_it_is_taken_again(tmp_path):
    first = [
        event("acquisition", step=1, attempt=1),
        ("samples", {"n": 1}),
        event("acquired", step=1),
        event("acquisition", step=2, attempt=1),
        ("samples", {"n": 2}),
    ]
    second = [event("acquisition", step=2, attempt=2)]
    third = [("samples", {"n": 3}), event("acquired", step=2)]
    stories = ((first, [1, 2]), (first + second, [1, 2]), (first + second + third, [1, 3]))
    for number, (entries, counts) in enumerate(stories):
        path = journal(tmp_path / str(number), *entries)
        for source in (path, read_journal(path)):
            samples = survey_samples(source)
            assert [block.extra["n"] for block in samples.blocks()] == counts
            assert len(samples.trace("here")) == 3 * len(counts)
    groups = all_samples(tmp_path / "2").groups
    assert [(g.step, g.attempt, g.complete, g.superseded) for g in groups] == [
        (1, 1, True, False),
        (2, 1, False, True),
        (2, 2, True, False),
    ]


def test_a_resumed_journal_goes_on_behind_the_last_whole_block(tmp_path):
    path = journal(tmp_path / "j", reading(1, 0.1), reading(2, 0.2))
    whole = path.read_bytes()
    for cut in (0, 1, 20, 60):
        path.write_bytes(whole[: len(whole) - cut])
        writer, content = JournalWriter.resume(path)
        kept = 2 if cut == 0 else 1
        assert len(content.blocks) == kept
        writer.append("reading", {}, {"point": 3, "reading_v": 0.3})
        with pytest.raises(BusyError, match="another process records this run"):
            JournalWriter.resume(path)
        writer.close()
        after = read_journal(path)
        assert (len(after.blocks), after.torn_bytes, after.problem) == (kept + 1, 0, None)
        assert after.blocks[-1].extra["point"] == 3


def test_a_damaged_middle_is_told_and_does_not_stop_a_resumed_journal(tmp_path):
    path = journal(tmp_path / "j", *(reading(k, 0.1 * k) for k in range(1, 5)))
    raw = bytearray(path.read_bytes())
    raw[len(raw) // 2] ^= 0xFF
    path.write_bytes(raw)
    writer, content = JournalWriter.resume(path)
    writer.append("reading", {}, {"point": 5, "reading_v": 0.5})
    writer.close()
    assert content.problem is not None
    found = [e.entry["point"] for e in reading_entries(read_journal(path))]
    assert found[-1] == 5
    assert len(found) == 4
