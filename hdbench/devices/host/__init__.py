"""Host control: a bench made of any DAQ, its reference and its checks."""

from __future__ import annotations

from hdbench.devices.host.bench import HostedBench
from hdbench.devices.host.settings import HostSettings, host_settings

__all__ = ["HostSettings", "HostedBench", "host_settings"]
