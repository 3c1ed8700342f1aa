"""Journal of a run: the file, the samples that count, the readings that count."""

from __future__ import annotations

from hdbench.records.journal.file import (
    JournalBlock,
    JournalContent,
    JournalReader,
    JournalWriter,
    read_journal,
)
from hdbench.records.journal.readings import journal_loads, reading_entries, write_sequence
from hdbench.records.journal.samples import (
    JournalSamples,
    JournalSummary,
    SampleGroup,
    all_samples,
    summarize_journal,
    survey_samples,
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
