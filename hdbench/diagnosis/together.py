"""Diagnosis of several records of one drive: what they share is fitted once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Unpack

import numpy as np

from hdbench.diagnosis.answer.assemble import assemble, form_errors
from hdbench.diagnosis.answer.result import Diagnosis, Pictures, by_share, verdict_of
from hdbench.diagnosis.discovery.together import Together, piece_searches, tell_together
from hdbench.diagnosis.discovery.told import minimum_detectable, spectra
from hdbench.diagnosis.dynamic import (
    Asked,
    Ready,
    Task,
    findings_of,
    make_ready,
    make_task,
    searched,
)
from hdbench.diagnosis.evidence import Told, silent
from hdbench.diagnosis.faults.fault import Inspected
from hdbench.errors import DataError
from hdbench.profile import Profile
from hdbench.records import Trace
from hdbench.results.diagnosis import (
    HeldOut,
    LeftOutSamples,
    RecordPart,
    Rest,
    StretchFlag,
    Testable,
)
from hdbench.system.memory import memory_kept


@memory_kept()
def diagnose_together(
    traces: Sequence[Trace],
    names: Sequence[str],
    profile: Profile,
    *,
    progress: Told = silent,
    **asked: Unpack[Asked],
) -> Diagnosis:
    """Say what the simulation gets wrong on several records of one drive, and which record says so.

    Arguments are those of `diagnose_trace`, with a name for each trace; rates and lengths may
    differ. Each record has its own baseline, noise, torque channel and faults; columns of a shared
    cause run through all, so that its evidence adds. What differs in the extended model is that of
    the first record. `DataError` where fewer than two records can be used.
    """
    task = make_task(profile, **asked)
    every = []
    for number, (name, trace) in enumerate(zip(names, traces, strict=True)):
        progress(f"inspecting {name}", 0.1 * number / len(traces))
        every.append(_Named(name, trace, make_ready(task, trace)))
    used = [(one, one.ready) for one in every if isinstance(one.ready, Ready)]
    if len(used) < 2:
        refused = [(one.name, one.inspected.reason) for one in every]
        reasons = "; ".join(f"{name}: {reason}" for name, reason in refused if reason)
        raise DataError(
            f"{len(used)} of {len(every)} records can be used together; needed: 2 or more",
            where=reasons or names[0],
            fix="leave out --together to diagnose each record alone",
        )
    rng = np.random.default_rng(task.seed)
    names = [one.name for one, _ in used]
    search, late = searched(task, [ready for _, ready in used], rng, progress)
    progress("measuring the gain on held-out blocks", 0.9)
    findings = [
        findings_of(task, ready, piece, faults)
        for (_, ready), (piece, _), faults in zip(used, piece_searches(search), late, strict=True)
    ]
    told = tell_together(
        search, task.given, names, rng, [one.late.noise_variance for one in findings]
    )
    answers = [
        assemble(replace(one, search=piece), task.settings, rng, own)
        for one, (piece, own) in zip(findings, told.records, strict=True)
    ]
    answer = _joined(task, told, every, dict(zip(names, answers, strict=True)))
    progress("done", 1.0)
    return answer


@dataclass(frozen=True, slots=True)
class _Named:
    """A record with its name, ready for the search or refused."""

    name: str
    trace: Trace
    ready: Ready | Inspected

    @property
    def inspected(self) -> Inspected:
        """Its channels, and why it was refused."""
        return self.ready.inspected if isinstance(self.ready, Ready) else self.ready


# --- one answer of all
def _joined(
    task: Task, told: Together, every: Sequence[_Named], by_name: dict[str, Diagnosis]
) -> Diagnosis:
    answers = list(by_name.values())
    # causes of one record alone, faults of its acquisition, have no voices yet
    faults = [cause for one in answers for cause in (*one.causes, *one.minor) if not cause.voices]
    causes, minor = by_share([*faults, *told.causes], task.materiality)
    places, small = by_share(told.places, task.materiality)
    parts = tuple(_part(one, by_name.get(one.name), told) for one in every)
    first = answers[0]
    noise = float(np.sqrt(np.mean([(p.noise_rms_nm or 0.0) ** 2 for p in parts if not p.left_out])))
    return Diagnosis(
        verdict=verdict_of(causes, places),
        causes=causes,
        minor=minor,
        unexplained=places,
        minor_unexplained=small,
        data_flags=tuple(flag for one in every for flag in _flags(one, by_name.get(one.name))),
        left_out=_left_out(every, by_name),
        rest=Rest(told.after.rms_nm, noise, places),
        testable=_testable(task, told, by_name),
        minimum_detectable=minimum_detectable(told.search),
        simulated=replace(first.simulated, heldout_rms_nm=told.before.rms_nm),
        extended=replace(first.extended, heldout_rms_nm=told.after.rms_nm),
        settings={**task.settings, **_settings(told, answers)},
        records=parts,
        model=first.model,
        pictures=_pictures(told, answers),
    )


def _part(one: _Named, answer: Diagnosis | None, told: Together) -> RecordPart:
    rate = 1.0 / float(np.median(np.diff(one.trace.time_s)))
    if answer is None or answer.rest is None:
        why = one.inspected.reason or None
        return RecordPart(record=one.name, left_out=why, samples=0, rate_hz=rate, settings={})
    apart = [c.name for c in told.causes for v in c.voices if v.record == one.name and v.disagrees]
    settings = answer.settings
    return RecordPart(
        record=one.name,
        samples=settings["samples_used"],
        rate_hz=rate,
        simulated=HeldOut(answer.simulated.heldout_rms_nm),
        extended=HeldOut(answer.extended.heldout_rms_nm),
        noise_rms_nm=answer.rest.noise_rms_nm,
        disagrees=tuple(apart),
        settings={k: v for k, v in settings.items() if k not in ("alpha", "materiality", "seed")},
    )


def _flags(one: _Named, answer: Diagnosis | None) -> list[StretchFlag]:
    """Return the flags of a record; of one that was left out the reason comes first."""
    if answer is not None:
        return [replace(flag, record=one.name) for flag in answer.data_flags]
    ends, why = (float(one.trace.time_s[0]), float(one.trace.time_s[-1])), one.inspected.reason
    whole = StretchFlag("record-left-out", *ends, len(one.trace), why, one.name)
    return [whole, *(replace(flag, record=one.name) for flag in one.inspected.flags)]


def _left_out(every: Sequence[_Named], answers: dict[str, Diagnosis]) -> tuple[LeftOutSamples, ...]:
    total = sum(len(one.trace) for one in every)
    counts: dict[str, int] = {}
    for one in every:
        answer = answers.get(one.name)
        if answer is None:
            counts[f"{one.name} took no part"] = len(one.trace)
            continue
        for part in answer.left_out:
            counts[part.reason] = counts.get(part.reason, 0) + part.samples
    return tuple(LeftOutSamples(why, n, n / total) for why, n in counts.items())


def _settings(told: Together, answers: Sequence[Diagnosis]) -> dict[str, object]:
    fit = told.search.fit
    zeros = [one.settings["not_told_from_zero"] for one in answers]
    hidden = set.intersection(*({z["cause"] for z in some} for some in zeros))
    return {
        "angle_zero": "shared" if fit.record.referenced else "of each record",
        "samples_used": int(fit.record.valid.sum()),
        "form_errors": form_errors(fit),
        "baseline_ripple": [],
        "not_told_from_zero": [zero for zero in zeros[0] if zero["cause"] in hidden],
    }


def _pictures(told: Together, answers: Sequence[Diagnosis]) -> Pictures:
    """Return the pictures of all records one behind the other, on one clock."""
    some = [one.pictures for one in answers if one.pictures is not None]
    values = {
        field.name: np.concatenate([getattr(one, field.name) for one in some])
        for field in fields(Pictures)
        if field.name != "spectra"
    }
    values["time_s"] = told.search.fit.record.motion.time_s
    return Pictures(**values, spectra=spectra(told.search, told.search.first))


def _testable(task: Task, told: Together, answers: dict[str, Diagnosis]) -> tuple[Testable, ...]:
    """Say what can be shown together: what applies to every record, and is seen in one of them."""
    out = []
    for some in zip(*(one.testable for one in answers.values()), strict=True):
        cause = task.causes[some[0].name]
        motions = [record.motion for record in told.search.fit.record.records]
        reasons = [cause.applicable(motion) if cause.additive else None for motion in motions]
        refused = [f"{name}: {why}" for name, why in zip(answers, reasons, strict=True) if why]
        if refused:
            out.append(Testable(cause.name, False, refused[0]))
        else:
            out.append(next((one for one in some if one.testable), some[0]))
    return tuple(out)
