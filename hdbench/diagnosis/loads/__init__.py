"""Diagnosis of calibration loads: readings in, names and places out."""
