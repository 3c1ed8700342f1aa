"""Plain records and every read and write of them."""

from __future__ import annotations

from hdbench.records.journal import JournalBlock, JournalContent, JournalWriter, read_journal
from hdbench.records.jsonfile import (
    ProfileIdentity,
    dumps,
    read_json,
    result_header,
    sha256_file,
    write_json,
)
from hdbench.records.loads import LoadReading, Loads
from hdbench.records.provenance import input_identity
from hdbench.records.quantity import Quantity, TorqueScale
from hdbench.records.recovery import (
    VerifyReport,
    recover_run,
    resolve_input,
    verify_run,
    verify_runs,
)
from hdbench.records.runfolder import RunFolder, RunNote, add_note, read_notes
from hdbench.records.runindex import RunSummary, list_runs, select_runs
from hdbench.records.storage import write_atomic, write_new
from hdbench.records.tables import (
    is_loads_file,
    read_loads,
    read_trace,
    write_loads,
    write_trace,
)
from hdbench.records.trace import FloatArray, Trace

__all__ = [
    "FloatArray",
    "JournalBlock",
    "JournalContent",
    "JournalWriter",
    "LoadReading",
    "Loads",
    "ProfileIdentity",
    "Quantity",
    "RunFolder",
    "RunNote",
    "RunSummary",
    "TorqueScale",
    "Trace",
    "VerifyReport",
    "add_note",
    "dumps",
    "input_identity",
    "is_loads_file",
    "list_runs",
    "read_journal",
    "read_json",
    "read_loads",
    "read_notes",
    "read_trace",
    "recover_run",
    "resolve_input",
    "result_header",
    "select_runs",
    "sha256_file",
    "verify_run",
    "verify_runs",
    "write_atomic",
    "write_json",
    "write_loads",
    "write_new",
    "write_trace",
]
