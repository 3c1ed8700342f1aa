"""Plain records and every read and write of them."""

from __future__ import annotations

from hdbench.records.jsonfile import read_json, result_header, write_json
from hdbench.records.loads import LoadReading, Loads, is_loads_file, read_loads
from hdbench.records.provenance import input_identity
from hdbench.records.quantity import Quantity, TorqueScale
from hdbench.records.recovery import VerifyReport, resolve_input, verify_runs
from hdbench.records.runfolder import RunFolder, add_note, read_notes
from hdbench.records.runindex import RunSummary, list_runs, select_runs
from hdbench.records.storage import write_atomic, write_new
from hdbench.records.trace import FloatArray, Trace
from hdbench.records.tracefile import read_trace, write_trace

__all__ = [
    "FloatArray",
    "LoadReading",
    "Loads",
    "Quantity",
    "RunFolder",
    "RunSummary",
    "TorqueScale",
    "Trace",
    "VerifyReport",
    "add_note",
    "input_identity",
    "is_loads_file",
    "list_runs",
    "read_json",
    "read_loads",
    "read_notes",
    "read_trace",
    "resolve_input",
    "result_header",
    "select_runs",
    "verify_runs",
    "write_atomic",
    "write_json",
    "write_new",
    "write_trace",
]
