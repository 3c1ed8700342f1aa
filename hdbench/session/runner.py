"""The safe runner: walks a plan, and makes the bench safe on every way out."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field

import numpy as np

from hdbench.devices.ports import AcquisitionSettings, Bench, Block, Operator, SafeState
from hdbench.errors import DeviceError, LimitError
from hdbench.filter.amplitudes import block_amplitudes
from hdbench.profile.schema import ProfileData
from hdbench.records import FloatArray, LoadReading
from hdbench.records.journal import JournalWriter
from hdbench.session.plans import Acquire, Hang, Lock, Place, Plan, Put, Step
from hdbench.session.recorder import TraceRecorder
from hdbench.session.settling import SettledReading, settled_reading
from hdbench.session.stop import StopSignals
from hdbench.session.watching import Frame, Unwatched, Watcher

__all__ = ["Aborted", "Progress", "Runner"]

Progress = Callable[[str, float], None]
"""Called with what is going on and the share done, 0 to 1."""

_STALL_S = 2.0  # a bench that hands out no sample for this long has stopped sampling


class Aborted(LimitError):  # noqa: N818 - an end that was decided, not an error
    """The operator or a safety limit ended the run; it is not resumable."""

    kind = "aborted"


@dataclass(slots=True)
class Runner:
    """Executes one plan on one bench.

    Parameters
    ----------
    profile : ProfileData
        Limits and scales.
    bench : Bench
        The bench controller.
    operator : Operator
        The person beside it, or a simulated one.
    journal : JournalWriter
        Where every reading and block is synced before it counts.
    stop : StopSignals
        Signals that end the run.
    progress : callable
        Told what is going on.
    recorder : TraceRecorder or None
        Takes the samples of a dynamic run.
    person : bool
        True where `operator` asks a person, so that a signal interrupts the question.
    watcher : Watcher
        Who looks on.
    """

    profile: ProfileData
    bench: Bench
    operator: Operator
    journal: JournalWriter
    stop: StopSignals
    progress: Progress
    recorder: TraceRecorder | None = None
    person: bool = False
    watcher: Watcher = field(default_factory=Unwatched)
    total_s: float = field(default=math.nan, init=False)
    readings: list[LoadReading] = field(default_factory=list, init=False)
    settled: list[bool] = field(default_factory=list, init=False)
    saturated_readings: int = field(default=0, init=False)
    lock_count: int | None = field(default=None, init=False)
    safe: SafeState | None = field(default=None, init=False)

    def run(self, plan: Plan) -> None:
        """Walk the plan; the bench is safe afterwards, whatever happened.

        Parameters
        ----------
        plan : Plan
            A plan that `check_plan` has accepted.

        Raises
        ------
        StopRequested
            When a signal came.
        Aborted
            When the operator declined or a limit was crossed.
        DeviceError
            When the device failed.
        StorageError
            When the journal could not be written.

        Notes
        -----
        `safe` holds what was read back; the caller reports an unconfirmed safe state.
        """
        moves = [step for step in plan.steps if isinstance(step, Acquire)]
        self.total_s = sum(step.n_samples * step.sample_period_s for step in moves)
        try:
            for number, step in enumerate(plan.steps):
                self.stop.check()
                self.progress(step.describe(), number / len(plan.steps))
                self._step(step)
        finally:
            self.safe = self.bench.safe_state()

    def _step(self, step: Step) -> None:
        match step:
            case Lock():
                self._ask(lambda: self.operator.confirm_lock(locked=step.locked), step.describe())
                self.lock_count = None
            case Place():
                self._ask(
                    lambda: self.operator.set_position(
                        step.position_rad, index=step.index, count=step.count
                    ),
                    step.describe(),
                )
                self.lock_count = None
            case Hang():
                self._ask(
                    lambda: self.operator.hang(
                        step.mass_kg,
                        direction=step.direction,
                        expected_nm=step.torque_nm,
                        step=step.label,
                    ),
                    step.describe(),
                )
                self._read(step)
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
                self._acquire(step)

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

    # -- static readings ------------------------------------------------------------------------

    def _read(self, step: Hang) -> None:
        plan = self.profile.calibration
        window = max(2, round(plan.average_s / plan.sample_period_s))
        limit = max(2 * window, round(plan.settle_timeout_s / plan.sample_period_s))
        band_v = plan.settle_band_nm / self.profile.sensor.gain_nm_per_v
        self.bench.configure(AcquisitionSettings(plan.sample_period_s, limit, None))
        self.bench.start()
        samples = np.empty(0)
        saturated = False
        reading: SettledReading | None = None
        while reading is None and len(samples) < limit:
            block = self._next_block()
            self._watch_lock(block)
            samples = np.concatenate([samples, block.torque_v])
            saturated |= bool(np.any(block.saturated[-window:]))
            reading = settled_reading(samples, window, band_v)
        self.bench.stop()
        if reading is None:
            last = samples[-window:]
            reading = SettledReading(
                float(np.mean(last)), float(np.std(last, ddof=1)), len(last), settled=False
            )
        self.saturated_readings += saturated
        self._accept(step, reading)

    def _accept(self, step: Hang, reading: SettledReading) -> None:
        accepted = LoadReading(
            experiment=step.experiment,
            position_rad=step.position_rad,
            range=step.range,
            direction=step.direction,
            series=step.series,
            torque_nm=step.torque_nm,
            reading_v=reading.mean_v,
            mass_kg=step.mass_kg,
            reading_std_v=reading.std_v,
            n_samples=reading.n_samples,
        )
        entry = {**asdict(accepted), "settled": reading.settled}
        self.journal.append("reading", {}, entry)
        self.readings.append(accepted)
        self.settled.append(reading.settled)

    def _watch_lock(self, block: Block) -> None:
        if len(block) == 0:
            return
        if self.lock_count is None:
            self.lock_count = int(block.encoder_count[0])
        turn = 2.0 * np.pi / self.profile.encoder.counts_per_turn
        moved = float(np.max(np.abs(block.encoder_count - self.lock_count))) * turn
        limit = self.profile.calibration.max_lock_motion_rad
        if not moved <= limit:
            raise Aborted(
                f"the locked wave generator moved {moved:.4f} rad; allowed {limit:g} rad",
                where="encoder",
                fix="take the weight off, tighten the lock and start again",
            )

    # -- motion ---------------------------------------------------------------------------------

    def _acquire(self, step: Acquire) -> None:
        recorder = self.recorder
        if recorder is None:
            raise DeviceError(
                "no recorder for a dynamic run", where=step.describe(), fix="report this as a bug"
            )
        self.stop.check()
        self.bench.configure(AcquisitionSettings(step.sample_period_s, step.n_samples, step.wave))
        recorder.begin(step.load)
        self.bench.start()
        while recorder.stage_rows < step.n_samples:
            block = self._next_block()
            rows = recorder.add(block)
            self._watch_limits(block, rows["motor_velocity_rad_s"], rows["torque_nm"])
            self.progress(step.describe(), recorder.stage_rows / step.n_samples)
            self.watcher.frame(self._frame(step, recorder, block, rows))
        self.bench.stop()
        recorder.end()

    def _frame(
        self,
        step: Acquire,
        recorder: TraceRecorder,
        block: Block,
        rows: Mapping[str, FloatArray],
    ) -> Frame:
        return Frame(
            phase=step.describe(),
            done_s=recorder.n_rows * recorder.sample_period_s,
            total_s=self.total_s,
            columns=rows,
            rows=recorder.n_rows,
            lost=recorder.lost,
            saturated=recorder.saturated,
            depth=block.depth,
            retries=0,
            amplitudes=block_amplitudes(recorder.model, recorder.online.state()),
        )

    def _next_block(self) -> Block:
        deadline = time.monotonic() + _STALL_S
        while True:
            self.stop.check()
            block = self.bench.read_block()
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

    def _watch_limits(self, block: Block, velocity: np.ndarray, torque: np.ndarray) -> None:
        limits = self.profile.limits
        watched = (
            ("motor speed", velocity, limits.velocity_rad_s, "rad/s"),
            ("torque", torque, limits.torque_nm, "N m"),
            ("motor current", block.motor_current_a, limits.current_a, "A"),
        )
        for name, values, limit, unit in watched:
            # 0.1 % above a limit is within the converter's scale error, not a crossing
            beyond = np.flatnonzero(np.abs(values) > 1.001 * limit)
            if len(beyond):
                index = int(block.first_index + beyond[0])
                raise Aborted(
                    f"{name} {float(values[beyond[0]]):+.6g} {unit} crossed the limit "
                    f"{limit:g} {unit}",
                    where=f"sample {index}",
                    fix="find out why before raising the limit in the profile",
                )
