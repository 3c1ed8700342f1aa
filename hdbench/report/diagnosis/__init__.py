"""Diagnosis in a report: its section, its tables and figures, and the limits of an answer."""
