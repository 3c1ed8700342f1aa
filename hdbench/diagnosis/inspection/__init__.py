"""What a log can tell: sampling, bandwidth, resolution, origin and delay of its channels."""

from __future__ import annotations

from hdbench.diagnosis.inspection.inspect import inspect_log, inspect_trace
from hdbench.diagnosis.inspection.log import Log, read_log
from hdbench.diagnosis.inspection.result import ChannelFacts, Finding, Inspection

__all__ = [
    "ChannelFacts",
    "Finding",
    "Inspection",
    "Log",
    "inspect_log",
    "inspect_trace",
    "read_log",
]
