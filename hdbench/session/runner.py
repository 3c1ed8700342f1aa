"""Safe runner: walks a plan and leaves the bench safe on every way out."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass, field

from hdbench.devices.bench import AcquisitionSettings, Bench, Block, Operator, SafeState
from hdbench.errors import DeviceError, UsageError
from hdbench.profile.schema import ProfileData
from hdbench.session.limits import LimitWatch, SpeedWatch
from hdbench.session.plans import Acquire, Lock, Place, Plan, Put, Step
from hdbench.session.recorder import TraceRecorder
from hdbench.session.stop import Aborted, StopSignals
from hdbench.session.watching import Watcher

_STALL_S = 2.0  # a bench that hands out no sample for this long has stopped sampling


def next_block(bench: Bench, stop: StopSignals) -> Block:
    """Return the next block with samples or losses in it."""
    deadline = time.monotonic() + _STALL_S
    while True:
        stop.check()
        block = bench.read_block()
        if block is not None and block.watchdog_tripped:
            raise DeviceError(
                "the bench controller's watchdog stopped the motor",
                where=f"sample {block.first_index}",
                fix="check load and network of this computer, then run again",
            )
        if block is not None and (len(block) or block.lost_before):
            return block
        if time.monotonic() > deadline:
            raise DeviceError(
                f"no sample for {_STALL_S:g} s while the acquisition should run",
                where="bench controller",
                fix="check that the controller is sampling: hdbench doctor",
            )
        time.sleep(0.002)


Progress = Callable[[str, float], None]
"""Called with what is going on and the share done, 0 to 1."""


@dataclass(slots=True)
class Runner:
    """Executes one plan on one bench."""

    profile: ProfileData
    bench: Bench
    operator: Operator
    stop: StopSignals
    progress: Progress
    recorder: TraceRecorder
    person: bool = False
    watcher: Watcher = field(default_factory=Watcher)
    total_s: float = field(default=math.nan, init=False)
    safe: SafeState | None = field(default=None, init=False)

    def run(self, plan: Plan, done: Collection[int] = ()) -> None:
        """Walk the plan; the bench is safe afterwards, whatever happened.

        `safe` holds what was read back; the caller reports an unconfirmed safe state.
        """
        moves = [step for step in plan.steps if isinstance(step, Acquire)]
        self.total_s = sum(step.n_samples * step.sample_period_s for step in moves)
        try:
            for number, step in enumerate(plan.steps):
                self.stop.check()
                self.progress(step.describe(), number / len(plan.steps))
                if number not in done:
                    self._step(step, number)
        finally:
            self.safe = self.bench.safe_state()

    def _step(self, step: Step, number: int) -> None:
        match step:
            case Lock():
                self._ask(lambda: self.operator.confirm_lock(locked=step.locked), step.describe())
            case Place():
                self._ask(
                    lambda: self.operator.set_position(
                        step.position_rad, index=step.index, count=step.count
                    ),
                    step.describe(),
                )
            case Put():
                self._ask(
                    lambda: self.operator.hang(
                        step.mass_kg,
                        direction=step.direction,
                        expected_nm=step.load.torque_nm,
                        step=step.load.text,
                    ),
                    step.describe(),
                )
            case Acquire():
                self._ask(
                    lambda: self.operator.confirm_motion(step.describe()), "confirm the motion"
                )
                self._acquire(step, number)
            case _:
                raise UsageError(
                    f"{step.describe()}: a load of a calibration in a run with motion",
                    where=f"step {number + 1} of the plan",
                    fix="use hdbench calibrate",
                )

    def _ask(self, question: Callable[[], bool], what: str) -> None:
        if self.person:
            self.watcher.asking(now=True)
            with self.stop.interruptible():
                answer = question()
            self.watcher.asking(now=False)
        else:
            answer = question()
        if not answer:
            raise Aborted(
                f"not confirmed: {what}",
                where="operator",
                fix="start the experiment again when the bench is ready",
            )

    # -- motion ---------------------------------------------------------------------------------

    def _acquire(self, step: Acquire, number: int) -> None:
        recorder = self.recorder
        self.stop.check()
        self.bench.configure(AcquisitionSettings(step.sample_period_s, step.n_samples, step.wave))
        recorder.begin(step.load, number)
        range_rad_s = self.profile.daq.range_v * self.profile.tacho.gain_rad_s_per_v
        limits = LimitWatch(self.profile.limits)
        speed = SpeedWatch(step.sample_period_s, range_rad_s)
        self.bench.start()
        while recorder.stage_rows < step.n_samples:
            block = next_block(self.bench, self.stop)
            rows = recorder.add(block)
            limits.check(block, rows)
            speed.check(block, rows)
            self.progress(step.describe(), recorder.stage_rows / step.n_samples)
            self.watcher.frame(recorder.frame(step.describe(), self.total_s, block, rows))
        self.bench.stop()
        recorder.end(number)
