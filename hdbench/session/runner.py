"""Safe runner: walks a plan with motion and leaves the bench safe on every way out."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from pathlib import Path

from hdbench.devices.bench import AcquisitionSettings, Bench, Block, Operator, SafeState
from hdbench.errors import DeviceError
from hdbench.records import Trace
from hdbench.records.counted import JournalSamples, SampleGroup, all_samples, survey_samples
from hdbench.records.journal import JournalWriter
from hdbench.session.limits import LimitWatch, SpeedWatch
from hdbench.session.options import Task
from hdbench.session.plans import Acquire, Point, Step
from hdbench.session.recorder import TraceRecorder
from hdbench.session.stop import Aborted, StopSignals

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


def counted(numbers: Iterable[tuple[int, str]]) -> tuple[str, ...]:
    """Return in words what is not 0."""
    return tuple(f"{count} {what}" for count, what in numbers if count)


class Runner:
    """One run with motion on one bench; a signal interrupts a question to a person."""

    def __init__(
        self, task: Task, bench: Bench, operator: Operator, journal: JournalWriter, *, person: bool
    ) -> None:
        self._task = task
        self._bench = bench
        self._operator = operator
        self._person = person
        data = task.profile.data
        gain = task.scale.gain_nm_per_v.value
        self.recorder = TraceRecorder(data, gain, task.model, journal, data.daq.sample_period_s)
        self.safe: SafeState | None = None
        moves = [step for step in task.plan.steps if isinstance(step, Acquire)]
        self._total_s = sum(step.n_samples * step.sample_period_s for step in moves)
        self._earlier: JournalSamples | None = None

    def run(self) -> None:
        """Walk the plan but for the acquisitions that earlier sessions completed.

        The bench is safe afterwards, whatever happened: `safe` holds what was read back; the
        caller reports an unconfirmed safe state.
        """
        done: set[int | None] = set()
        try:
            if self._task.content is not None:
                self._earlier = all_samples(self._task.content)
                self.recorder.take_over(self._earlier)
                done = {group.step for group in self._earlier.groups if group.complete}
            steps = self._task.plan.steps
            for number, step in enumerate(steps):
                self._task.stop.check()
                self._task.progress(step.describe(), number / len(steps))
                if number not in done:
                    self._step(step, number)
        finally:
            self.safe = self._bench.safe_state()

    def _step(self, step: Step, number: int) -> None:
        operator, what = self._operator, step.describe()
        if isinstance(step, Acquire):
            self._ask(lambda: operator.confirm_motion(what), "confirm the motion")
            self._acquire(step, number)
        elif not isinstance(step, Point):
            self._ask(lambda: step.ask(operator), what)

    def _ask(self, question: Callable[[], bool], what: str) -> None:
        if self._person:
            watcher = self._task.options.watcher
            watcher.asking(now=True)
            with self._task.stop.interruptible():
                answer = question()
            watcher.asking(now=False)
        else:
            answer = question()
        if not answer:
            raise Aborted(
                f"not confirmed: {what}",
                where="operator",
                fix="start the experiment again when the bench is ready",
            )

    def _acquire(self, step: Acquire, number: int) -> None:
        task, bench, recorder = self._task, self._bench, self.recorder
        data, what = task.profile.data, step.describe()
        task.stop.check()
        bench.configure(AcquisitionSettings(step.sample_period_s, step.n_samples, step.wave))
        recorder.begin(step.load, number)
        limits = LimitWatch(data.limits)
        speed = SpeedWatch(step.sample_period_s, data.daq.range_v * data.tacho.gain_rad_s_per_v)
        bench.start()
        while recorder.stage_rows < step.n_samples:
            block = next_block(bench, task.stop)
            rows = recorder.add(block)
            limits.check(block, rows)
            speed.check(block, rows)
            task.progress(what, recorder.stage_rows / step.n_samples)
            task.options.watcher.frame(recorder.frame(what, self._total_s, block, rows))
        bench.stop()
        recorder.end(number)

    # -- what is kept -----------------------------------------------------------------------------

    def records(self) -> Trace | None:
        """Return the trace."""
        samples = self._samples()
        return samples.trace(str(self._task.folder.trace)) if samples else None

    def files(self) -> list[Path]:
        """Write the trace, and the acquisitions that were broken off and repeated, one each."""
        folder, samples = self._task.folder, self._samples()
        written = []
        if samples is not None:
            samples.write(folder.trace)
            written.append(folder.trace)
        if self._earlier is not None:
            for number, group in enumerate(self._broken_off(), start=1):
                path = folder.path / f"trace-broken-off-{number}.csv"
                self._earlier.only(group).write(path)
                written.append(path)
        return written

    def doubts(self) -> tuple[str, ...]:
        """Return losses, saturation and a torque that did not change."""
        what = {
            "lost": "samples lost",
            "saturated": "samples saturated",
            "held": "samples of the torque that did not change while the motor turned",
        }
        return counted((self.recorder.counts[name], words) for name, words in what.items())

    def _samples(self) -> JournalSamples | None:
        """Return what counts of the journal: not what earlier sessions broke off."""
        journal = self._task.folder.journal
        if not journal.exists():
            return None
        broken = {(group.step, group.attempt) for group in self._broken_off()}
        found = survey_samples(journal, lambda group: (group.step, group.attempt) not in broken)
        return found if len(found) else None

    def _broken_off(self) -> list[SampleGroup]:
        """Return the acquisitions that earlier sessions broke off."""
        groups = () if self._earlier is None else self._earlier.groups
        return [group for group in groups if not group.complete]
