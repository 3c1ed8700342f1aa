"""Diagnosis of a dynamic run: measured against simulated, causes named, model extended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.answer.assemble import Findings, assemble
from hdbench.diagnosis.answer.result import Diagnosis, data_bad
from hdbench.diagnosis.discovery.bands import LowPass
from hdbench.diagnosis.discovery.baseline import BaselineChange, parse_baseline
from hdbench.diagnosis.discovery.channel import DELAY, start_fit
from hdbench.diagnosis.discovery.fit import Fit
from hdbench.diagnosis.discovery.record import Record, as_followed, on_clock, prepare_record
from hdbench.diagnosis.discovery.rest import residual_nm, whitened_nm
from hdbench.diagnosis.discovery.search import Search, search
from hdbench.diagnosis.discovery.term import Term
from hdbench.diagnosis.discovery.together import piece_searches, search_together
from hdbench.diagnosis.evidence import Told, check_rates, silent
from hdbench.diagnosis.faults.channels import inspect_channels
from hdbench.diagnosis.faults.converter import coarse_steps
from hdbench.diagnosis.faults.fault import Inspected
from hdbench.diagnosis.faults.residual import ResidualFaults, faults_of_residual
from hdbench.diagnosis.faults.scatter import same_noise
from hdbench.diagnosis.faults.shaft import ANGLES, VELOCITIES
from hdbench.model import BenchModel, Cause, catalogue
from hdbench.model.motion import torque_from_trace
from hdbench.profile import Profile
from hdbench.records.trace import Trace
from hdbench.system.memory import memory_kept

# fewest usable samples for each coefficient of the baseline
_SAMPLES_PER_COEFFICIENT = 10
# noise ahead of a coarse converter, in steps, of which the likeliest is taken
_DITHERS = (0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5)


class Asked(TypedDict, total=False):
    """What a diagnosis of dynamic runs can be asked for."""

    # to hold against the record, the profile's where None; its causes are fitted, not reported
    model: BenchModel | None
    alpha: float  # probability of any finding on a record without an effect, in (0, 1); .01
    # smallest share of the baseline's residual variance of a cause that counts, in [0, 1); .01
    materiality: float
    seed: int  # of the draws of the null and the bootstrap; 0
    causes: Sequence[Cause]  # beside the catalogue and the model's own
    # terms of the baseline to add or remove, as `parse_baseline` reads them
    baseline: Sequence[str]


@dataclass(frozen=True, slots=True)
class Task:
    """What is asked: bench, model, catalogue, rates and change of the baseline."""

    profile: Profile
    given: BenchModel
    causes: dict[str, Cause]
    alpha: float
    materiality: float
    seed: int
    change: BaselineChange
    settings: dict[str, object]  # as the result states them

    def known(self) -> tuple[Term, ...]:
        """Return the causes that the model already holds, as terms of the fit."""
        return tuple(
            Term(self.causes[term.name], dict(term.shape), known=True)
            for term in self.given.causes
            if self.causes[term.name].additive and term.name != DELAY
        )

    def late_s(self) -> float:
        """Return the delay of the torque channel that the model already holds, s."""
        skews = [term.linear[0] for term in self.given.causes if term.name == DELAY]
        return float(sum(skews))


@memory_kept()
def diagnose_trace(
    trace: Trace, profile: Profile, *, progress: Told = silent, **asked: Unpack[Asked]
) -> Diagnosis:
    """Say what the simulation gets wrong on a dynamic run, and why.

    Parameters
    ----------
    trace : Trace
        Channels of a run: torque and motion.
    profile : Profile
        Bench.
    progress : callable
        Called with what is being done and the share done in [0, 1], which never falls.
    **asked : Asked
        Model, rates, seed, further causes and the baseline.

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
    ``docs/diagnosis.md`` has the model. Two times the same input give the same result.
    """
    task = make_task(profile, **asked)
    progress("inspecting the channels", 0.0)
    ready = make_ready(task, trace)
    if isinstance(ready, Inspected):
        given = task.given
        return data_bad(given, given.terms(), ready.flags, task.settings, ready.reason)
    rng = np.random.default_rng(task.seed)
    found, (late,) = searched(task, [ready], rng, progress)
    progress("measuring the gain on held-out blocks", 0.9)
    answer = assemble(findings_of(task, ready, found, late), task.settings, rng)
    progress("done", 1.0)
    return answer


def make_task(
    profile: Profile,
    model: BenchModel | None = None,
    alpha: float = 0.01,
    materiality: float = 0.01,
    seed: int = 0,
    causes: Sequence[Cause] = (),
    baseline: Sequence[str] = (),
) -> Task:
    """Return what is asked; ValueError where a rate is out of its domain."""
    check_rates(alpha, materiality)
    given = (model or BenchModel.from_profile(profile.data)).with_extra(causes)
    every = dict(catalogue(given.extra_causes))
    settings: dict[str, object] = {"alpha": alpha, "materiality": materiality, "seed": seed}
    if baseline:
        settings["baseline"] = list(baseline)
    change = parse_baseline(baseline)
    return Task(profile, given, every, alpha, materiality, seed, change, settings)


@dataclass(frozen=True, slots=True)
class Ready:
    """A record that can be searched: its channels, what is left of it, and its early spikes."""

    inspected: Inspected
    record: Record
    spikes: NDArray[np.bool_]


def make_ready(task: Task, trace: Trace) -> Ready | Inspected:
    """Return a trace as a record that can be searched, or its channels with why it cannot be."""
    inspected = inspect_channels(trace, task.profile.data, task.given, alpha=task.alpha)
    inspected = _without_own_current(inspected, task.profile)
    if inspected.reason:
        return inspected
    record = _read(task, inspected)
    reason = _unfit(record)
    if reason:
        return replace(inspected, reason=reason)
    return Ready(inspected, *_cleaned(task, inspected, record))


def findings_of(task: Task, ready: Ready, found: Search, late: ResidualFaults) -> Findings:
    """Return everything from which the answer on a record is put together."""
    inspected, undone = ready.inspected, {}
    for fault in inspected.faults:
        if fault.undone is not None:
            read = _read(task, replace(inspected, trace=fault.undone))
            fit = start_fit(_prepared(task, read, ready.record.low_pass), task.known())
            left = residual_nm(fit)[fit.record.valid]
            undone[fault.name] = float(np.sqrt(np.mean(left**2)))
    return Findings(found, task.given, inspected, late, undone, task.materiality, task.causes)


def _read(task: Task, inspected: Inspected) -> Record:
    """Return a record before the channel of its torque is known."""
    trace, masked, added = on_clock(inspected.trace, inspected.masked)
    record = prepare_record(trace, task.profile.data, task.given, masked, task.change)
    motion = record.motion
    if any(made in VELOCITIES and of in ANGLES for made, of in inspected.derived):
        # such a velocity has the error of the angle
        motion = replace(motion, acceleration_source="angle")
    return replace(record, motion=motion, added=added)


def _prepared(task: Task, record: Record, *channel: LowPass | None) -> Record:
    """Return a record ready for a fit, behind the low-pass of its channel where that is known."""
    for low_pass in channel:
        record = record.behind(low_pass)
    if "expected-torque" not in task.change.without:
        record = as_followed(record)
    late = task.late_s()
    motion = task.given.signal_motion(record.motion)
    return replace(record, motion=motion, late_s=late, late_known=late != 0.0)


def _without_own_current(inspected: Inspected, profile: Profile) -> Inspected:
    """Return the channels without a current of which the torque was computed."""
    trace = inspected.trace
    if "motor_current_a" not in trace or inspected.reason:
        return inspected
    # where the torque is masked the current may be interpolated
    torque = np.where(inspected.masked, np.nan, torque_from_trace(trace, profile.data))
    if not same_noise(torque, trace["motor_current_a"]):
        return inspected
    kept = {k: v for k, v in trace.columns.items() if k != "motor_current_a"}
    derived = (*inspected.derived, ("torque_nm", "motor_current_a"))
    return replace(inspected, trace=Trace(kept, source=trace.source), derived=derived)


def _unfit(record: Record) -> str:
    """Return why no baseline can be fitted; empty where one can."""
    usable, columns = int(record.valid.sum()), record.columns.shape[1]
    needed = _SAMPLES_PER_COEFFICIENT * columns
    if usable < needed:
        return f"{usable} usable samples for {columns} baseline coefficients; needed: {needed}"
    torque = record.torque_nm[record.valid]
    if not float(np.ptp(torque)) > 0.0:
        return f"the torque is {float(torque[0]):.6g} N m throughout; needed: a live channel"
    return ""


def searched(
    task: Task, ready: Sequence[Ready], rng: np.random.Generator, report: Told
) -> tuple[Search, list[ResidualFaults]]:
    """Return what a search of records finds, once more where spikes only show in its residual.

    And the faults that the residual of each record shows, spikes before the search among them.
    """

    def find(records: list[Record], told: Told) -> tuple[Search, list[ResidualFaults]]:
        # the smallest causes have a tenth of the materiality line
        asked: dict[str, Any] = {"alpha": task.alpha, "least_share": 0.1 * task.materiality}
        asked |= {"rng": rng, "progress": told}
        if len(records) > 1:
            both = search_together(records, task.causes, task.known(), **asked)
            fits = [piece.fit for piece, _ in piece_searches(both)]
            pairs = zip(ready, fits, strict=True)
            return both, [_faults(task, one.inspected, fit, white=True) for one, fit in pairs]
        found = search(records[0], task.causes, task.known(), **asked)
        faults = _faults(task, ready[0].inspected, found.told, white=True)
        if faults.noise_variance is not None:
            # what a table over the speed explains is no noise
            found.find_tables()
            faults = _faults(task, ready[0].inspected, found.told, white=True)
        return found, [faults]

    records = [one.record for one in ready]
    found, late = find(records, report)
    if any(faults.spikes.any() for faults in late):
        report("searching again without spikes", 0.8)
        pairs = zip(records, late, strict=True)
        kept = [replace(one, valid=one.valid & ~faults.spikes) for one, faults in pairs]
        found, again = find(kept, silent)
        late = [_both_late(one, two) for one, two in zip(late, again, strict=True)]
    return found, [_with_early(task, one, two) for one, two in zip(ready, late, strict=True)]


def _both_late(first: ResidualFaults, second: ResidualFaults) -> ResidualFaults:
    """Return the spikes of a search and what a second one without them shows."""
    spikes = [fault for fault in first.faults if fault.name == "spikes"]
    others = [fault for fault in second.faults if fault.name != "spikes"]
    return replace(second, faults=(*spikes, *others), spikes=first.spikes | second.spikes)


def _with_early(task: Task, ready: Ready, late: ResidualFaults) -> ResidualFaults:
    """Return late faults with the spikes that were taken out before the search."""
    inspected, spikes = ready.inspected, ready.spikes
    if spikes.any() and not any(fault.name == "spikes" for fault in late.faults):
        read = _read(task, inspected)
        whole = _prepared(task, read, ready.record.low_pass)
        early = _faults(task, inspected, start_fit(whole, task.known()), white=False)
        late = replace(late, faults=(*early.faults, *late.faults))
    return replace(late, spikes=late.spikes | spikes)


def _faults(task: Task, inspected: Inspected, fit: Fit, *, white: bool) -> ResidualFaults:
    record = fit.record
    # samples that fade in and out at the ends say nothing of the noise
    unfaded = record.valid & (fit.bands.fade > 0.999)
    return faults_of_residual(
        residual_nm(fit),
        whitened_nm(fit) if white else None,
        record.motion,
        unfaded,
        np.where(record.valid, record.torque_nm, 0.0),
        task.profile.data,
        volts="torque_v" in inspected.trace,
    )


def _cleaned(task: Task, inspected: Inspected, read: Record) -> tuple[Record, NDArray[np.bool_]]:
    """Return the record without spikes, and with what coarse readings add on average."""
    fit = start_fit(_prepared(task, read), task.known())
    early = _faults(task, inspected, fit, white=False)
    if early.spikes.any():
        masked = inspected.masked | early.spikes[~read.added]
        read = _read(task, replace(inspected, masked=masked))
    record = _prepared(task, read, fit.bands.low_pass)
    if any(fault.name == "quantisation" for fault in early.faults):
        record = _rounded(task, record)
    return record, early.spikes


def _rounded(task: Task, record: Record) -> Record:
    """Return the record with the mean error of coarse readings held fixed."""
    for _ in range(2):
        left = residual_nm(start_fit(record, task.known()))
        torque = np.where(record.valid, record.torque_nm, 0.0)
        steps = coarse_steps(torque[record.valid])
        if steps is None:
            return record
        first = float(torque[record.valid][0])
        errors = [steps.mean_error(torque - left, first, part * steps.step) for part in _DITHERS]
        error = min(errors, key=lambda e: float(np.sum((left - e)[record.valid] ** 2)))
        record = replace(record, fixed_nm=record.fixed_nm + np.where(record.valid, error, 0.0))
    return record
