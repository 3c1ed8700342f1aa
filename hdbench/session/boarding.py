"""Bring a task, an open bench and the person beside it together."""

from __future__ import annotations

from datetime import datetime

from hdbench.devices import SimulatedOperator
from hdbench.devices.mistakes import Mistakes
from hdbench.devices.ports import Bench, Identity, Operator
from hdbench.errors import UsageError
from hdbench.records.journal import JournalWriter
from hdbench.records.runfolder import utc_now
from hdbench.session.calibrating.conversation import Conversation, Unattended
from hdbench.session.calibrating.guard import Guard
from hdbench.session.calibrating.mounting import Mounting
from hdbench.session.calibrating.state import CalibrationLog, CalibrationState
from hdbench.session.calibrating.walk import CalibrationWalk
from hdbench.session.recorder import TraceRecorder
from hdbench.session.runner import Runner
from hdbench.session.task import Task
from hdbench.session.walkers import LoadsWalk, MotionWalk, Walker

__all__ = ["make_walker"]


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
        journal,
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
    hands = _hands(task, bench) if simulated else None
    # samples tell the time of a bench that does not keep real time
    started = datetime.fromisoformat(str(task.folder.manifest["started_utc"]))
    timed = not simulated or options.realtime
    walk = CalibrationWalk(
        data,
        bench,
        log,
        talk,
        Mounting(data, log, hands),
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


def _hands(task: Task, bench: Bench) -> SimulatedOperator:
    """Return the operator of a simulated bench, with the mistakes that were asked for."""
    options, plan = task.options, task.profile.data.calibration
    weights_kg = Guard.of(task.plan.points, task.profile.data).weights_kg
    mistakes = Mistakes(options.mistakes, weights_kg, options.seed)
    return SimulatedOperator(
        bench,
        mistakes,
        shunt_ohm=0.0 if plan.shunt is None else plan.shunt.resistor_ohm,
        fresh=bench.simulation is not None and bench.simulation.embedded,
    )
