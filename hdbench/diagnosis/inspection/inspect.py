"""Inspection of a log: facts of every channel, and what follows from them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from hdbench.diagnosis.faults.converter import stuck_samples
from hdbench.diagnosis.faults.scatter import mask_runs
from hdbench.diagnosis.faults.shaft import Shaft, derivation, shaft_of
from hdbench.diagnosis.faults.stamps import gap_steps
from hdbench.estimation.bandwidth import Spectrum, spectrum_of
from hdbench.diagnosis.inspection.channel import held_share, piled_up, step_of
from hdbench.diagnosis.inspection.coverage import coverage_of
from hdbench.diagnosis.inspection.log import Log
from hdbench.diagnosis.inspection.relations import delay_of, same_noise, same_to_the_end
from hdbench.diagnosis.inspection.result import ChannelFacts, Finding, Gap, Inspection, Sampling
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace

__all__ = ["FALSE_ALARM", "inspect_log", "inspect_trace"]

FALSE_ALARM = 1e-4
"""Chance of any finding of a statistical kind on a log without a fault; shared by its tests."""

_TORQUES = ("torque_nm", "torque_v")
# stamps that are off by this part of a period turn a wave at half the Nyquist frequency by a
# twentieth of its size: pi / 2 times the error of one stamp, 1 / sqrt(2) of that of a step
_JITTER = 0.05 / (np.pi / 2.0 / np.sqrt(2.0))
# standard deviations of a delay that chance does not reach, and how long one has to be, samples
_SIGMAS, _LATE = 5.0, 1.0
# steps that are not smoothed by noise of 0.3 of them, and make a hundredth of what changes
_DITHER, _COARSE = 0.3, 0.01
_FEWEST = 5


def inspect_trace(trace: Trace, profile: ProfileData) -> Inspection:
    """Say what a trace can tell.

    Parameters
    ----------
    trace : Trace
        Channels.
    profile : ProfileData
        Bench: counts of its encoder, gain of its tacho.

    Returns
    -------
    Inspection
    """
    return inspect_log(Log.of_trace(trace), profile)


def inspect_log(log: Log, profile: ProfileData) -> Inspection:
    """Say what a log can tell; nothing is repaired.

    Parameters
    ----------
    log : Log
        Channels of one clock.
    profile : ProfileData
        Bench: counts of its encoder, gain of its tacho.

    Returns
    -------
    Inspection

    Notes
    -----
    Jitter, gaps and missing values are seen, not inferred. Held samples, limits and delays are
    tests whose chances of a false alarm sum to `FALSE_ALARM`; an empty spectrum and shared noise
    are far from what chance makes.
    """
    shaft = _shaft(log, profile)
    sampling = _sampling(log, shaft)
    alpha = FALSE_ALARM / (3.0 * max(1, len(log.channels)))
    looks = [_look(log, name, sampling.rate_hz, alpha) for name in log.channels]
    spectra = {facts.name: seen for facts, seen, _ in looks if seen is not None}
    facts = {one.name: one for one, _, _ in looks}
    for name, of in _derived(log, shaft, spectra):
        facts[name] = replace(facts[name], derived_from=of)
    if shaft is not None:
        delay = delay_of(shaft.velocity_rad_s, _pace(shaft), shaft.period_s)
        angle, name = (log.roles[role] for role in shaft.names)
        if delay is not None:
            facts[name] = replace(
                facts[name], delay_s=delay[0], delay_std_s=delay[1], delay_to=angle
            )
    own = [finding for _, _, found in looks for finding in found]
    findings = (*_of_stamps(sampling), *own, *_of_pairs(facts.values(), sampling))
    return Inspection(
        log.source, sampling, tuple(facts.values()), findings, coverage_of(log), log.notes, spectra
    )


def _shaft(log: Log, profile: ProfileData) -> Shaft | None:
    """Return angle and velocity side by side; None where one of them or the time is missing."""
    if log.time_s is None or len(log) < _FEWEST or not (np.diff(log.time_s) > 0.0).all():
        return None
    roles = {role: log.channels[name] for role, name in log.roles.items()}
    shaft = shaft_of(Trace({"time_s": log.time_s, **roles}, log.source), profile)
    return shaft if shaft is not None and bool(shaft.good.any()) else None


def _sampling(log: Log, shaft: Shaft | None) -> Sampling:
    time = log.time_s
    if time is None or len(time) < 2:
        return Sampling(len(log))
    steps = np.diff(time)
    forward = steps[steps > 0.0]
    if not len(forward):
        return Sampling(len(log), repeated=int((steps == 0.0).sum()))
    median = float(np.median(forward))
    stage = np.zeros(len(time)) if log.stage is None else log.stage
    even = bool((steps > 0.0).all())
    at = gap_steps(time) if even else np.flatnonzero(steps > 3.0 * median)
    gaps = tuple(
        Gap(float(time[k]), float(time[k + 1]), max(1, round(float(steps[k]) / median) - 1))
        for k in at.tolist()
        if stage[k] == stage[k + 1]
    )
    usual = np.delete(steps, at)
    beneath = None if shaft is None else bool(np.ptp(shaft.steps_s[shaft.good]) == 0.0)
    return Sampling(
        len(time),
        float(time[-1] - time[0]),
        median,
        float(1.0 / usual.mean()),
        float(np.sqrt(np.mean((usual / median - 1.0) ** 2))),
        int((steps == 0.0).sum()),
        int((steps < 0.0).sum()),
        beneath,
        gaps,
    )


def _of_stamps(sampling: Sampling) -> Iterator[Finding]:
    if sampling.median_s is None:
        yield Finding(
            "no-time", None, f"{sampling.rows} rows without a time",
            "no speed, rate, frequency or delay can be told: give the sample rate",
        )  # fmt: skip
        return
    if sampling.repeated or sampling.backward:
        yield Finding(
            "repeated-stamps", None,
            f"{sampling.repeated} stamps repeat the one before, {sampling.backward} go back",
            "the order of these samples is not known: no trace can be made of them as they are",
        )  # fmt: skip
    jitter = sampling.jitter_share or 0.0
    if jitter > _JITTER:
        where = "" if sampling.even_beneath is None else (
            "; angle and velocity fit even samples better: only the stamps are uneven"
            if sampling.even_beneath
            else "; angle and velocity fit the stamps: the samples are uneven"
        )  # fmt: skip
        half = 0.25 / sampling.median_s
        yield Finding(
            "uneven-stamps", None, f"steps scatter by {100.0 * jitter:.3g} % of a period{where}",
            f"waves near {half:.3g} Hz are off by {100.0 * np.pi / 2 / np.sqrt(2) * jitter:.2g} % "
            "of their size; of faster ones only those locked to a measured angle can be told",
        )  # fmt: skip
    if sampling.gaps:
        lost = sum(gap.samples for gap in sampling.gaps)
        yield Finding(
            "gaps", None, f"{len(sampling.gaps)} gaps, some {lost} samples",
            "what happened there is not known; an angle that is integrated from the velocity "
            "loses its phase",
        )  # fmt: skip


def _look(
    log: Log, name: str, rate_hz: float | None, alpha: float
) -> tuple[ChannelFacts, Spectrum | None, list[Finding]]:
    """Return what one channel says by itself."""
    values, unit, kind = log.channels[name], log.units.get(name, ""), log.kind(name)
    missing = ~np.isfinite(values)
    step = step_of(values)
    held = 0.0 if kind == "given" else held_share(values, step, alpha, smooth=kind == "angle")
    # without a time the spectrum still tells the noise
    seen = None if kind == "angle" else spectrum_of(values, rate_hz or 1.0, step)
    noisy = seen is not None and _own_noise(seen, step) > _DITHER * step
    limit = None if seen is None or rate_hz is None else seen.limit_hz
    share = float(missing.mean()) if len(values) else 1.0
    found = []
    if share:
        found.append(
            Finding(
                "missing-values", name, f"{int(missing.sum())} of {len(values)} samples",
                "these samples take no part",
            )
        )  # fmt: skip
    if held:
        found.append(
            Finding(
                "held-samples", name, f"{100.0 * held:.3g} % repeat the one before in motion",
                "it was sampled at a lower rate than it was stored: fewer samples count, and what "
                "is fast stands at the wrong time",
            )
        )  # fmt: skip
    if kind == "effort":
        found += _of_counts(log, name, step)
        # a current without noise rests on a level, and a drive holds it at its limit on purpose
        current = log.roles.get("motor_current_a") == name
        found += _of_converter(log, name, alpha) if noisy and not current else ()
    if (
        kind in ("velocity", "effort")
        and seen is not None
        and not noisy
        and step / np.sqrt(12.0) > _COARSE * _size(values, kind)
    ):
        found.append(
            Finding(
                "coarse-steps", name, f"steps of {step:.3g} {unit}".rstrip() + " show no noise",
                "what is smaller than a step is lost; sizes near a step are wrong",
            )
        )  # fmt: skip
    elif kind == "effort" and limit is not None:
        found.append(
            Finding(
                "low-passed", name, f"no noise and no signal above {limit:.3g} Hz",
                "it was filtered before it was stored, or computed: ripple, tones and noise above "
                "that cannot be told, and near it they are too small",
            )
        )  # fmt: skip
    rate = None if rate_hz is None else rate_hz * (1.0 - held)
    band = None
    if seen is not None and rate is not None:
        band = 0.5 * rate if limit is None else limit
    noise = None if seen is None else seen.noise
    facts = ChannelFacts(name, unit, rate, band, step or None, noise, share, held)
    return facts, seen if rate_hz is not None else None, found


def _own_noise(seen: Spectrum, step: float) -> float:
    """Return the noise of a channel without that of its rounding."""
    return float(np.sqrt(max(seen.noise**2 - step**2 / 12.0, 0.0)))


def _size(values: FloatArray, kind: str) -> float:
    """Return what steps are held against: the level of a speed, what changes of a torque."""
    return float(np.sqrt(np.nanmean(values**2)) if kind == "velocity" else np.nanstd(values))


def _of_counts(log: Log, name: str, step: float) -> Iterator[Finding]:
    """Return what is missing beside raw counts."""
    bits = log.signed.get(name)
    if bits:
        yield Finding(
            "unsigned", name, f"whole numbers at both ends of {bits} bits",
            f"signed numbers were stored without their sign: import them with @int{bits}",
        )  # fmt: skip
    if not log.units.get(name) and step == 1.0:
        yield Finding(
            "no-scale", name, "whole numbers without a unit",
            "how many N m one of them is, is not in the file: no torque, and no inertia, can be "
            "told in size",
        )  # fmt: skip


def _of_converter(log: Log, name: str, alpha: float) -> Iterator[Finding]:
    """Return where a torque ended or stood still."""
    values, unit = log.channels[name], log.units.get(name, "")
    piled = piled_up(values, alpha)
    if piled is not None:
        limit, count = piled
        yield Finding(
            "saturation", name, f"{count} samples at {limit:.4g} {unit}".rstrip() + ", its end",
            "what went beyond is not known: these samples must not be fitted",
        )  # fmt: skip
    stuck = stuck_samples(values)
    if stuck.any():
        runs = mask_runs(stuck)
        first, last = runs[0][0], runs[-1][1]
        place = f"rows {first} to {last}"
        if log.time_s is not None:
            place = f"{log.time_s[first]:.4g} to {log.time_s[last]:.4g} s"
        yield Finding(
            "stuck-value", name,
            f"{int(stuck.sum())} samples in {len(runs)} runs of equal values, {place}",
            "the drive was off or the channel was held: these samples say nothing",
        )  # fmt: skip


def _derived(
    log: Log, shaft: Shaft | None, spectra: Mapping[str, Spectrum]
) -> Iterator[tuple[str, str]]:
    """Return channels and what they were computed of."""
    pair = None if shaft is None else derivation(shaft)
    if shaft is not None and pair is not None:
        seen = spectra.get(log.roles[shaft.names[1]])
        limit, rate = None if seen is None else seen.limit_hz, 1.0 / shaft.period_s
        angle = spectrum_of(np.where(shaft.good, shaft.moves_rad, np.nan), rate, 0.0)
        # an angle without noise lends none: it shows nothing of where the velocity is from
        noisy = angle is not None and angle.limit_hz is None
        if noisy and same_to_the_end(_pace(shaft), shaft.velocity_rad_s, rate, limit):
            yield log.roles[pair[0]], log.roles[pair[1]]
    torque = next((log.roles[n] for n in _TORQUES if n in log.roles), None)
    current = log.roles.get("motor_current_a")
    if (
        torque
        and current
        and torque != current
        and same_noise(log.channels[torque], log.channels[current])
    ):
        yield torque, current


def _pace(shaft: Shaft) -> FloatArray:
    """Return the mean rate of the angle around each sample, which has no delay, rad/s."""
    rate = np.where(shaft.good, shaft.moves_rad / shaft.steps_s, np.nan)
    return np.asarray(0.5 * (np.append(rate, np.nan) + np.append(np.nan, rate)))


def _of_pairs(facts: Iterable[ChannelFacts], sampling: Sampling) -> Iterator[Finding]:
    for one in facts:
        if one.derived_from is not None:
            yield Finding(
                "derived", one.name, f"computed from {one.derived_from}",
                "the two are one measurement: neither can show a fault of the other",
            )  # fmt: skip
        if one.delay_s is None or one.delay_std_s is None or sampling.median_s is None:
            continue
        if abs(one.delay_s) - _SIGMAS * one.delay_std_s > _LATE * sampling.median_s:
            late = "later" if one.delay_s > 0.0 else "earlier"
            yield Finding(
                "delay", one.name,
                f"{1e3 * abs(one.delay_s):.3g} +- {1e3 * one.delay_std_s:.2g} ms {late} than "
                f"{one.delay_to}",
                "accelerations and torques are held against another moment: what changes faster "
                f"than {0.05 / abs(one.delay_s):.2g} Hz is off by a third or more",
            )  # fmt: skip
