"""Many inputs on dask.distributed: workers that may die, a journal, one table."""

from __future__ import annotations

from hdbench.batch.folder import BatchFolder, read_table, summary_of
from hdbench.batch.inputs import Input, content_of, expand_inputs, stamps_of
from hdbench.batch.workers import Outcome, Workers, run_tasks

__all__ = [
    "BatchFolder",
    "Input",
    "Outcome",
    "Workers",
    "content_of",
    "expand_inputs",
    "read_table",
    "run_tasks",
    "stamps_of",
    "summary_of",
]
