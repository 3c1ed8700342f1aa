"""Which run separates which causes: confusability, proposed protocols, plan files."""

from __future__ import annotations

from hdbench.diagnosis.planning.planfile import plan_to_dict, read_plan, write_plan
from hdbench.diagnosis.planning.planlimits import check_motion_plan
from hdbench.diagnosis.planning.proposal import Proposal, plan_for_result
from hdbench.diagnosis.planning.report import plan_report
from hdbench.diagnosis.planning.segments import LoadStep, MotionPlan, Segment

__all__ = [
    "LoadStep",
    "MotionPlan",
    "Proposal",
    "Segment",
    "check_motion_plan",
    "plan_for_result",
    "plan_report",
    "plan_to_dict",
    "read_plan",
    "write_plan",
]
