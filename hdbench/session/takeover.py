"""A recorder that goes on with what an earlier session of its run has recorded."""

from __future__ import annotations

import numpy as np

from hdbench.records.journal import JournalSamples
from hdbench.session.recorder import TraceRecorder

__all__ = ["take_over"]


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
