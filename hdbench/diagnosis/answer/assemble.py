"""Answer on a dynamic run: causes, faults, extended model and settings put together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.answer.result import Diagnosis, Pictures, by_share, verdict_of
from hdbench.diagnosis.answer.testable import TorqueChannel, testable
from hdbench.diagnosis.discovery.channel import start_fit
from hdbench.diagnosis.discovery.fit import Fit
from hdbench.diagnosis.discovery.record import SAMPLED
from hdbench.diagnosis.discovery.rest import noise_rms_nm, residual_nm
from hdbench.diagnosis.discovery.search import Search
from hdbench.diagnosis.discovery.told import Told, minimum_detectable, spectra, tell
from hdbench.diagnosis.faults.converter import CHANCE, step_of
from hdbench.diagnosis.faults.fault import Fault, Inspected
from hdbench.diagnosis.faults.residual import ResidualFaults
from hdbench.diagnosis.faults.stamps import held_samples
from hdbench.model import BenchModel, Cause, CauseTerm
from hdbench.results.diagnosis import Gain, LeftOutSamples, ModelFit, NamedCause, Rest, Testable

# an error of prediction this many times the noise is a rest: the noise itself is known to some
# hundredths; a place with so much of its power accounts for it, however small it is beside the rest
# of the torque
_REST, _OF_REST = 1.05, 0.1


@dataclass(frozen=True, slots=True)
class Findings:
    """Everything from which an answer is put together."""

    search: Search  # that has ended
    given: BenchModel  # model that was held against the record
    inspected: Inspected  # channels after inspection
    late: ResidualFaults  # faults that the residual shows
    undone: Mapping[str, float]  # what the baseline leaves with each repaired fault put back, N m
    materiality: float  # smallest share of the residual variance of a cause that counts
    causes: Mapping[str, Cause]  # catalogue


def assemble(
    findings: Findings,
    settings: Mapping[str, object],
    rng: np.random.Generator,
    told: Told | None = None,
) -> Diagnosis:
    """Return the answer of a diagnosis."""
    told = told or tell(findings.search, findings.given, rng, findings.late.noise_variance)
    fit = told.fit
    record = fit.record if fit.record.late_known else replace(fit.record, late_s=0.0)
    terms = [part.term for part in fit.parts if part.term is not None]
    first = start_fit(record, [term for term in terms if term.known])
    baseline_left = residual_nm(first)
    shown = _testable(findings, fit)
    able = {one.name for one in shown if one.testable}
    late = [fault for fault in findings.late.faults if _possible(fault, findings, able)]
    faults = (*findings.inspected.faults, *late)
    named = [*_of_faults(findings, faults, told), *told.causes]
    causes, minor = by_share(named, findings.materiality)
    noise = noise_rms_nm(findings.search.told)
    places, small = by_share(told.places, min(findings.materiality, _share_of_rest(told, noise)))
    extended = _extended(findings, told, faults)
    given = findings.given
    flags = (*findings.inspected.flags, *(fault.flag() for fault in late))
    return Diagnosis(
        verdict=verdict_of(causes, places),
        causes=causes,
        minor=minor,
        unexplained=places,
        minor_unexplained=small,
        data_flags=tuple(sorted(flags, key=lambda flag: flag.from_s)),
        left_out=_left_out(findings),
        rest=Rest(told.after.rms_nm, noise, places),
        testable=shown,
        minimum_detectable=minimum_detectable(findings.search),
        simulated=ModelFit(
            terms=given.terms(),
            heldout_rms_nm=told.before.rms_nm,
            as_given_rms_nm=_as_given(fit, given),
        ),
        extended=ModelFit(terms=extended.terms(), heldout_rms_nm=told.after.rms_nm),
        settings={**settings, **_settings(fit, named)},
        model=extended,
        pictures=_pictures(findings, fit, extended, baseline_left),
    )


def _share_of_rest(told: Told, noise_nm: float) -> float:
    """Return the share of the variance from which a place accounts for a rest; 1 without one."""
    before, after = told.before.rms_nm, told.after.rms_nm
    if after < _REST * noise_nm or before == 0.0:
        return 1.0
    return _OF_REST * (after**2 - noise_nm**2) / before**2


def _testable(findings: Findings, fit: Fit) -> tuple[Testable, ...]:
    """Return which names this record can show."""
    torque = fit.record.torque_nm[fit.record.valid]
    step = step_of(torque)
    channel = TorqueChannel(
        _bandwidth(fit),
        1.0 / fit.record.period_s,
        step,
        noise_rms_nm(findings.search.told),
        float(held_samples(torque, step, CHANCE).mean()),
    )
    causes = findings.causes.values()
    return testable(causes, fit.record.motion, channel, findings.inspected.derived)


def _possible(fault: Fault, findings: Findings, able: set[str]) -> bool:
    """Return whether a fault of the residual is of a size and on a record that its name allows."""
    shape = findings.causes[fault.name].shape
    inside = all(p.contains(fault.shape[p.name]) for p in shape if p.name in fault.shape)
    return inside and fault.name in able


def _of_faults(findings: Findings, faults: tuple[Fault, ...], told: Told) -> list[NamedCause]:
    """Return faults of the acquisition as named causes, with what taking them out gains."""
    held = {term.name for term in findings.given.causes}
    after = told.before.rms_nm
    out = []
    for fault in faults:
        if fault.name in held and fault.undone is None:
            continue
        before = findings.undone.get(fault.name, after)
        if fault.masked is not None:
            before = _with_masked(told.fit, fault.masked, after)
        before = max(before, after)
        fraction = 1.0 - (after / before) ** 2 if before > 0.0 else 0.0
        share = fraction if fault.share is None else fault.share
        gain = Gain(before, after, fraction, (fraction, fraction))
        experiment = findings.causes[fault.name].experiment
        out.append(
            NamedCause(
                name=fault.name,
                group=tuple(dict.fromkeys((fault.name, *fault.group))),
                parameters=fault.parameters,
                evidence_nats=fault.evidence_nats,
                false_alarm_probability=fault.false_alarm_probability,
                gain=gain,
                separating_experiment=experiment if fault.group else None,
                share_of_variance=float(np.clip(share, 0.0, 1.0)),
                domain=fault.domain,
            )
        )
    return out


def _with_masked(fit: Fit, masked: NDArray[np.bool_], after: float) -> float:
    """Return the residual's root mean square with masked samples among the others, N m."""
    record = fit.record
    torque = np.where(np.isfinite(record.torque_nm), record.torque_nm, 0.0)
    if len(masked) < len(record):
        whole = np.zeros(len(record), dtype=bool)
        whole[~record.added] = masked
        masked = whole
    if not np.isfinite(record.torque_nm[masked]).any():
        return after
    near = np.interp(
        np.flatnonzero(masked), np.flatnonzero(record.valid), record.torque_nm[record.valid]
    )
    off = (torque[masked] - near) ** 2
    return float(np.sqrt((after**2 * record.valid.sum() + off.sum()) / (~record.added).sum()))


def _extended(findings: Findings, told: Told, faults: tuple[Fault, ...]) -> BenchModel:
    """Return the given model with the fitted baseline and every cause that has a name."""
    fit = told.fit
    names: list[str] = []
    values: list[float] = []
    for index, part in enumerate(fit.parts):
        if part.term is None and len(part.scale) and not part.name.startswith(SAMPLED):
            own = [n for n in fit.record.names if (n.rpartition(":")[0] or n) == part.name]
            names += own
            values += fit.linear(index).tolist()
    if any(np.isfinite(fit.record.prior_nm)):
        # the correction is to the given misalignment
        amplitude, phase = findings.given.misalignment
        for name, part in (("cosine", np.cos(phase)), ("sine", -np.sin(phase))):
            values[names.index(f"misalignment:{name}")] += amplitude * float(part)
    kept = {cause.name for cause in told.causes} | {term.name for term in findings.given.causes}
    held = [t for t in findings.given.causes if not findings.causes[t.name].additive]
    terms = [t for t in told.terms if t.name in kept]
    new = [
        CauseTerm(fault.name, dict(fault.shape), ())
        for fault in faults
        if fault.shape and fault.name not in {t.name for t in held}
    ]
    model = findings.given.with_baseline(tuple(names), values)
    return replace(model, causes=(*terms, *held, *new), load=fit.record.load)


def _as_given(fit: Fit, given: BenchModel) -> float:
    """Return what the model leaves with the numbers it was handed in with, N m."""
    left = fit.record.torque_nm - given.torque_nm(fit.record.motion)
    good = fit.record.valid & np.isfinite(left)
    return float(np.sqrt(np.mean(left[good] ** 2)))


def _settings(fit: Fit, named: list[NamedCause]) -> dict[str, Any]:
    """Return how the answer came about: noise, baseline, form errors, effects like the zero."""
    ripple = []
    information = np.linalg.pinv(fit.information[np.ix_(fit.active, fit.active)], hermitian=True)
    active = np.flatnonzero(fit.active)
    for index, part in enumerate(fit.parts):
        if part.term is None and part.name.startswith("ripple:"):
            flat = np.searchsorted(active, fit.flat(index))
            value = fit.linear(index)
            amplitude = float(np.hypot(*value))
            along = value / max(amplitude, 1e-300) / part.scale
            variance = float(along @ information[np.ix_(flat, flat)] @ along)
            ripple.append(
                {
                    "order": float(part.name.partition(":")[2]),
                    "amplitude_nm": amplitude,
                    "std_nm": float(np.sqrt(max(variance, 0.0))),
                }
            )
    return {
        "noise": {
            "kind": "spectrum",
            "rms_nm": noise_rms_nm(fit),
            "frequency_hz": fit.bands.frequency_hz.tolist(),
            "power_nm2": fit.spectrum.power.tolist(),
        },
        "torque_bandwidth_hz": None if not np.isfinite(_bandwidth(fit)) else _bandwidth(fit),
        "torque_low_pass": _low_pass(fit),
        "motion_known_hz": fit.record.motion_passed * 0.5 / fit.record.period_s,
        "clock_jitter": fit.record.clock_jitter,
        "velocity_late_s": fit.record.velocity_late_s,
        "load_coefficient": fit.record.load,
        "samples_used": int(fit.record.valid.sum()),
        "form_errors": form_errors(fit),
        "baseline_ripple": ripple,
        "not_told_from_zero": _like_zero(fit, named),
    }


def form_errors(fit: Fit) -> list[dict[str, Any]]:
    """Return the size of each form error that the fit has, relative to its part."""
    some = [part for part in fit.parts if part.form_scale > 0.0]
    return [{"name": part.name, "scale": part.form_scale} for part in some]


def _like_zero(fit: Fit, named: list[NamedCause]) -> list[dict[str, Any]]:
    """Return the effects of the speed that a zero imitates on this motion."""
    told = []
    names = {name for cause in named for name in (*cause.group, *cause.rivals)}
    speed = fit.record.motion.velocity_rad_s[fit.record.valid]
    largest = max(float(np.abs(speed).max()), 1e-12)
    for name, column in (
        ("coulomb-friction", np.tanh(speed / (0.01 * largest))),
        ("viscous-friction", speed),
    ):
        square = float(np.mean(column**2))
        own = float(column.var()) / square if square > 0.0 else 0.0
        # of which a zero imitates three quarters is told as not seen
        if own < 0.25 and name not in names:
            told.append({"cause": name, "own_share": own})
    return told


def _low_pass(fit: Fit) -> dict[str, object] | None:
    """Return the low-pass of the torque channel that was found, None for none."""
    found = fit.bands.low_pass
    if found is None:
        return None
    return {
        "corner_hz": found.corner * 0.5 / fit.record.period_s,
        "order": found.order,
        "delayed": found.causal,
        "ahead_of_sampling": found.analog,
        "load_too": found.load,
        "over_time": found.over_time,
    }


def _bandwidth(fit: Fit) -> float:
    """Return the frequency above which the torque has no power, Hz; infinite without one."""
    whole = fit.bands.size >= fit.bands.length
    return float("inf") if whole else float(fit.bands.frequency_hz[-1])


def _left_out(findings: Findings) -> tuple[LeftOutSamples, ...]:
    record = findings.search.fit.record
    n = int((~record.added).sum())
    reasons = dict(findings.inspected.left_out)
    spikes = int(findings.late.spikes.sum())
    if spikes:
        reasons["spikes"] = spikes
    other = n - int(record.valid.sum()) - sum(reasons.values())
    if other > 0:
        reasons["no motion or no value"] = other
    return tuple(LeftOutSamples(why, count, count / n) for why, count in reasons.items())


def _pictures(
    findings: Findings, fit: Fit, extended: BenchModel, before: np.ndarray[Any, Any]
) -> Pictures:
    record, motion = fit.record, fit.record.motion
    torque, channel = extended.torque_nm(motion), fit.bands.low_pass

    def unused(values: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        return np.where(record.valid, values, np.nan)

    at = ~record.added
    return Pictures(
        motion.time_s[at],
        motion.velocity_rad_s[at],
        record.torque_nm[at],
        findings.given.torque_nm(motion)[at],
        (torque if channel is None else channel.applied(torque))[at],
        unused(before)[at],
        unused(residual_nm(fit))[at],
        ~record.valid[at],
        spectra(findings.search, findings.search.first),
        motion.acceleration_rad_s2[at],
        motion.angle_rad[at],
        motion.output_angle_rad[at],
        motion.applied_nm[at],
    )
