"""Run: from the open bench to its folder, and every way out of it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path

from hdbench import errors
from hdbench.devices import SimulatedOperator, open_bench
from hdbench.devices.bench import Bench, Identity, Operator, SafeState
from hdbench.devices.operator import Mistakes
from hdbench.records.journal import JournalWriter
from hdbench.records.runfolder import RunFolder
from hdbench.records.storage import check_space, free_reserve, keep_reserve
from hdbench.session.calibrating.conversation import Conversation, Unattended
from hdbench.session.calibrating.plausibility import weights_of
from hdbench.session.calibrating.walk import CalibrationWalk
from hdbench.session.evaluation import evaluate, store_evaluation
from hdbench.session.options import RunOutcome, Task
from hdbench.session.plans import PLAN_NAME
from hdbench.session.runner import Runner
from hdbench.session.stop import StopRequested

Walker = Runner | CalibrationWalk
GUARD_LOG = "guard.jsonl"


@contextmanager
def kept(folder: RunFolder) -> Iterator[None]:
    """Leave no run behind that says it still goes on, whatever ends it."""
    try:
        yield
    finally:
        if folder.manifest["status"] == "running":
            free_reserve(folder.path)
            # on a disk that has failed, it reads as incomplete once this process is gone
            with suppress(errors.HdbenchError, OSError):
                _close(folder)


def _close(folder: RunFolder) -> None:
    try:
        folder.finish("incomplete", "ended without being closed: see the error it ended in")
    except errors.StorageError:
        # a run without a journal has recorded nothing: better none than one that says it goes on
        if not folder.journal.exists():
            shutil.rmtree(folder.path)
        raise


@dataclass(slots=True)
class Run:
    """One run: bench opened, plan walked, records kept, result stored."""

    task: Task
    journal: JournalWriter | None = None
    walker: Walker | None = field(default=None, init=False)

    @property
    def folder(self) -> RunFolder:
        """Where everything is kept."""
        return self.task.folder

    @property
    def _safe(self) -> SafeState | None:
        """What was read back after making the bench safe; None while nothing walked."""
        return None if self.walker is None else self.walker.safe

    @property
    def _is_safe(self) -> bool:
        return self._safe is not None and self._safe.confirmed

    def measure(self) -> None:
        """Walk the plan; on any way out the bench is safe and the run is marked."""
        try:
            self._measure()
        except StopRequested as request:
            raise self._stopped(request) from request
        except (errors.DeviceError, errors.StorageError, errors.Stopped) as error:
            raise self._ended("incomplete", error) from error
        except errors.HdbenchError as error:
            # a run that is resumed and finds no bench or no person has lost nothing
            waits = self.task.content is not None and self.walker is None
            raise self._ended("incomplete" if waits else "aborted", error) from error
        except OSError as error:
            storage = errors.StorageError(
                str(error.strerror or error),
                where=str(error.filename or self.folder.path),
                fix="free space on the disk; what was acknowledged is in the journal",
            )
            raise self._ended("incomplete", storage) from error
        except Exception as error:
            if self.walker is None or self._is_safe:
                raise
            # a bug, but the motor may turn: that is told first
            bug = errors.DeviceError(
                f"{type(error).__name__}: {error}", where="hdbench", fix="report it"
            )
            raise self._ended("incomplete", bug) from error
        if not self._is_safe:
            raise self._ended("incomplete", self._unsafe(None))

    def _measure(self) -> None:
        options = self.task.options
        journal = self.journal or JournalWriter(self.folder.journal)
        try:
            check_space(self.folder.path, self.task.plan.stored_bytes)
            keep_reserve(self.folder.path)
            with open_bench(
                self.task.profile.data,
                plant=options.plant,
                seed=options.seed,
                address=options.address,
                realtime=bool(options.realtime),
                guard_log=self.folder.path / GUARD_LOG,
                control=options.control,
            ) as bench:
                identity = bench.identity()
                self._check_same_bench(identity)
                self.folder.update(device=asdict(identity))
                self.walker = make_walker(self.task, bench, identity, journal)
                self.walker.run()
        finally:
            journal.close()

    def _check_same_bench(self, identity: Identity) -> None:
        """Refuse to go on with a run on another bench than it began on."""
        began = self.folder.manifest.get("device")
        if self.task.content is None or not isinstance(began, dict):
            return
        before = tuple(str(began.get(key)) for key in ("vendor", "model", "serial"))
        now = (identity.vendor, identity.model, identity.serial)
        if before != now:
            raise errors.UsageError(
                f"{' '.join(now)} answers; the run began on {' '.join(before)}",
                where=str(self.folder.path),
                fix="connect that bench, or start a new run: readings of two do not mix",
            )

    # -- the ways out -----------------------------------------------------------------------------

    def _unsafe(self, cause: errors.HdbenchError | None) -> errors.UnsafeError:
        detail = self._safe.detail if self._safe else "no answer from the bench"
        because = f"; after: {cause.what}" if cause else ""
        return errors.UnsafeError.unconfirmed(detail + because, where=str(self.folder.path))

    def _ended(self, status: str, error: errors.HdbenchError) -> errors.HdbenchError:
        if self.walker is not None and not self._is_safe:
            error = self._unsafe(error)
        self._keep(status, error.what)
        return error

    def _stopped(self, request: StopRequested) -> errors.HdbenchError:
        stopped = errors.Stopped(
            f"stopped by {request}; motor reference zero confirmed",
            where=str(self.folder.path),
            fix=f"go on with it: hdbench runs resume {self.folder.path}",
            exit_code=128 + request.signum,
        )
        return self._ended("incomplete", stopped)

    def _keep(self, status: str, reason: str) -> None:
        free_reserve(self.folder.path)
        files: list[Path] = []
        try:
            if self.task.stop.count < 2:
                files = self._files()
        except (OSError, errors.StorageError) as error:
            # the journal has what was acknowledged, and the error that ended the run is told
            reason += f"; not all files could be written: {error}"
        try:
            self.folder.finish(status, reason, files)
        except (OSError, errors.StorageError) as error:
            self.task.progress(f"could not finish {self.folder.path}: {error}", 1.0)

    # -- what is kept -----------------------------------------------------------------------------

    def _files(self) -> list[Path]:
        """Write what was recorded, and return every file of the run but its journal."""
        files = [] if self.walker is None else self.walker.files()
        plan = self.folder.path / PLAN_NAME
        return [*files, plan] if plan.is_file() else files

    def evaluate(self) -> RunOutcome:
        """Write the records, evaluate them, close the run."""
        free_reserve(self.folder.path)
        files = self._files()
        records = None if self.walker is None else self.walker.records()
        if records is None:
            self.folder.finish("incomplete", "no data", files)
            raise errors.DataError(
                "the run recorded nothing", where=str(self.folder.path), fix="run again with -v"
            )
        doubts = () if self.walker is None else self.walker.doubts()
        try:
            found = evaluate(
                self.task.kind,
                records,
                self.task.profile,
                self.task.scale,
                self.task.model,
                run=self.folder.run_id,
                doubts=doubts,
            )
        except errors.DataError as error:
            self.folder.finish("complete", f"recorded, not evaluated: {error.what}", files)
            raise
        if self.task.stop.first is not None:
            raise self._stopped(StopRequested(self.task.stop.first))
        reason = "done" if not doubts else "done; data doubtful: " + "; ".join(doubts)
        store_evaluation(self.folder, found, files, reason)
        return RunOutcome(self.folder, found[0], doubts)


def make_walker(task: Task, bench: Bench, identity: Identity, journal: JournalWriter) -> Walker:
    """Return what walks a task."""
    if task.kind == "calibration":
        talk = _talk(task, simulated=bench.simulation is not None)
        if bench.simulation is None and not talk.attended:
            raise _needs_person(task, identity)
        return CalibrationWalk(task, bench, journal, talk, _operator_with_mistakes(task, bench))
    operator, embedded = _at_motion(task, bench, identity)
    moved = [put for put in task.plan.loads if put.load.torque_nm and not put.load.locked]
    if bench.simulation is not None and moved:
        raise errors.UsageError(
            f"{moved[0].describe()}: a simulated bench has loads only while it is locked",
            where=f"{task.kind} run",
            fix="make the plan with hdbench plan --no-loads, or run it on a real bench",
        )
    return Runner(task, bench, operator, journal, person=not embedded)


def _needs_person(task: Task, identity: Identity) -> errors.UsageError:
    return errors.UsageError(
        f"{identity.vendor} {identity.model} at an address is taken for a real bench, which needs "
        "a person",
        where=f"{task.kind} run",
        fix="run without --no-input; motion alone can be confirmed with --yes; an emulator takes a "
        "simulated operator with --control",
    )


def _at_motion(task: Task, bench: Bench, identity: Identity) -> tuple[Operator, bool]:
    """Return who is asked, and whether this process started the bench, so that nobody need be."""
    person, simulation = task.options.operator, bench.simulation
    if simulation is not None and simulation.embedded:
        return SimulatedOperator(bench), True
    if person is None:
        raise _needs_person(task, identity)
    if simulation is not None:
        return SimulatedOperator(bench, motion=person.confirm_motion), False
    return person, False


def _talk(task: Task, *, simulated: bool) -> Conversation:
    """Return who answers: the person, or a rule at a simulated bench that nobody rehearses on."""
    talk = task.options.talk
    if talk is None:
        return Unattended(lambda line: task.progress(line, 0.0))
    if talk.attended and simulated and not task.options.rehearse:
        return Unattended(lambda line: talk.tell(line, remarkable=True))
    return talk


def _operator_with_mistakes(task: Task, bench: Bench) -> SimulatedOperator | None:
    """Return the operator of a simulated bench, with the mistakes that were asked for."""
    if bench.simulation is None:
        return None
    options, shunt = task.options, task.profile.data.calibration.shunt
    return SimulatedOperator(
        bench,
        Mistakes(options.mistakes, weights_of(task.plan.points), options.seed),
        shunt_ohm=0.0 if shunt is None else shunt.resistor_ohm,
        fresh=bench.simulation.embedded,
    )
