"""Calibration in a report: its section, and the record as a table."""
