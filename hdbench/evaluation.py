"""Evaluation of one record by its kind, for measured and for stored data."""

from __future__ import annotations

from dataclasses import replace

from hdbench.errors import DataError
from hdbench.filter import FilterModel
from hdbench.profile import Profile
from hdbench.records import Loads, TorqueScale, Trace
from hdbench.results import MisalignmentResult, ProfileName, RippleResult
from hdbench.ripple import Stretch

__all__ = ["evaluate"]


def evaluate(
    kind: str,
    records: Trace | Loads,
    profile: Profile,
    *,
    scale: TorqueScale,
    model: FilterModel,
    stretch: Stretch | None = None,
) -> MisalignmentResult | RippleResult:
    """Evaluate one record.

    Parameters
    ----------
    kind : str
        ``misalignment`` or ``ripple``.
    records : Trace or Loads
        Its data.
    profile : Profile
        The bench.
    scale : TorqueScale
        The gain that scaled the torque.
    model : FilterModel
        The filter whose effect is measured.
    stretch : Stretch or None
        Part of a ripple run; None takes all of it.

    Returns
    -------
    MisalignmentResult or RippleResult

    Raises
    ------
    DataError
        If the data are of another kind or cannot be evaluated.
    """
    from hdbench import __version__

    if isinstance(records, Loads):
        raise DataError(
            f"found loads; {kind} needs a trace",
            where=records.source,
            fix="name a file of the other kind, or use the command for this one",
        )
    found: MisalignmentResult | RippleResult
    if kind == "misalignment":
        from hdbench.misalignment import evaluate_misalignment

        found = evaluate_misalignment(records, profile.data, scale=scale, filter_model=model)
    else:
        from hdbench.ripple import evaluate_ripple

        found = evaluate_ripple(
            records, profile.data, scale=scale, filter_model=model, stretch=stretch
        )
    name = ProfileName(name=profile.name, sha256=profile.sha256)
    return replace(found, hdbench_version=__version__, profile=name)
