"""Reading of the bridge under a weight: acquired, watched, and as the journal keeps it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from hdbench.devices.bench import AcquisitionSettings, Bench, Block
from hdbench.profile.schema import ProfileData
from hdbench.records.loads import LoadReading
from hdbench.session.calibrating import settling
from hdbench.session.calibrating.conversation import Answer
from hdbench.session.calibrating.state import CalibrationState
from hdbench.session.plans import Point
from hdbench.session.runner import next_block
from hdbench.session.stop import Aborted, StopSignals

_OF_POINT = ("experiment", "position_rad", "range", "direction", "series", "torque_nm", "mass_kg")


@dataclass(frozen=True, slots=True)
class Taken:
    """What came of one wait for a reading."""

    wanted: Answer | None
    reading: settling.SettledReading
    spread_v: float
    saturated: bool
    waited_s: float


@dataclass(slots=True)
class BridgeReader:
    """Acquires with the drive disabled and ends as soon as the reading has settled."""

    profile: ProfileData
    bench: Bench
    stop: StopSignals
    sampled_s: float = field(default=0.0, init=False)
    watched: bool = field(default=True, init=False)
    _lock_count: int | None = field(default=None, init=False)

    def remount(self) -> None:
        """Forget where the locked encoder stood."""
        self._lock_count = None

    def take(
        self, rule: settling.SettleRule, watch: Callable[[settling.Judgement, float], Answer | None]
    ) -> Taken:
        """Acquire until the reading has settled, the time is up, or a person wants otherwise."""
        self.bench.configure(AcquisitionSettings(rule.period_s, rule.limit, None))
        self.bench.start()
        samples, saturated = np.empty(0), np.empty(0, dtype=bool)
        wanted, judged = None, None
        while wanted is None and len(samples) < rule.limit:
            block = next_block(self.bench, self.stop)
            self._watch_lock(block)
            samples = np.concatenate([samples, block.torque_v])
            saturated = np.concatenate([saturated, block.saturated])
            self.sampled_s += (len(block) + block.lost_before) * rule.period_s
            if len(samples) < 4:
                continue
            judged = settling.judge(samples, rule)
            if judged.reading is not None:
                break
            wanted = watch(judged, len(samples) * rule.period_s)
        self.bench.stop()
        settled = judged.reading if judged is not None else None
        reading = settled or settling.average_now(samples, rule)
        spread_v = float(np.ptp(samples[-rule.window :]))
        in_average = bool(saturated[-reading.n_samples :].any())
        return Taken(wanted, reading, spread_v, in_average, len(samples) * rule.period_s)

    def _watch_lock(self, block: Block) -> None:
        if "encoder" in block.absent:
            # its counts are all 0: nobody sees whether the lock holds
            self.watched = False
            return
        if len(block) == 0:
            return
        if self._lock_count is None:
            self._lock_count = int(block.encoder_count[0])
        turn = 2.0 * np.pi / self.profile.encoder.counts_per_turn
        moved = float(np.max(np.abs(block.encoder_count - self._lock_count))) * turn
        limit = self.profile.calibration.max_lock_motion_rad
        if not moved <= limit:
            raise Aborted(
                f"the locked wave generator moved {moved:.4f} rad; allowed {limit:g} rad",
                where="encoder",
                fix="take the weight off, tighten the lock and start again",
            )


def reading_entry(
    point: Point, taken: Taken, state: CalibrationState, flags: list[str], time_s: float
) -> dict[str, Any]:
    """Return one reading as the journal keeps it."""
    reading = taken.reading
    load = LoadReading(
        **{name: getattr(point, name) for name in _OF_POINT},
        reading_v=reading.mean_v,
        reading_std_v=reading.std_v,
        n_samples=reading.n_samples,
        time_s=time_s,
    )
    swing = reading.swing
    return {
        **asdict(load),
        "point": point.number,
        "attempt": max(1, state.attempts[point.number]),
        "repeat": point.repeat,
        "mounting": state.mountings,
        "settled": reading.settled,
        "settle_s": taken.waited_s,
        "slope_v_s": reading.slope_v_s,
        "autocorrelation": reading.lag1,
        "swing_period_s": None if swing is None else swing.period_s,
        "swing_v": None if swing is None else swing.amplitude_v,
        "flags": ";".join(flags),
    }
