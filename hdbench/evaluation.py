"""Evaluation of one record by its kind, for measured and for stored data."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from hdbench.errors import DataError
from hdbench.filter import FilterModel
from hdbench.profile import Profile
from hdbench.records import Loads, TorqueScale, Trace
from hdbench.results import CalibrationResult, MisalignmentResult, ProfileName, RippleResult
from hdbench.ripple import Stretch

EvaluatedResult = CalibrationResult | MisalignmentResult | RippleResult


def evaluate(
    kind: str,
    records: Trace | Loads,
    profile: Profile,
    *,
    scale: TorqueScale,
    model: FilterModel,
    stretch: Stretch | None = None,
    max_consistency: float | None = None,
    **told: Any,
) -> EvaluatedResult:
    """Evaluate one record.

    Parameters
    ----------
    kind : str
        ``calibration``, ``misalignment`` or ``ripple``.
    records : Trace or Loads
        Its data: loads for a calibration, else a trace.
    profile : Profile
        The bench.
    scale : TorqueScale
        The gain that scaled the torque.
    model : FilterModel
        The filter whose effect is measured.
    stretch : Stretch or None
        Part of a ripple run; None takes all of it.
    max_consistency : float or None
        Limit of a calibration; None takes the profile's.
    **told
        Further keys of the result: ``run``, ``doubts``, ``imported``.

    Returns
    -------
    CalibrationResult, MisalignmentResult or RippleResult

    Raises
    ------
    DataError
        If the data are of another kind or cannot be evaluated.
    """
    from hdbench import __version__

    found: EvaluatedResult
    if isinstance(records, Loads) and kind == "calibration":
        from hdbench.calibration import evaluate_calibration

        limit = profile.data.calibration.max_consistency
        found = evaluate_calibration(
            records,
            max_consistency=limit if max_consistency is None else max_consistency,
            bench=profile.data,
            monte_carlo_seed=0,
        )
    elif isinstance(records, Loads) or kind == "calibration":
        given, needed = "loads", "a trace"
        if kind == "calibration":
            given, needed = needed, given
        raise DataError(
            f"found {given}; {kind} needs {needed}",
            where=records.source,
            fix="name a file of the other kind, or use the command for this one",
        )
    elif kind == "misalignment":
        from hdbench.misalignment import evaluate_misalignment

        found = evaluate_misalignment(records, profile.data, scale=scale, filter_model=model)
    else:
        from hdbench.ripple import evaluate_ripple

        found = evaluate_ripple(
            records, profile.data, scale=scale, filter_model=model, stretch=stretch
        )
    name = ProfileName(name=profile.name, sha256=profile.sha256)
    return replace(found, hdbench_version=__version__, profile=name, **told)
