"""Plan files as runs: acquisitions with a program each, and what the operator does between them."""

from __future__ import annotations

from hdbench.diagnosis.planning.planlimits import check_motion_plan
from hdbench.diagnosis.planning.segments import (
    LoadStep,
    MotionPlan,
    Stage,
    plan_stages,
    program_of,
)
from hdbench.errors import UsageError
from hdbench.profile.schema import ProfileData
from hdbench.session.plans import Acquire, Lock, Place, Plan, Put, Step

__all__ = ["motion_plan"]


def motion_plan(kind: str, asked: MotionPlan, profile: ProfileData) -> Plan:
    """Plan what a plan file asks for."""
    problems = check_motion_plan(asked, profile)
    if problems:
        first = problems[0]
        raise UsageError(first.what, where=first.where, fix=first.fix, problems=tuple(problems))
    places = sorted({load.position_rad for load in asked.loads if load.locked})
    steps: list[Step] = []
    # a plan that begins with motion has asked for the free motor already
    before = None if isinstance(asked.steps[0], LoadStep) else LoadStep("no load", 0.0)
    for entry in asked.steps:
        if isinstance(entry, LoadStep):
            steps += _loading(entry, before, places, profile)
            before = entry
    stages = plan_stages(asked)
    if not steps or stages[0].load is None:
        steps = [Lock(locked=False), _acquire(stages[0], profile, asked), *steps]
        stages = stages[1:]
    for stage in stages:
        at = next(i for i, s in enumerate(steps) if isinstance(s, Put) and s.load is stage.load)
        steps.insert(at + 1, _acquire(stage, profile, asked))
    return Plan(kind, tuple(steps), asked.duration_s, asked)


def _loading(
    load: LoadStep, before: LoadStep | None, places: list[float], profile: ProfileData
) -> list[Step]:
    """Return what the operator does for one load step after another."""
    steps: list[Step] = []
    if before is None or before.locked is not load.locked:
        steps.append(Lock(locked=load.locked))
    moved = before is None or not before.locked or before.position_rad != load.position_rad
    if load.locked and moved:
        steps.append(Place(load.position_rad, places.index(load.position_rad) + 1, len(places)))
    lever_nm_per_kg = profile.arm.gravity_m_s2 * profile.arm.length_m
    steps.append(Put(load, abs(load.torque_nm) / lever_nm_per_kg))
    return steps


def _acquire(stage: Stage, profile: ProfileData, asked: MotionPlan) -> Acquire:
    """Return what is recorded under one load."""
    nothing = LoadStep("no load", 0.0)
    program = program_of(stage, profile)
    still = stage.load is not None and stage.load.locked
    period = profile.daq.sample_period_s
    return Acquire(
        None if still else program,
        period,
        program.n_samples * period,
        (stage.load or nothing) if asked.loads else None,
    )
