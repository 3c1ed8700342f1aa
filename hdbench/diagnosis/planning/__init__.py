"""Which run separates which causes: confusability, proposed protocols, plan files."""

from __future__ import annotations

from hdbench.diagnosis.planning.blocks import blocks, full_protocol
from hdbench.diagnosis.planning.confusability import compare
from hdbench.diagnosis.planning.frame import Noise
from hdbench.diagnosis.planning.motion import planned_motion, planned_trace
from hdbench.diagnosis.planning.planfile import plan_text, plan_to_dict, read_plan, write_plan
from hdbench.diagnosis.planning.planlimits import check_motion_plan
from hdbench.diagnosis.planning.proposal import (
    Proposal,
    effects_named,
    plan_for_result,
    propose,
    settled_by,
)
from hdbench.diagnosis.planning.report import PlanReport, PlanRequest, make_report, report_dict
from hdbench.diagnosis.planning.segments import LoadStep, MotionPlan, Segment

__all__ = [
    "LoadStep",
    "MotionPlan",
    "Noise",
    "PlanReport",
    "PlanRequest",
    "Proposal",
    "Segment",
    "blocks",
    "check_motion_plan",
    "compare",
    "effects_named",
    "full_protocol",
    "make_report",
    "plan_for_result",
    "plan_text",
    "plan_to_dict",
    "planned_motion",
    "planned_trace",
    "propose",
    "read_plan",
    "report_dict",
    "settled_by",
    "write_plan",
]
