"""A bench made of any DAQ: the adapter between `Daq` and `Bench`."""

from __future__ import annotations

from hdbench.devices.hosted.bench import HostedBench
from hdbench.devices.hosted.sampleclock import Alignment
from hdbench.devices.hosted.settings import HostSettings, host_settings

__all__ = ["Alignment", "HostSettings", "HostedBench", "host_settings"]
