"""Plans as data, the safe runner, and the experiments made of them."""

from __future__ import annotations

from hdbench.session.evaluation import evaluate_stored
from hdbench.session.experiments import make_plan, run_experiment
from hdbench.session.options import BenchOptions, RunOutcome
from hdbench.session.plans import Plan
from hdbench.session.stop import Aborted

__all__ = [
    "Aborted",
    "BenchOptions",
    "Plan",
    "RunOutcome",
    "evaluate_stored",
    "make_plan",
    "run_experiment",
]
