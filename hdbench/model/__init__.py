"""The simulation: motion, baseline terms, causes, reference waves and model files."""

from __future__ import annotations

from hdbench.model.bench import (
    BenchModel,
    baseline_columns,
    baseline_orders,
    term_torque_nm,
    with_signal,
)
from hdbench.model.cause import (
    catalogue,
    cause_named,
    cause_parameters,
    check_term,
    describe_causes,
    user_causes,
)
from hdbench.model.causefile import load_causes
from hdbench.model.causes._memory import first_order
from hdbench.model.definition import Cause, CauseTerm, Parameter, amplitude_phase, shape_bounds
from hdbench.model.modelfile import load_model, save_model
from hdbench.model.motion import Motion, gauge_order_factor, integrate_velocity, motion_from_trace
from hdbench.model.simulate import simulate_like, simulate_run, with_noise

__all__ = [
    "BenchModel",
    "Cause",
    "CauseTerm",
    "Motion",
    "Parameter",
    "amplitude_phase",
    "baseline_columns",
    "baseline_orders",
    "catalogue",
    "cause_named",
    "cause_parameters",
    "check_term",
    "describe_causes",
    "first_order",
    "gauge_order_factor",
    "integrate_velocity",
    "load_causes",
    "load_model",
    "motion_from_trace",
    "save_model",
    "shape_bounds",
    "simulate_like",
    "simulate_run",
    "term_torque_nm",
    "user_causes",
    "with_noise",
    "with_signal",
]
