"""Diagnosis of a dynamic run: measured against simulated, causes named, model extended."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.acquisition.acquire import inspect_channels, moving_causes
from hdbench.diagnosis.acquisition.late import noise_law, speed_noise_cause, still_left
from hdbench.diagnosis.acquisition.latespikes import explained_spikes, late_spikes
from hdbench.diagnosis.acquisition.masked import masked_causes
from hdbench.diagnosis.acquisition.measure import baseline_residual
from hdbench.diagnosis.acquisition.named import Acquired
from hdbench.diagnosis.acquisition.task import Clean, Task, cleaned, task_of, unfit, with_terms
from hdbench.diagnosis.answer.assemble import Answer
from hdbench.diagnosis.answer.result import Diagnosis
from hdbench.diagnosis.detect.looks import SHARES
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.measured.baselineterms import parse_baseline
from hdbench.diagnosis.measured.preflight import Preflight
from hdbench.diagnosis.measured.record import Beyond, Record, prepare_record
from hdbench.diagnosis.naming.challengers import TESTS
from hdbench.diagnosis.naming.jumps import rate_times_speed
from hdbench.diagnosis.search import Found, search
from hdbench.model import BenchModel, Cause
from hdbench.profile import Profile
from hdbench.records.trace import Trace

__all__ = ["diagnose_trace"]


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
    causes: tuple[Cause, ...] = (),
    baseline: tuple[str, ...] = (),
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
        Called with what is being done and the share done in [0, 1], which never falls.
    causes : tuple of Cause
        Causes beside the catalogue and the model's own.
    baseline : tuple of str
        Terms of the baseline to add or remove, as `parse_baseline` reads them.

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
    task = replace(task_of(profile, model, causes, alpha), change=parse_baseline(baseline))
    report = _rising(progress or _silent)
    settings: dict[str, object] = {"alpha": alpha, "materiality": materiality, "seed": seed}
    if baseline:
        settings["baseline"] = list(baseline)
    rng = np.random.default_rng(seed)
    inspected = inspect_channels(trace, profile.data, task.given, task.prepare, report)
    if inspected.reason:
        return _data_bad(task.given, inspected.preflight, settings, inspected.reason)
    report("fitting the baseline", 0.04)
    clean = cleaned(task, inspected, settings)
    reason = unfit(clean.record)
    if reason:
        return _data_bad(task.given, clean.preflight, settings, reason)
    known = task.known_terms()
    found, clean = _searched(task, clean, known, rng, report)
    report("naming faults of the acquisition", 0.94)
    acquired, found = _acquired(task, clean, found, rng)
    report("measuring the gain on held-out blocks", 0.95)
    told = tuple(one.cause for one in acquired)
    flagged = clean.flagged(acquired)
    parts = (found.record, task.of_the_torque(), flagged, found, len(known), materiality, rng, told)
    answer = Answer(*parts).build(settings)
    report("done", 1.0)
    return _complete(answer, task, acquired)


def _complete(answer: Diagnosis, task: Task, acquired: list[Acquired]) -> Diagnosis:
    """Return the answer with faults of the acquisition among the terms of its models."""
    model = with_terms(answer.model, task.held_terms(), acquired)
    return replace(
        answer,
        model=model,
        simulated={**answer.simulated, "terms": list(task.given.terms())},
        extended={**answer.extended, "terms": list(model.terms())},
    )


def _rising(report: Callable[[str, float], None]) -> Callable[[str, float], None]:
    """Return a callback that never hands on a share below one handed on before."""
    highest = 0.0

    def rising(what: str, share: float) -> None:
        nonlocal highest
        highest = min(1.0, max(highest, share))
        report(what, highest)

    return rising


def _searched(
    task: Task,
    clean: Clean,
    known: tuple[Term, ...],
    rng: np.random.Generator,
    report: Callable[[str, float], None],
) -> tuple[Found, Clean]:
    """Return what the search finds, once more where spikes only show in its residual."""
    found = _search(task, clean, known, rng, report)
    spikes = clean.above_steps(late_spikes(found))
    if spikes.any():
        report("searching again without spikes", 0.9)
        clean = clean.without(spikes)
        found = _search(task, clean, known, rng, report)
    clean = clean.restored(_explained(task, clean, found))
    return _with_jumps(task, clean, found), clean


def _with_jumps(task: Task, clean: Clean, found: Found) -> Found:
    """Return the result with what is left where the acceleration jumps."""
    if found.record.motion.angle_source == "velocity":
        return found
    masked = ~clean.record.valid & ~clean.unresolved
    full = task.prepare(clean.inspected.trace, masked)
    left = rate_times_speed(found, full)
    if left is None or not left.p_value * TESTS < task.alpha * SHARES["tests"]:
        return found
    return replace(found, left=(*found.left, left))


def _explained(task: Task, clean: Clean, found: Found) -> NDArray[np.bool_]:
    """Return the spikes that are none beside the causes; none where the motion was aligned."""
    none = np.zeros(len(clean.spikes), dtype=bool)
    if (
        not (clean.spikes.any() and found.accepted)
        or found.record.motion.angle_source == "velocity"
    ):
        return none
    masked = ~clean.record.valid & ~clean.spikes
    return explained_spikes(found, task.prepare(clean.inspected.trace, masked), clean.spikes)


def _search(
    task: Task,
    clean: Clean,
    known: tuple[Term, ...],
    rng: np.random.Generator,
    report: Callable[[str, float], None],
) -> Found:
    record = clean.record
    unused = ~record.valid

    def align(beyond: Beyond) -> Record:
        trace = clean.inspected.trace
        return prepare_record(trace, task.profile.data, task.given, unused, beyond, task.change)

    return search(
        record,
        task.causes,
        known,
        alpha=task.alpha,
        rng=rng,
        progress=report,
        align=align if record.motion.angle_source == "velocity" else None,
    )


def _acquired(
    task: Task, clean: Clean, found: Found, rng: np.random.Generator
) -> tuple[list[Acquired], Found]:
    """Return the named faults of the acquisition, and the search's result beside them."""
    acquired = moving_causes(clean.inspected, task.prepare, rng)
    acquired += masked_causes(task, clean, rng)
    law = noise_law(found, task.alpha * SHARES["tests"] / TESTS)
    if law is not None:
        square = baseline_residual(clean.record).mean_square
        acquired.append(speed_noise_cause(law, found, square, rng))
        found = still_left(found, law)
    held = {term.name for term in task.held_terms()}
    taken_out = {fault.name for fault in clean.inspected.faults}
    return [one for one in acquired if one.cause.name not in held - taken_out], found


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
