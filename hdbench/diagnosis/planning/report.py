"""What a plan says, as plain data: schema ``hdbench/plan-report/1``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hdbench.diagnosis.planning.confusability import CONFUSABLE, Confusability
from hdbench.diagnosis.planning.planfile import plan_to_dict
from hdbench.diagnosis.planning.propose import Pair, Proposal
from hdbench.diagnosis.planning.questions import settled_by
from hdbench.model import catalogue

__all__ = ["PlanReport", "report_dict"]


@dataclass(frozen=True, slots=True)
class PlanReport:
    """A run at hand, and a run proposed.

    Parameters
    ----------
    source : str
        What the run at hand is.
    at_hand : Confusability
        How alike the causes are there.
    proposal : Proposal
        The proposed run.
    proposed : Confusability or None
        How alike they are there; None where no run is proposed.
    """

    source: str
    at_hand: Confusability
    proposal: Proposal
    proposed: Confusability | None


def report_dict(report: PlanReport, header: Mapping[str, Any]) -> dict[str, Any]:
    """Return a report as ``--json`` prints it.

    Parameters
    ----------
    report : PlanReport
        Report.
    header : mapping
        ``schema``, version and profile.

    Returns
    -------
    dict
        JSON-able, without NaN.
    """
    proposal = report.proposal
    plan = proposal.plan
    return {
        **header,
        "source": report.source,
        "at_hand": _confusability(report.at_hand),
        "proposed": None if report.proposed is None else _confusability(report.proposed),
        "pairs": [_pair(pair) for pair in proposal.pairs],
        "words": list(proposal.words),
        "plan": None if plan is None else plan_to_dict(plan),
        "duration_s": None if plan is None else plan.duration_s,
        "needs_operator": plan is not None and plan.needs_operator,
    }


def _pair(pair: Pair) -> dict[str, Any]:
    known = catalogue()
    body: dict[str, Any] = {
        "first": pair.first,
        "second": pair.second,
        "sin2_at_hand": pair.before,
        "sin2_proposed": pair.after,
        "separated": pair.separated,
        "settled_by": None,
    }
    if not pair.separated and pair.first in known and pair.second in known:
        body["settled_by"] = settled_by(known[pair.first], known[pair.second])
    return body


def _confusability(found: Confusability) -> dict[str, Any]:
    return {
        "duration_s": found.duration_s,
        "visible": [
            {
                "name": entry.name,
                "std_nm": entry.std_nm,
                "detectable_nm": entry.detectable_nm,
                "baseline_share": entry.baseline_share,
            }
            for entry in found.visibility
            if entry.visible
        ],
        "invisible": [{"name": e.name, "reason": e.reason} for e in found.invisible()],
        "inseparable": [list(group) for group in found.inseparable()],
        "contained": [list(pair) for pair in found.contained()],
        "confusable_below": CONFUSABLE,
        "confusable": [{"first": a, "second": b, "sin2": s} for a, b, s in found.confusable()],
    }
