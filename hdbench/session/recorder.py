"""Recorder: blocks of samples to rows of the trace, in the journal before they count."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hdbench.devices.bench import Block
from hdbench.diagnosis.planning.segments import LoadStep
from hdbench.filter import FilterModel, OnlineFilter
from hdbench.profile.schema import ProfileData
from hdbench.records import FloatArray
from hdbench.records.journal import JournalSamples
from hdbench.session.limits import HeldTorque

_SYNC_S = 0.05  # longest time between two syncs of the journal
_CHANNELS = (
    "motor_velocity_rad_s",
    "motor_angle_rad",
    "encoder_count",
    "torque_nm",
    "torque_v",
    "tacho_v",
    "motor_current_a",
    "reference_v",
)
# columns that a bench without the channel does not have
_COLUMNS_OF = {
    "encoder": ("motor_angle_rad", "encoder_count"),
    "current": ("motor_current_a",),
    "reference": ("reference_v",),
}


class SampleJournal(Protocol):
    """Where blocks of samples are kept: `hdbench.records.journal.JournalWriter`, or nowhere."""

    def append(
        self,
        kind: str,
        columns: Mapping[str, NDArray[Any]],
        extra: Mapping[str, Any] | None = None,
        *,
        sync: bool = True,
    ) -> None:
        """Write one block and, with `sync`, wait until the disk has it."""
        ...


@dataclass(slots=True)
class TraceRecorder:
    """Turns blocks into rows of the trace.

    Parameters
    ----------
    profile : ProfileData
        Scales of tacho and encoder.
    gain_nm_per_v : float
        Torque gain, N m/V.
    model : FilterModel
        The filter that runs online.
    journal : SampleJournal
        Where rows are synced before the block is acknowledged.
    sample_period_s : float
        Sampling period, s.
    clock : callable
        Monotonic clock, s.

    Notes
    -----
    Every block is in the journal before it is acknowledged to the bench, so that a killed process
    loses none; the disk is synced every 50 ms, which is what a power cut can cost.

    A lost sample becomes a row with its time and NaN elsewhere: counted, marked, never closed up.

    No row is kept here: the trace is made of the journal, so that hours take no more memory than
    seconds.
    """

    profile: ProfileData
    gain_nm_per_v: float
    model: FilterModel
    journal: SampleJournal
    sample_period_s: float
    clock: Callable[[], float] = time.monotonic
    synced_s: float = field(default=-math.inf, init=False)
    online: OnlineFilter = field(init=False)
    n_rows: int = field(default=0, init=False)
    lost: int = field(default=0, init=False)
    saturated: int = field(default=0, init=False)
    held: int = field(default=0, init=False)
    stage: int = field(default=0, init=False)
    stage_rows: int = field(default=0, init=False)
    stage_start_s: float = field(default=0.0, init=False)
    load: LoadStep | None = field(default=None, init=False)
    ended_s: float | None = field(default=None, init=False)
    attempts: dict[int, int] = field(default_factory=dict, init=False)
    _torque: HeldTorque = field(init=False)

    def __post_init__(self) -> None:
        self.online = OnlineFilter(self.model)
        self._torque = HeldTorque(self.sample_period_s)

    def begin(self, load: LoadStep | None, step: int | None = None) -> None:
        """Begin an acquisition; one that follows another begins the pause after it.

        Notes
        -----
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
            self.attempts[step] = self.attempts.get(step, 0) + 1
            noted = {"event": "acquisition", "step": step, "attempt": self.attempts[step]}
            self.journal.append("event", {}, noted)

    def end(self, step: int | None = None) -> None:
        """Note that an acquisition is over."""
        self.ended_s = self.clock()
        if step is not None:
            self.journal.append("event", {}, {"event": "acquired", "step": step})

    def add(self, block: Block) -> dict[str, FloatArray]:
        """Scale, filter and journal one block."""
        rows = self._scale(block)
        filtered = self.online.process(
            rows["time_s"],
            rows["motor_velocity_rad_s"],
            rows["torque_nm"],
            rows.get("motor_angle_rad"),
        )
        rows["torque_filtered_online_nm"] = filtered.torque_filtered_nm
        held = self._held(rows)
        now_s = self.clock()
        sync = now_s - self.synced_s >= _SYNC_S
        if sync:
            self.synced_s = now_s
        self.journal.append(
            "samples",
            rows,
            {
                "first_index": int(block.first_index - block.lost_before),
                "lost": int(block.lost_before),
                "saturated": int(np.count_nonzero(block.saturated)),
                "held": held,
            },
            sync=sync,
        )
        self.n_rows += len(rows["time_s"])
        self.stage_rows += len(rows["time_s"])
        self.lost += block.lost_before
        self.saturated += int(np.count_nonzero(block.saturated))
        self.held += held
        return rows

    def _held(self, rows: dict[str, FloatArray]) -> int:
        """Return how many samples of the torque did not change although the motor turned."""
        if "torque_v" not in rows or "motor_angle_rad" not in rows:
            return 0
        return self._torque.count(rows["torque_v"], rows["motor_angle_rad"])

    def _scale(self, block: Block) -> dict[str, FloatArray]:
        first = block.first_index - block.lost_before
        n = block.lost_before + len(block)
        rows = {name: np.full(n, math.nan) for name in _CHANNELS}
        present = slice(block.lost_before, n)
        counts = block.encoder_count.astype(np.float64)
        turn = 2.0 * math.pi / self.profile.encoder.counts_per_turn
        rows["motor_velocity_rad_s"][present] = block.tacho_v * self.profile.tacho.gain_rad_s_per_v
        rows["motor_angle_rad"][present] = counts * turn
        rows["encoder_count"][present] = counts
        rows["torque_nm"][present] = block.torque_v * self.gain_nm_per_v
        rows["torque_v"][present] = block.torque_v
        rows["tacho_v"][present] = block.tacho_v
        rows["motor_current_a"][present] = block.motor_current_a
        rows["reference_v"][present] = block.reference_v
        time_s = np.arange(first, first + n, dtype=np.float64) * self.sample_period_s
        if block.time_s is not None:
            time_s[present] = block.time_s
        for role in block.absent:
            for name in _COLUMNS_OF.get(role, ()):
                del rows[name]
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


def take_over(recorder: TraceRecorder, samples: JournalSamples) -> None:
    """Take over what an earlier session of this run has recorded."""
    for group in samples.groups:
        if group.step is not None:
            attempts = recorder.attempts.get(group.step, 0)
            recorder.attempts[group.step] = max(attempts, group.attempt)
        if group.complete and not group.superseded:
            _take_over(recorder, samples.only(group))


def _take_over(recorder: TraceRecorder, samples: JournalSamples) -> None:
    recorder.stage += bool(recorder.n_rows)
    first_row, last_s = recorder.n_rows, 0.0
    for block in samples.blocks():
        rows = {name: values.astype(np.float64) for name, values in block.columns.items()}
        recorder.online.process(
            rows["time_s"],
            rows["motor_velocity_rad_s"],
            rows["torque_nm"],
            rows.get("motor_angle_rad"),
        )
        last_s = float(rows["time_s"][-1])
        recorder.n_rows += len(rows["time_s"])
        recorder.lost += int(block.extra.get("lost", 0))
        recorder.saturated += int(block.extra.get("saturated", 0))
        recorder.held += int(block.extra.get("held", 0))
    recorder.stage_rows = recorder.n_rows - first_row
    recorder.stage_start_s = last_s - (recorder.stage_rows - 1) * recorder.sample_period_s
