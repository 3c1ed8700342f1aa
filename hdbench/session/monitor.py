"""Monitor: samples of a bench whose drive is off, kept as statistics only."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdbench.devices import open_bench
from hdbench.devices.bench import AcquisitionSettings, Identity, SafeState
from hdbench.errors import UnsafeError
from hdbench.filter import FilterModel
from hdbench.profile import Profile
from hdbench.records import FloatArray, TorqueScale
from hdbench.session.recorder import TraceRecorder, Watcher
from hdbench.session.runner import next_block
from hdbench.session.stop import StopRequested, StopSignals

_LONGEST_S = 86400.0
_SHOWN = {
    "torque_nm": "N m",
    "torque_v": "V",
    "motor_velocity_rad_s": "rad/s",
    "tacho_v": "V",
    "motor_angle_rad": "rad",
    "motor_current_a": "A",
    "reference_v": "V",
}


@dataclass(slots=True)
class ChannelStatistics:
    """Mean, scatter and ends of a channel, without keeping its samples.

    Chan, Golub and LeVeque's update of mean and sum of squares by blocks (The American
    Statistician 37, 242, 1983): no loss of digits over hours of samples.
    """

    unit: str
    n: int = 0
    mean: float = 0.0
    squares: float = 0.0
    low: float = math.inf
    high: float = -math.inf

    def add(self, values: FloatArray) -> None:
        """Take in samples; NaN marks a lost one."""
        good = values[np.isfinite(values)]
        if not len(good):
            return
        mean, count = float(np.mean(good)), len(good)
        squares = float(np.sum((good - mean) ** 2))
        apart = mean - self.mean
        total = self.n + count
        self.squares += squares + apart**2 * self.n * count / total
        self.mean += apart * count / total
        self.n = total
        self.low = min(self.low, float(np.min(good)))
        self.high = max(self.high, float(np.max(good)))

    def to_dict(self) -> dict[str, Any]:
        """Return the statistics; None for what too few samples do not give."""
        std = math.sqrt(self.squares / (self.n - 1)) if self.n > 1 else None
        return {
            "unit": self.unit,
            "n": self.n,
            "mean": self.mean if self.n else None,
            "std": std,
            "min": self.low if self.n else None,
            "max": self.high if self.n else None,
        }


@dataclass(frozen=True, slots=True)
class Observation:
    """What was seen."""

    device: Identity
    seconds: float
    samples: int
    lost: int
    saturated: int
    channels: Mapping[str, Mapping[str, Any]]
    safe_state: SafeState
    stopped_by: int | None


def observe(
    profile: Profile,
    scale: TorqueScale,
    model: FilterModel,
    watcher: Watcher,
    stop: StopSignals,
    *,
    duration_s: float | None,
    address: str | None,
    plant: str,
    seed: int,
) -> Observation:
    """Sample a bench with its drive disabled until the time is over or a signal comes."""
    data = profile.data
    period_s = data.daq.sample_period_s
    recorder = TraceRecorder(data, scale.gain_nm_per_v.value, model, None, period_s)
    channels = {name: ChannelStatistics(unit) for name, unit in _SHOWN.items()}
    count = max(1, round((duration_s or _LONGEST_S) / period_s))
    total_s = math.nan if duration_s is None else duration_s
    signum: int | None = None
    with open_bench(profile, plant=plant, seed=seed, address=address, realtime=True) as bench:
        identity = bench.identity()
        try:
            stop.check()
            bench.configure(AcquisitionSettings(period_s, count, None))
            recorder.begin(None)
            bench.start()
            while recorder.stage_rows < count:
                block = next_block(bench, stop)
                rows = recorder.add(block)
                # a bench need not have every channel
                for name in channels.keys() & rows.keys():
                    channels[name].add(rows[name])
                watcher.frame(recorder.frame("looking on, drive disabled", total_s, block, rows))
            bench.stop()
        except StopRequested as request:
            signum = request.signum
        finally:
            safe = bench.safe_state()
            if not safe.confirmed:
                raise UnsafeError.unconfirmed(safe.detail, where=address or data.daq.address)
    return Observation(
        identity,
        recorder.n_rows * period_s,
        recorder.n_rows,
        recorder.counts["lost"],
        recorder.counts["saturated"],
        {name: statistics.to_dict() for name, statistics in channels.items()},
        safe,
        signum,
    )
