"""One run from the open bench to its folder, and every way out of it."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path

from hdbench.devices import SimulatedOperator, open_bench
from hdbench.devices.ports import Bench
from hdbench.errors import (
    DataError,
    DeviceError,
    HdbenchError,
    Stopped,
    StorageError,
    UnsafeError,
    UsageError,
)
from hdbench.filter import FilterModel
from hdbench.profile import Profile
from hdbench.records import Loads, TorqueScale, Trace
from hdbench.records.journal import JournalWriter
from hdbench.records.loadsfile import write_loads
from hdbench.records.runfolder import RunFolder
from hdbench.records.tracefile import write_trace
from hdbench.session.evaluation import evaluate, store_evaluation
from hdbench.session.options import BenchOptions, RunOutcome
from hdbench.session.plans import Plan
from hdbench.session.recorder import TraceRecorder
from hdbench.session.runner import Progress, Runner
from hdbench.session.stop import StopRequested, StopSignals

__all__ = ["Run"]


@dataclass(slots=True)
class Run:
    """One run: bench opened, plan walked, records kept, result stored.

    Parameters
    ----------
    kind : str
        ``calibration``, ``misalignment`` or ``ripple``.
    profile : Profile
        The bench.
    options : BenchOptions
        How to run it.
    plan : Plan
        A plan within the limits.
    scale : TorqueScale
        Gain of the torque.
    model : FilterModel
        Filter that runs online.
    folder : RunFolder
        Where everything is kept.
    stop : StopSignals
        Signals that end the run.
    progress : callable
        Told what is going on.
    """

    kind: str
    profile: Profile
    options: BenchOptions
    plan: Plan
    scale: TorqueScale
    model: FilterModel
    folder: RunFolder
    stop: StopSignals
    progress: Progress
    runner: Runner | None = field(default=None, init=False)

    def measure(self) -> None:
        """Walk the plan; on any way out the bench is safe and the run is marked."""
        try:
            self._measure()
        except StopRequested as request:
            raise self._stopped(request) from request
        except (DeviceError, StorageError) as error:
            raise self._ended("incomplete", error) from error
        except HdbenchError as error:
            raise self._ended("aborted", error) from error
        except OSError as error:
            storage = StorageError(
                str(error.strerror or error),
                where=str(error.filename or self.folder.path),
                fix="free space on the disk; what was acknowledged is in the journal",
            )
            raise self._ended("incomplete", storage) from error
        if self.runner is None or self.runner.safe is None or not self.runner.safe.confirmed:
            raise self._ended("incomplete", self._unsafe(None))

    def _measure(self) -> None:
        journal = JournalWriter(self.folder.journal)
        try:
            with open_bench(
                self.profile.data,
                plant=self.options.plant,
                seed=self.options.seed,
                address=self.options.address,
                realtime=self.options.realtime,
            ) as bench:
                self._walk(bench, journal)
        finally:
            journal.close()

    def _walk(self, bench: Bench, journal: JournalWriter) -> None:
        identity = bench.identity()
        self.folder.update(device=asdict(identity))
        operator = SimulatedOperator(bench) if identity.simulated else self.options.operator
        if operator is None:
            raise UsageError(
                f"{identity.vendor} {identity.model} is a real bench and needs a person",
                where=f"{self.kind} run",
                fix="run without --no-input; motion alone can be confirmed with --yes",
            )
        moved = [put for put in self.plan.loads if put.load.torque_nm and not put.load.locked]
        if identity.simulated and moved:
            raise UsageError(
                f"{moved[0].describe()}: a simulated bench has loads only while it is locked",
                where=f"{self.kind} run",
                fix="make the plan with hdbench plan --no-loads, or run it on a real bench",
            )
        recorder = None
        if self.plan.moves:
            recorder = TraceRecorder(
                self.profile.data,
                self.scale.gain_nm_per_v.value,
                self.model,
                journal,
                self.profile.data.daq.sample_period_s,
            )
        self.runner = Runner(
            self.profile.data,
            bench,
            operator,
            journal,
            self.stop,
            self.progress,
            recorder,
            person=not identity.simulated,
            watcher=self.options.watcher,
        )
        self.runner.run(self.plan)

    # -- the ways out -----------------------------------------------------------------------------

    def _unsafe(self, cause: HdbenchError | None) -> UnsafeError:
        safe = self.runner.safe if self.runner else None
        detail = safe.detail if safe else "no answer from the bench"
        because = f"; after: {cause.what}" if cause else ""
        return UnsafeError.unconfirmed(detail + because, where=str(self.folder.path))

    def _ended(self, status: str, error: HdbenchError) -> HdbenchError:
        runner = self.runner
        if runner is not None and not (runner.safe and runner.safe.confirmed):
            error = self._unsafe(error)
        self._keep(status, error.what)
        return error

    def _stopped(self, request: StopRequested) -> HdbenchError:
        stopped = Stopped(
            f"stopped by {request}; motor reference zero confirmed",
            where=str(self.folder.path),
            fix="look at what was kept: hdbench runs show " + str(self.folder.path),
            exit_code=128 + request.signum,
        )
        return self._ended("incomplete", stopped)

    def _keep(self, status: str, reason: str) -> None:
        try:
            files = self._write_records(self._records()) if self.stop.count < 2 else []
            self.folder.finish(status, reason, files)
        except (OSError, StorageError) as error:
            # the run folder's own disk has failed: the journal has what was acknowledged, and the
            # error that ended the run is the one to tell
            self.progress(f"could not finish {self.folder.path}: {error}", 1.0)

    # -- what is kept -----------------------------------------------------------------------------

    def _records(self) -> Trace | Loads | None:
        runner = self.runner
        if runner is None:
            return None
        if runner.recorder is not None:
            trace = runner.recorder.trace(str(self.folder.trace))
            return trace if len(trace) else None
        if not runner.readings:
            return None
        marks = {"settled": tuple(str(settled).lower() for settled in runner.settled)}
        return Loads(tuple(runner.readings), str(self.folder.loads), extra_columns=marks)

    def _write_records(self, records: Trace | Loads | None) -> list[Path]:
        if isinstance(records, Trace):
            write_trace(self.folder.trace, records)
            return [self.folder.trace]
        if isinstance(records, Loads):
            write_loads(self.folder.loads, records)
            return [self.folder.loads]
        return []

    def evaluate(self) -> RunOutcome:
        """Write the records, evaluate them, close the run."""
        records = self._records()
        files = self._write_records(records)
        if records is None:
            self.folder.finish("incomplete", "no data", files)
            raise DataError(
                "the run recorded nothing", where=str(self.folder.path), fix="run again with -v"
            )
        doubts = self._doubts()
        try:
            found = evaluate(
                self.kind,
                records,
                self.profile,
                self.scale,
                self.model,
                run=self.folder.run_id,
                doubts=doubts,
            )
        except DataError as error:
            self.folder.finish("complete", f"recorded, not evaluated: {error.what}", files)
            raise
        if self.stop.first is not None:
            raise self._stopped(StopRequested(self.stop.first))
        reason = "done" if not doubts else "done; data doubtful: " + "; ".join(doubts)
        store_evaluation(self.folder, found, files, reason)
        return RunOutcome(self.folder, found, doubts)

    def _doubts(self) -> tuple[str, ...]:
        runner = self.runner
        if runner is None:
            return ()
        doubts = []
        if runner.recorder is not None and runner.recorder.lost:
            doubts.append(f"{runner.recorder.lost} samples lost")
        if runner.recorder is not None and runner.recorder.saturated:
            doubts.append(f"{runner.recorder.saturated} samples saturated")
        unsettled = runner.settled.count(False)
        if unsettled:
            doubts.append(f"{unsettled} readings taken before they had settled")
        if runner.saturated_readings:
            doubts.append(f"{runner.saturated_readings} readings saturated")
        return tuple(doubts)
