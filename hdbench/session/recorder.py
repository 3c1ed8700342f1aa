"""Recorder: blocks to rows of the trace, in the journal before they count, frames for a view."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hdbench.devices.bench import Block, scaled
from hdbench.diagnosis.planning.segments import LoadStep
from hdbench.filter import FilterModel, OnlineFilter
from hdbench.filter.online import BlockAmplitude, block_amplitudes
from hdbench.profile.schema import ProfileData
from hdbench.records import FloatArray
from hdbench.records.counted import JournalSamples
from hdbench.records.journal import JournalWriter
from hdbench.session.limits import HeldTorque

_SYNC_S = 0.05  # longest time between two syncs of the journal
_COUNTS = ("lost", "saturated", "held")


@dataclass(frozen=True, slots=True)
class Frame:
    """The newest samples of a run and how it stands."""

    phase: str
    done_s: float
    total_s: float
    columns: Mapping[str, FloatArray]
    rows: int
    lost: int
    saturated: int
    depth: int
    retries: int
    amplitudes: tuple[BlockAmplitude, ...]


class Watcher:
    """Somebody who looks on; this one does not. Neither call may take time or raise."""

    def frame(self, frame: Frame) -> None:
        """Take note of the newest samples."""

    def asking(self, *, now: bool) -> None:
        """Leave the screen to a question (`now`), and take it back after the answer."""


@dataclass(slots=True)
class TraceRecorder:
    """Turns blocks into rows of the trace.

    Every block is in the journal before it is acknowledged to the bench, so that a killed process
    loses none; the disk is synced every 50 ms, which is what a power cut can cost.

    A lost sample becomes a row with its time and NaN elsewhere: counted, marked, never closed up.

    No row is kept here: the trace is made of the journal, so that hours take no more memory than
    seconds.
    """

    profile: ProfileData
    gain_nm_per_v: float
    model: FilterModel
    journal: JournalWriter | None
    sample_period_s: float
    clock: Callable[[], float] = time.monotonic
    synced_s: float = field(default=-math.inf, init=False)
    online: OnlineFilter = field(init=False)
    n_rows: int = field(default=0, init=False)
    counts: Counter[str] = field(default_factory=Counter, init=False)
    stage: int = field(default=0, init=False)
    stage_rows: int = field(default=0, init=False)
    stage_start_s: float = field(default=0.0, init=False)
    load: LoadStep | None = field(default=None, init=False)
    ended_s: float | None = field(default=None, init=False)
    attempts: Counter[int] = field(default_factory=Counter, init=False)
    _torque: HeldTorque = field(init=False)

    def __post_init__(self) -> None:
        self.online = OnlineFilter(self.model)
        self._torque = HeldTorque(self.sample_period_s)

    def begin(self, load: LoadStep | None, step: int | None = None) -> None:
        """Begin an acquisition; one that follows another begins the pause after it.

        A pause is as long as this computer's clock says: effects that follow the clock do not keep
        their phase over it. The column ``stage`` counts acquisitions, so that a pause is not taken
        for lost samples.
        """
        if self.n_rows:
            pause_s = 0.0 if self.ended_s is None else max(0.0, self.clock() - self.ended_s)
            last_s = self.stage_start_s + (self.stage_rows - 1) * self.sample_period_s
            # at least two periods, so that nothing joins what does not belong together
            self.stage_start_s = last_s + max(pause_s, 2.0 * self.sample_period_s)
            self.stage += 1
        self.stage_rows, self.load = 0, load
        self._torque = HeldTorque(self.sample_period_s)
        if step is not None:
            self.attempts[step] += 1
            self._note({"event": "acquisition", "step": step, "attempt": self.attempts[step]})

    def end(self, step: int | None = None) -> None:
        """Note that an acquisition is over."""
        self.ended_s = self.clock()
        if step is not None:
            self._note({"event": "acquired", "step": step})

    def _note(self, event: Mapping[str, Any]) -> None:
        if self.journal is not None:
            self.journal.append("event", {}, event)

    def add(self, block: Block) -> dict[str, FloatArray]:
        """Scale, filter and journal one block."""
        rows = self._scale(block)
        rows["torque_filtered_online_nm"] = self._filter(rows)
        counts = {
            "lost": int(block.lost_before),
            "saturated": int(np.count_nonzero(block.saturated)),
            "held": self._held(rows),
        }
        if self.journal is not None:
            now_s = self.clock()
            sync = now_s - self.synced_s >= _SYNC_S
            if sync:
                self.synced_s = now_s
            first = int(block.first_index - block.lost_before)
            self.journal.append("samples", rows, {"first_index": first, **counts}, sync=sync)
        self._count(len(rows["time_s"]), counts)
        return rows

    def _count(self, n_rows: int, counts: Mapping[str, int]) -> None:
        self.n_rows += n_rows
        self.stage_rows += n_rows
        self.counts.update(counts)

    def frame(
        self, phase: str, total_s: float, block: Block, rows: Mapping[str, FloatArray]
    ) -> Frame:
        """Return a block and the state of the run for those who look on."""
        return Frame(
            phase=phase,
            done_s=self.n_rows * self.sample_period_s,
            total_s=total_s,
            columns=rows,
            rows=self.n_rows,
            lost=self.counts["lost"],
            saturated=self.counts["saturated"],
            depth=block.depth,
            retries=block.repeats,
            amplitudes=block_amplitudes(self.model, self.online.state()),
        )

    def take_over(self, samples: JournalSamples) -> None:
        """Take over what an earlier session of this run has recorded."""
        for group in samples.groups:
            if group.step is not None:
                self.attempts[group.step] = max(self.attempts[group.step], group.attempt)
            if not group.complete or group.superseded:
                continue
            self.stage += bool(self.n_rows)
            self.stage_rows, last_s = 0, 0.0
            for block in samples.only(group).blocks():
                rows = {name: values.astype(np.float64) for name, values in block.columns.items()}
                self._filter(rows)
                last_s = float(rows["time_s"][-1])
                self._count(len(rows["time_s"]), {k: int(block.extra.get(k, 0)) for k in _COUNTS})
            self.stage_start_s = last_s - (self.stage_rows - 1) * self.sample_period_s

    def _filter(self, rows: Mapping[str, FloatArray]) -> FloatArray:
        """Run the online filter over new rows and return the torque, N m."""
        return self.online.process(
            rows["time_s"],
            rows["motor_velocity_rad_s"],
            rows["torque_nm"],
            rows.get("motor_angle_rad"),
        ).torque_filtered_nm

    def _held(self, rows: dict[str, FloatArray]) -> int:
        """Return how many samples of the torque did not change although the motor turned."""
        if "torque_v" not in rows or "motor_angle_rad" not in rows:
            return 0
        return self._torque.count(rows["torque_v"], rows["motor_angle_rad"])

    def _scale(self, block: Block) -> dict[str, FloatArray]:
        first = block.first_index - block.lost_before
        n = block.lost_before + len(block)
        rows = scaled(block, self.profile, self.gain_nm_per_v)
        time_s = np.arange(first, first + n, dtype=np.float64) * self.sample_period_s
        if block.time_s is not None:
            time_s[block.lost_before :] = block.time_s
        return {"time_s": self.stage_start_s + time_s, **rows, **self._under_load(rows, n)}

    def _under_load(self, rows: dict[str, FloatArray], n: int) -> dict[str, FloatArray]:
        """Return the columns of a plan with loads."""
        if self.load is None:
            return {}
        angle = rows.get("motor_angle_rad", np.full(n, math.nan))
        output = angle / self.profile.drive.gear_ratio
        if self.load.locked:
            output = np.full(n, self.load.position_rad)
        return {
            "output_angle_rad": output,
            "load_torque_nm": np.full(n, self.load.torque_nm),
            "stage": np.full(n, float(self.stage)),
        }
