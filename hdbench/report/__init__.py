"""Results and traces to one offline HTML file, CSV and JSON."""

from __future__ import annotations

from hdbench.report.page import ReportFiles, write_report

__all__ = ["ReportFiles", "write_report"]
