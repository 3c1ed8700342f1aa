"""Inspection of a log: sampling, bandwidth, resolution, origin and delay of its channels."""

from __future__ import annotations

from hdbench.diagnosis.inspection.inspect import inspect_log, inspect_trace
from hdbench.diagnosis.inspection.log import read_log

__all__ = ["inspect_log", "inspect_trace", "read_log"]
