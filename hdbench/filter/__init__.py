"""The shared filter module: torque ripple and misalignment out of the torque signal."""

from __future__ import annotations

from hdbench.filter.build import build_filter_model
from hdbench.filter.compare import butterworth_lowpass, transfer_at_steady_speed
from hdbench.filter.core import kernel_name, kernel_reason
from hdbench.filter.model import FilterModel, OscillatorBlock
from hdbench.filter.offline import filter_trace, filtered_columns
from hdbench.filter.online import FilteredBlock, OnlineFilter
from hdbench.filter.presets import PRESETS, load_filter_model, preset

__all__ = [
    "PRESETS",
    "FilterModel",
    "FilteredBlock",
    "OnlineFilter",
    "OscillatorBlock",
    "build_filter_model",
    "butterworth_lowpass",
    "filter_trace",
    "filtered_columns",
    "kernel_name",
    "kernel_reason",
    "load_filter_model",
    "preset",
    "transfer_at_steady_speed",
]
