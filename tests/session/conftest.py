"""Make the fake bench importable beside the tests that use it; close their journals."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from forked import warm_emulators  # noqa: F401

from hdbench.records.journal import JournalWriter

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[2] / "tools")]


@pytest.fixture(autouse=True)
def no_journal_stays_open(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Close at the end of a test what the end of a process would."""
    made: list[JournalWriter] = []
    make = JournalWriter.__init__

    def noting(writer: JournalWriter, *words: object, **keys: object) -> None:
        made.append(writer)
        make(writer, *words, **keys)

    monkeypatch.setattr(JournalWriter, "__init__", noting)
    yield
    for writer in made:
        writer._abandon()
