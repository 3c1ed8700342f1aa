"""The shared filter module: torque ripple and misalignment out of the torque signal."""

from __future__ import annotations

from hdbench.filter.assemble import state_space
from hdbench.filter.blocks import OscillatorBlock, SlowBlock
from hdbench.filter.build import build_filter_model
from hdbench.filter.channels import Channels, filter_channels
from hdbench.filter.compare import butterworth_lowpass, transfer_at_steady_speed
from hdbench.filter.core import kernel_name, kernel_reason
from hdbench.filter.model import FilterModel
from hdbench.filter.offline import filter_trace, filtered_columns
from hdbench.filter.online import FilteredBlock, OnlineFilter
from hdbench.filter.presets import PRESETS, load_filter_model, preset
from hdbench.filter.tuning import TuningResult, TuningSettings, tune

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
    "state_space",
    "transfer_at_steady_speed",
    "tune",
]
