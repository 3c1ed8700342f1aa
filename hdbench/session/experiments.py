"""The three experiments: open the bench, walk the plan, keep what came, evaluate it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from hdbench.devices import SimulatedOperator, open_bench
from hdbench.devices.ports import Bench, Operator
from hdbench.errors import (
    DataError,
    DeviceError,
    HdbenchError,
    Stopped,
    StorageError,
    UnsafeError,
    UsageError,
)
from hdbench.filter import FilterModel, kernel_name
from hdbench.profile import Profile
from hdbench.profile.scaling import profile_scale, read_calibration
from hdbench.records import Loads, TorqueScale, Trace
from hdbench.records.journal import JournalWriter
from hdbench.records.loadsfile import write_loads
from hdbench.records.runfolder import RunFolder
from hdbench.records.tracefile import write_trace
from hdbench.session.evaluation import Evaluation, evaluate, store_evaluation
from hdbench.session.filters import choose_filter
from hdbench.session.plans import (
    Plan,
    calibration_plan,
    check_plan,
    misalignment_plan,
    ripple_plan,
)
from hdbench.session.recorder import TraceRecorder
from hdbench.session.runner import Aborted, Progress, Runner
from hdbench.session.stop import StopRequested, StopSignals, listen

__all__ = ["BenchOptions", "RunOutcome", "make_plan", "run_experiment"]

_PLANS: dict[str, Callable[..., Plan]] = {
    "calibration": calibration_plan,
    "misalignment": misalignment_plan,
    "ripple": ripple_plan,
}


@dataclass(frozen=True, slots=True)
class BenchOptions:
    """How an experiment is to be run.

    Parameters
    ----------
    out : Path
        Parent folder of run folders.
    plant : str
        Plant of the embedded bench.
    seed : int
        Seed of the embedded bench.
    address : str or None
        Bench controller instead of the profile's.
    realtime : bool
        Keep real time on the embedded bench.
    calibration : Path or None
        Calibration whose gain scales the torque.
    misalignment : Path or None
        Misalignment result whose output-order block joins the online filter.
    filter_name : str or None
        Filter model instead of the profile's.
    operator : Operator or None
        The person at a real bench; an emulated bench brings its own simulated one.
    """

    out: Path
    plant: str = "as-modelled"
    seed: int = 0
    address: str | None = None
    realtime: bool = False
    calibration: Path | None = None
    misalignment: Path | None = None
    filter_name: str | None = None
    operator: Operator | None = None


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """A finished run.

    Parameters
    ----------
    folder : RunFolder
        Where everything is kept.
    evaluation : Evaluation
        What came out of it.
    doubts : tuple of str
        Reasons to doubt the data; with any, the command exits 6.
    """

    folder: RunFolder
    evaluation: Evaluation
    doubts: tuple[str, ...]


def make_plan(kind: str, profile: Profile) -> Plan:
    """Plan an experiment and hold it against the profile's limits.

    Parameters
    ----------
    kind : str
        ``calibration``, ``misalignment`` or ``ripple``.
    profile : Profile
        The bench.

    Returns
    -------
    Plan
        A plan within the limits.

    Raises
    ------
    UsageError
        If a step is outside a limit.
    """
    plan = _PLANS[kind](profile.data)
    check_plan(plan, profile.data)
    return plan


def run_experiment(
    kind: str, profile: Profile, options: BenchOptions, progress: Progress
) -> RunOutcome:
    """Measure, keep and evaluate one experiment.

    Parameters
    ----------
    kind : str
        ``calibration``, ``misalignment`` or ``ripple``.
    profile : Profile
        The bench.
    options : BenchOptions
        How to run it.
    progress : callable
        Told what is going on.

    Returns
    -------
    RunOutcome
        The complete run.

    Raises
    ------
    Stopped
        When a signal ended it; the safe state was confirmed, the run is kept.
    UnsafeError
        When the safe state could not be confirmed.
    DeviceError, StorageError, Aborted
        When the device, the disk, the operator or a limit ended it; the run is kept.
    """
    plan = make_plan(kind, profile)
    scale = read_calibration(options.calibration) if options.calibration else profile_scale(profile)
    model = choose_filter(profile, options.filter_name, misalignment=options.misalignment)
    with listen() as stop:
        folder = RunFolder.create(
            options.out, kind=kind, profile=profile, details=_details(plan, options)
        )
        versions = {**folder.manifest["versions"], "kernel": kernel_name()}
        folder.update(calibration=scale.to_dict(), filter=model.to_dict(), versions=versions)
        run = _Run(kind, profile, options, plan, scale, model, folder, stop, progress)
        run.measure()
        return run.evaluate()


def _details(plan: Plan, options: BenchOptions) -> dict[str, Any]:
    return {
        "plan": plan.to_dict(),
        "simulation": {"plant": options.plant, "seed": options.seed},
    }


@dataclass(slots=True)
class _Run:
    kind: str
    profile: Profile
    options: BenchOptions
    plan: Plan
    scale: TorqueScale
    model: FilterModel
    folder: RunFolder
    stop: StopSignals
    progress: Progress
    runner: Runner | None = None

    def measure(self) -> None:
        """Walk the plan; on any way out the bench is safe and the run is marked."""
        try:
            self._measure()
        except StopRequested as request:
            raise self._stopped(request) from request
        except Aborted as error:
            raise self._ended("aborted", error) from error
        except (DeviceError, StorageError) as error:
            raise self._ended("incomplete", error) from error
        except HdbenchError as error:
            self._keep("aborted", error.what)
            raise
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
        )
        self.runner.run(self.plan)

    # -- the ways out -----------------------------------------------------------------------------

    def _unsafe(self, cause: HdbenchError | None) -> UnsafeError:
        safe = self.runner.safe if self.runner else None
        detail = safe.detail if safe else "no answer from the bench"
        because = f"; after: {cause.what}" if cause else ""
        return UnsafeError(
            f"THE SAFE STATE COULD NOT BE CONFIRMED: {detail}{because}",
            where=str(self.folder.path),
            fix="press the emergency stop, then look at the bench before anything else",
        )

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
            files = self._write_records() if self.stop.count < 2 else []
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

    def _write_records(self) -> list[Path]:
        records = self._records()
        if isinstance(records, Trace):
            write_trace(self.folder.trace, records)
            return [self.folder.trace]
        if isinstance(records, Loads):
            write_loads(self.folder.loads, records)
            return [self.folder.loads]
        return []

    def evaluate(self) -> RunOutcome:
        """Write the records, evaluate them, close the run."""
        files = self._write_records()
        records = self._records()
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
