"""Which run separates which causes: confusability, proposed protocols, plan files."""

from __future__ import annotations

from hdbench.diagnosis.planning.blockparts import Block
from hdbench.diagnosis.planning.candidates import blocks, full_protocol, joined
from hdbench.diagnosis.planning.confusability import Confusability, compare
from hdbench.diagnosis.planning.motion import planned_motion, planned_trace
from hdbench.diagnosis.planning.planfile import (
    PLAN_SCHEMA,
    plan_text,
    plan_to_dict,
    read_plan,
    write_plan,
)
from hdbench.diagnosis.planning.planlimits import check_motion_plan
from hdbench.diagnosis.planning.propose import Pair, Proposal
from hdbench.diagnosis.planning.questions import effects_named, effects_of_result, settled_by
from hdbench.diagnosis.planning.report import PlanReport, report_dict
from hdbench.diagnosis.planning.segments import LoadStep, MotionPlan, Segment
from hdbench.diagnosis.planning.separate import plan_for_result, propose, separating_plan
from hdbench.diagnosis.planning.signatures import Effect
from hdbench.diagnosis.planning.sketch import Noise
from hdbench.diagnosis.planning.visibility import Visibility
from hdbench.diagnosis.planning.work import PlanRequest, make_report

__all__ = [
    "PLAN_SCHEMA",
    "Block",
    "Confusability",
    "Effect",
    "LoadStep",
    "MotionPlan",
    "Noise",
    "Pair",
    "PlanReport",
    "PlanRequest",
    "Proposal",
    "Segment",
    "Visibility",
    "blocks",
    "check_motion_plan",
    "compare",
    "effects_named",
    "effects_of_result",
    "full_protocol",
    "joined",
    "make_report",
    "plan_for_result",
    "plan_text",
    "plan_to_dict",
    "planned_motion",
    "planned_trace",
    "propose",
    "read_plan",
    "report_dict",
    "separating_plan",
    "settled_by",
    "write_plan",
]
