"""Emulators are forks; no journal stays open."""

from collections.abc import Iterator

import pytest
from forked import warm_emulators  # noqa: F401

from hdbench.records.journal import JournalWriter


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
