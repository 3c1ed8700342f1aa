"""Walker of a task on an open bench, and who answers its questions."""

from __future__ import annotations

from hdbench.devices import SimulatedOperator
from hdbench.devices.bench import Bench, Identity, Operator
from hdbench.devices.operator import Mistakes
from hdbench.errors import UsageError
from hdbench.records.journal import JournalWriter
from hdbench.session.calibrating.conversation import Conversation, Unattended
from hdbench.session.calibrating.plausibility import weights_of
from hdbench.session.calibrating.walk import CalibrationWalk
from hdbench.session.options import Task
from hdbench.session.runner import Runner

Walker = Runner | CalibrationWalk


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
        raise UsageError(
            f"{moved[0].describe()}: a simulated bench has loads only while it is locked",
            where=f"{task.kind} run",
            fix="make the plan with hdbench plan --no-loads, or run it on a real bench",
        )
    return Runner(task, bench, operator, journal, person=not embedded)


def _needs_person(task: Task, identity: Identity) -> UsageError:
    return UsageError(
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
