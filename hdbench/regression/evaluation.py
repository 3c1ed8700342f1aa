"""Evaluate a stored input with the code as it stands."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np

from hdbench.evaluation import evaluate
from hdbench.filter import FilterModel, filter_trace, load_filter_model
from hdbench.profile import Profile, load_profile
from hdbench.profile.scaling import profile_scale, rescaled
from hdbench.records import Loads, TorqueScale, Trace
from hdbench.records.loads import read_loads
from hdbench.records.tracefile import read_trace
from hdbench.regression.case import Case
from hdbench.results.dynamic import FilteredTrace
from hdbench.ripple import Stretch

# points of a filtered torque that are stored: enough to see where it moved
_POINTS = 50
# keys that name versions and identities, not results
_NO_RESULT = ("hdbench_version", "profile", "run", "doubts", "settings")
# keys of a diagnosis that its run folder adds
_OF_A_RUN = (
    *("input", "input_sha256", "torque_scale", "part", "inspection"),
    *("filter_gain", "separating_run"),
)


def evaluate_case(case: Case) -> dict[str, Any]:
    """Return the result of a case."""
    profile = load_profile(case.profile)
    records: Trace | Loads
    if case.kind == "calibration":
        records, scale = read_loads(case.source, profile.data.arm), profile_scale(profile)
    else:
        trace = read_trace(case.source)
        records, scale = rescaled(trace, profile, calibration=None, stored=case.scale)
    result = _result(case, profile, records, scale)
    return {key: value for key, value in result.items() if key not in _NO_RESULT}


def _result(
    case: Case, profile: Profile, records: Trace | Loads, scale: TorqueScale
) -> dict[str, Any]:
    if case.kind == "diagnosis" and isinstance(records, Trace):
        return _diagnosis(case, profile, records)
    model = load_filter_model(case.filter_name or profile.data.filter.model, profile.data)
    if case.kind == "filter" and isinstance(records, Trace):
        return _filtered(records, model, profile).to_json()
    stretch = Stretch(**case.options) if case.kind == "ripple" and case.options else None
    return evaluate(
        case.kind,
        records,
        profile,
        scale=scale,
        model=model,
        stretch=stretch,
        max_consistency=case.options.get("max_consistency"),
    ).to_json()


def _filtered(trace: Trace, model: FilterModel, profile: Profile) -> FilteredTrace:
    torque_nm = filter_trace(trace, model, profile.data).torque_filtered_nm
    good = torque_nm[np.isfinite(torque_nm)]
    at = np.linspace(0, len(good) - 1, min(_POINTS, len(good))).astype(int)
    return FilteredTrace(
        filter_name=model.name,
        n_samples=len(torque_nm),
        n_present=len(good),
        torque_filtered_rms_nm=float(np.sqrt(np.mean(good**2))),
        torque_filtered_min_nm=float(good.min()),
        torque_filtered_max_nm=float(good.max()),
        samples_nm=tuple(good[at].tolist()),
        sha256=hashlib.sha256(np.ascontiguousarray(torque_nm, dtype="<f8").tobytes()).hexdigest(),
    )


def _diagnosis(case: Case, profile: Profile, trace: Trace) -> dict[str, Any]:
    from hdbench.diagnosis import diagnose_trace
    from hdbench.diagnosis.run import part_of

    held, _ = part_of(trace, case.options.get("from_s"), case.options.get("to_s"))
    found = diagnose_trace(
        held,
        profile,
        alpha=float(case.options.get("alpha", 0.01)),
        materiality=float(case.options.get("materiality", 0.01)),
        seed=int(case.options.get("seed", 0)),
    )
    return {key: value for key, value in found.to_json().items() if key not in _OF_A_RUN}
