"""Runs and records in the forms that other programs read: Parquet, HDF5, MATLAB."""

from __future__ import annotations

from hdbench.records.exporting.content import Content, gather
from hdbench.records.exporting.write import FORMATS, export_records

__all__ = ["FORMATS", "Content", "export_records", "gather"]
