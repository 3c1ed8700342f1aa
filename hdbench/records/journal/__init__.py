"""Journal of a run: the file, the samples that count, the readings that count."""

from __future__ import annotations

from hdbench.records.journal.counted import (
    JournalSamples,
    JournalSummary,
    SampleGroup,
    all_samples,
    journal_loads,
    reading_entries,
    summarize_journal,
    survey_samples,
    write_sequence,
)
from hdbench.records.journal.file import (
    JournalBlock,
    JournalContent,
    JournalReader,
    JournalWriter,
    read_journal,
)

__all__ = [
    "JournalBlock",
    "JournalContent",
    "JournalReader",
    "JournalSamples",
    "JournalSummary",
    "JournalWriter",
    "SampleGroup",
    "all_samples",
    "journal_loads",
    "read_journal",
    "reading_entries",
    "summarize_journal",
    "survey_samples",
    "write_sequence",
]
