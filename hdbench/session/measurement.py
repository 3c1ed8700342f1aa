"""A plan on an open bench: motion with its recorder, or a calibration with its conversation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path

from hdbench.devices import SimulatedOperator
from hdbench.devices.bench import Bench, Identity, Operator, SafeState
from hdbench.devices.operator import Mistakes
from hdbench.errors import UsageError
from hdbench.records import Loads, Trace
from hdbench.records.counted import (
    JournalSamples,
    SampleGroup,
    all_samples,
    journal_loads,
    survey_samples,
    write_sequence,
)
from hdbench.records.journal import JournalContent, JournalWriter, read_journal
from hdbench.records.loads import read_sequence, write_loads
from hdbench.records.runfolder import RunFolder, utc_now
from hdbench.session.calibrating.conversation import Conversation, Unattended
from hdbench.session.calibrating.plausibility import WeightSet
from hdbench.session.calibrating.state import CalibrationLog, CalibrationState, Mounting
from hdbench.session.calibrating.walk import CalibrationWalk
from hdbench.session.options import Task
from hdbench.session.plans import Plan
from hdbench.session.recorder import TraceRecorder
from hdbench.session.runner import Runner


@dataclass(slots=True)
class MotionWalk:
    """A run with motion."""

    runner: Runner
    plan: Plan
    folder: RunFolder
    content: JournalContent | None = None
    _earlier: JournalSamples | None = field(default=None, init=False)

    @property
    def safe(self) -> SafeState | None:
        """What was read back after making the bench safe."""
        return self.runner.safe

    def run(self) -> None:
        """Walk the plan but for the acquisitions that earlier sessions completed."""
        done = set()
        if self.content is not None:
            self._earlier = all_samples(self.content)
            self.runner.recorder.take_over(self._earlier)
            done = {g.step for g in self._earlier.groups if g.complete and g.step is not None}
        self.runner.run(self.plan, done)

    def records(self) -> Trace | Loads | None:
        """Return the trace."""
        samples = self._samples()
        return samples.trace(str(self.folder.trace)) if samples else None

    def _samples(self) -> JournalSamples | None:
        """Return what counts of the journal: not what earlier sessions broke off."""
        if not self.folder.journal.exists():
            return None
        broken = {(group.step, group.attempt) for group in self._broken_off()}
        found = survey_samples(
            self.folder.journal, lambda group: (group.step, group.attempt) not in broken
        )
        return found if len(found) else None

    def files(self) -> list[Path]:
        """Write the trace, and the acquisitions that were broken off and repeated, one each."""
        samples = self._samples()
        written = []
        if samples is not None:
            samples.write(self.folder.trace)
            written.append(self.folder.trace)
        for number, group in enumerate(self._broken_off(), start=1):
            path = self.folder.path / f"trace-broken-off-{number}.csv"
            if self._earlier is not None:
                self._earlier.only(group).write(path)
            written.append(path)
        return written

    def _broken_off(self) -> list[SampleGroup]:
        """Return the acquisitions that earlier sessions broke off."""
        groups = () if self._earlier is None else self._earlier.groups
        return [group for group in groups if not group.complete]

    def doubts(self) -> tuple[str, ...]:
        """Return losses, saturation and a torque that did not change."""
        recorder = self.runner.recorder
        counted = (
            (recorder.lost, "samples lost"),
            (recorder.saturated, "samples saturated"),
            (recorder.held, "samples of the torque that did not change while the motor turned"),
        )
        return tuple(f"{count} {what}" for count, what in counted if count)


@dataclass(slots=True)
class LoadsWalk:
    """A calibration."""

    walk: CalibrationWalk
    folder: RunFolder

    @property
    def safe(self) -> SafeState | None:
        """What was read back after making the bench safe."""
        return self.walk.safe

    def run(self) -> None:
        """Walk what is still to do."""
        self.walk.run()

    def records(self) -> Trace | Loads | None:
        """Return the readings that count, as the journal has them."""
        if not self.walk.log.state.standing:
            return None
        content = read_journal(self.folder.journal)
        loads = journal_loads(content, str(self.folder.loads))
        course = read_sequence(write_sequence(self.folder.path, content))
        return replace(loads, metadata={**loads.metadata, "sequence": course})

    def files(self) -> list[Path]:
        """Write the readings that count, and the course of the calibration."""
        files = [write_sequence(self.folder.path, read_journal(self.folder.journal))]
        records = self.records()
        if isinstance(records, Loads):
            write_loads(self.folder.loads, records)
            files.insert(0, self.folder.loads)
        return files

    def doubts(self) -> tuple[str, ...]:
        """Return unsettled, saturated, doubtful and skipped readings."""
        state = self.walk.log.state
        flags = [str(body.get("flags", "")).split(";") for body in state.standing.values()]
        words: tuple[tuple[Callable[[list[str]], bool], str], ...] = (
            (
                lambda found: bool({"timeout", "not-settled"} & set(found)),
                "readings taken before they had settled",
            ),
            (lambda found: "saturated" in found, "readings saturated"),
            (
                lambda found: "confirmed-gross-error" in found,
                "readings kept although they do not fit their weight",
            ),
        )
        counted = [(sum(map(applies, flags)), what) for applies, what in words]
        counted.append((len(state.skipped), "points skipped"))
        checks = [str(body.get("flags")) for body in state.prepared.values() if body.get("flags")]
        return (
            *(f"{count} {what}" for count, what in counted if count),
            *(f"check before the first weight: {flag}" for flag in checks),
        )


Walker = MotionWalk | LoadsWalk


def make_walker(task: Task, bench: Bench, identity: Identity, journal: JournalWriter) -> Walker:
    """Return what walks a task."""
    if task.kind == "calibration":
        return _loads_walk(task, bench, identity, journal)
    return _motion_walk(task, bench, identity, journal)


def _needs_person(task: Task, identity: Identity) -> UsageError:
    return UsageError(
        f"{identity.vendor} {identity.model} at an address is taken for a real bench, which needs "
        "a person",
        where=f"{task.kind} run",
        fix="run without --no-input; motion alone can be confirmed with --yes; an emulator takes a "
        "simulated operator with --control",
    )


def _motion_walk(
    task: Task, bench: Bench, identity: Identity, journal: JournalWriter
) -> MotionWalk:
    operator, embedded = _at_motion(task, bench, identity)
    moved = [put for put in task.plan.loads if put.load.torque_nm and not put.load.locked]
    if bench.simulation is not None and moved:
        raise UsageError(
            f"{moved[0].describe()}: a simulated bench has loads only while it is locked",
            where=f"{task.kind} run",
            fix="make the plan with hdbench plan --no-loads, or run it on a real bench",
        )
    data = task.profile.data
    gain = task.scale.gain_nm_per_v.value
    recorder = TraceRecorder(data, gain, task.model, journal, data.daq.sample_period_s)
    runner = Runner(
        data,
        bench,
        operator,
        task.stop,
        task.progress,
        recorder,
        person=not embedded,
        watcher=task.options.watcher,
    )
    return MotionWalk(runner, task.plan, task.folder, task.content)


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


def _loads_walk(task: Task, bench: Bench, identity: Identity, journal: JournalWriter) -> LoadsWalk:
    options, data = task.options, task.profile.data
    simulated = bench.simulation is not None
    talk = _talk(task, simulated=simulated)
    if not (talk.attended or simulated):
        raise _needs_person(task, identity)
    log = CalibrationLog(journal, CalibrationState(task.plan.points))
    if task.content is not None:
        log.replay(task.content)
    operator = _simulated_operator(task, bench) if simulated else None
    # samples tell the time of a bench that does not keep real time
    started = datetime.fromisoformat(str(task.folder.manifest["started_utc"]))
    timed = not simulated or options.realtime
    walk = CalibrationWalk(
        data,
        bench,
        log,
        talk,
        Mounting(data, log, operator),
        task.stop,
        task.progress,
        str(task.folder.path),
        clock=(lambda: (utc_now() - started).total_seconds()) if timed else None,
    )
    return LoadsWalk(walk, task.folder)


def _talk(task: Task, *, simulated: bool) -> Conversation:
    """Return who answers: the person, or a rule at a simulated bench that nobody rehearses on."""
    talk = task.options.talk
    if talk is None:
        return Unattended(lambda line: task.progress(line, 0.0))
    if talk.attended and simulated and not task.options.rehearse:
        return Unattended(lambda line: talk.tell(line, remarkable=True))
    return talk


def _simulated_operator(task: Task, bench: Bench) -> SimulatedOperator:
    """Return the operator of a simulated bench, with the mistakes that were asked for."""
    options, plan = task.options, task.profile.data.calibration
    weights_kg = WeightSet.of(task.plan.points, task.profile.data).weights_kg
    mistakes = Mistakes(options.mistakes, weights_kg, options.seed)
    return SimulatedOperator(
        bench,
        mistakes,
        shunt_ohm=0.0 if plan.shunt is None else plan.shunt.resistor_ohm,
        fresh=bench.simulation is not None and bench.simulation.embedded,
    )
