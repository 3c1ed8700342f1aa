"""The shared filter module: torque ripple and misalignment out of the torque signal."""

from __future__ import annotations

from hdbench.filter.comparison import butterworth_lowpass
from hdbench.filter.kalman import FilteredBlock, kernel_name, kernel_reason
from hdbench.filter.model import FilterModel, OscillatorBlock, SlowBlock
from hdbench.filter.online import (
    Channels,
    OnlineFilter,
    filter_channels,
    filter_trace,
    filtered_columns,
)
from hdbench.filter.presets import PRESETS, build_filter_model, load_filter_model, preset
from hdbench.filter.response import transfer_at_steady_speed
from hdbench.filter.tuning.problem import TuningSettings
from hdbench.filter.tuning.result import TuningResult
from hdbench.filter.tuning.run import tune

__all__ = [
    "PRESETS",
    "Channels",
    "FilterModel",
    "FilteredBlock",
    "OnlineFilter",
    "OscillatorBlock",
    "SlowBlock",
    "TuningResult",
    "TuningSettings",
    "build_filter_model",
    "butterworth_lowpass",
    "filter_channels",
    "filter_trace",
    "filtered_columns",
    "kernel_name",
    "kernel_reason",
    "load_filter_model",
    "preset",
    "transfer_at_steady_speed",
    "tune",
]
