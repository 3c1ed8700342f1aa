"""Diagnosis of a dynamic run: measured against simulated, causes named, model extended."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hdbench.diagnosis.answer import Answer
from hdbench.diagnosis.preflight import (
    Preflight,
    find_spikes,
    flag_samples,
    inspect_trace,
)
from hdbench.diagnosis.record import Beyond, Record, mask_samples, prepare_record
from hdbench.diagnosis.resolved import unresolved_motion
from hdbench.diagnosis.result import Diagnosis
from hdbench.diagnosis.search import search
from hdbench.diagnosis.terms import Term
from hdbench.model import (
    BenchModel,
    catalogue,
    cause_named,
)
from hdbench.profile import Profile
from hdbench.records.trace import Trace

__all__ = ["diagnose_trace"]

# fewer usable samples than this per baseline coefficient fit nothing that could be trusted
_SAMPLES_PER_COEFFICIENT = 20


def _silent(_what: str, _share: float) -> None:
    return None


def diagnose_trace(
    trace: Trace,
    profile: Profile,
    *,
    model: BenchModel | None = None,
    alpha: float = 0.01,
    materiality: float = 0.01,
    seed: int = 0,
    progress: Callable[[str, float], None] | None = None,
) -> Diagnosis:
    """Say what the simulation gets wrong on a dynamic run, and why.

    Parameters
    ----------
    trace : Trace
        Channels of a run: torque and motion.
    profile : Profile
        Bench.
    model : BenchModel or None
        Model to hold against the record; the profile's where None. Its causes are fitted, not
        reported.
    alpha : float
        Probability of any finding on a record without an effect, in (0, 1).
    materiality : float
        Smallest share of the baseline's residual variance of a cause that counts, in [0, 1).
    seed : int
        Seed of the draws of the null and the bootstrap.
    progress : callable or None
        Called with what is being done and the share done in [0, 1].

    Returns
    -------
    Diagnosis

    Raises
    ------
    DataError
        If a channel is missing or the trace has no motion.
    ValueError
        If `alpha` or `materiality` is out of its domain.

    Notes
    -----
    ``docs/diagnosis.md`` has the statistics. Two times the same input give the same result.
    """
    if not 0.0 < alpha < 1.0:
        raise ValueError(f"alpha {alpha!r} must be in (0, 1)")
    if not 0.0 <= materiality < 1.0:
        raise ValueError(f"materiality {materiality!r} must be in [0, 1)")
    report = progress or _silent
    given = model or BenchModel.from_profile(profile.data)
    report("inspecting the data", 0.02)
    preflight = inspect_trace(trace, profile.data)
    record = prepare_record(trace, profile.data, given, preflight.masked)
    settings: dict[str, object] = {"alpha": alpha, "materiality": materiality, "seed": seed}
    reason = _unfit(record)
    if not reason:
        unresolved = unresolved_motion(record, profile.data)
        settings["unresolved_motion_samples"] = int((unresolved & record.valid).sum())
        record, preflight = _despiked(mask_samples(record, unresolved), preflight)
        reason = _unfit(record)
    if reason:
        return _data_bad(given, preflight, settings, reason)
    rng = np.random.default_rng(seed)
    known = tuple(
        Term(cause_named(t.name, where="model", extra=given.extra_causes), dict(t.shape), True)
        for t in given.causes
    )
    causes = (*catalogue().values(), *given.extra_causes)
    report("fitting the baseline", 0.05)
    unused = ~record.valid

    def align(beyond: Beyond) -> Record:
        return prepare_record(trace, profile.data, given, unused, beyond)

    integrated = record.motion.angle_source == "velocity"
    found = search(
        record,
        causes,
        known,
        alpha=alpha,
        rng=rng,
        progress=report,
        align=align if integrated else None,
    )
    report("measuring the gain on held-out blocks", 0.95)
    return Answer(found.record, given, preflight, found, len(known), materiality, rng).build(
        settings
    )


def _despiked(record: Record, preflight: Preflight) -> tuple[Record, Preflight]:
    """Return the record without spikes, and the preflight that says so."""
    spikes = find_spikes(record)
    if not spikes.any():
        return record, preflight
    flags = (*preflight.flags, *flag_samples("spikes", record.motion.time_s, spikes))
    return mask_samples(record, spikes), Preflight(flags, preflight.masked | spikes)


def _unfit(record: Record) -> str:
    """Return why no baseline can be fitted, or an empty text."""
    usable, columns = int(record.valid.sum()), record.base.shape[1]
    needed = _SAMPLES_PER_COEFFICIENT * columns
    if usable < needed:
        return f"{usable} usable samples for {columns} baseline coefficients; needed: {needed}"
    torque = record.torque_nm[record.valid]
    if not float(np.ptp(torque)) > 0.0:
        return f"the torque is {float(torque[0]):.6g} N m throughout; needed: a live channel"
    return ""


def _data_bad(
    model: BenchModel, preflight: Preflight, settings: dict[str, object], reason: str
) -> Diagnosis:
    nothing = {"terms": list(model.terms()), "heldout_rms_nm": None}
    return Diagnosis(
        "data-bad",
        (),
        (),
        (),
        (),
        preflight.flags,
        (),
        nothing,
        nothing,
        model,
        settings,
        reason,
    )
