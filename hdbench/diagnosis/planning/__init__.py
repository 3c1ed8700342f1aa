"""Plans of runs that separate causes: confusability, proposed protocols, plan files."""

from __future__ import annotations

from hdbench.diagnosis.planning.planfile import read_plan, write_plan
from hdbench.diagnosis.planning.proposal import plan_for_causes
from hdbench.diagnosis.planning.report import plan_report
from hdbench.diagnosis.planning.segments import check_motion_plan

__all__ = ["check_motion_plan", "plan_for_causes", "plan_report", "read_plan", "write_plan"]
