"""Columns of a loads file."""

from __future__ import annotations

__all__ = ["LOADS_COLUMNS", "LOADS_OPTIONAL"]

LOADS_COLUMNS = (
    "experiment",
    "position_rad",
    "range",
    "direction",
    "series",
    "torque_nm",
    "mass_kg",
    "reading_v",
    "reading_std_v",
    "n_samples",
    "time_s",
    "temperature_c",
)
"""Columns that the contract names, in the order in which they are written."""
LOADS_OPTIONAL = (
    "kind",
    "repeat",
    "mounting",
    "loading",
    "arm_length_m",
    "settle_s",
    "slope_v_s",
    "autocorrelation",
    "flags",
    "n_excluded",
    "excluded_at_s",
    "wave_generator_rad",
    "humidity_percent",
    "pressure_hpa",
)
"""Columns that the calibration understands beside the contract's; kept as text by the reader."""
