"""Inspection of a log: facts of every channel, and what follows from them."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from importlib import resources

import numpy as np

from hdbench.diagnosis.faults.converter import CHANCE, piled_up, step_of, stuck_samples
from hdbench.diagnosis.faults.scatter import mask_runs, same_noise
from hdbench.diagnosis.faults.shaft import ANGLES, VELOCITIES, Shaft, derivation, shaft_of
from hdbench.diagnosis.faults.stamps import gap_steps, gaps_of, held_samples
from hdbench.diagnosis.inspection.log import Log
from hdbench.diagnosis.inspection.result import (
    ChannelFacts,
    Coverage,
    Finding,
    Gap,
    Inspection,
    Sampling,
)
from hdbench.estimation.bandwidth import Spectrum, spectrum_of
from hdbench.estimation.delay import delay_of, side_by_side
from hdbench.importing.convert import unlike_pace
from hdbench.importing.units import unit_scale
from hdbench.model.motion import TORQUES
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace

# a stamp that is off by one period turns a wave at half the Nyquist frequency by so many times its
# size: pi / 2 of the error of one stamp, 1 / sqrt(2) of that of a step
_TURNED = np.pi / 2.0 / np.sqrt(2.0)

_CONSEQUENCES: dict[str, str] = tomllib.loads(
    (resources.files(__package__) / "findings.toml").read_text(encoding="utf-8")
)


def inspect_trace(trace: Trace, profile: ProfileData) -> Inspection:
    """Say what a trace can tell."""
    return inspect_log(Log.of_trace(trace), profile)


def inspect_log(log: Log, profile: ProfileData) -> Inspection:
    """Say what a log can tell on a bench, for its encoder and tacho; nothing is repaired."""
    shaft = _shaft(log, profile)
    sampling = _sampling(log, shaft)
    # held samples, limits and delays are tests: their chances sum to that of ten channels
    alpha = 10.0 * CHANCE / (3.0 * max(1, len(log.channels)))
    looks = [_look(log, name, sampling.rate_hz, alpha) for name in log.channels]
    spectra = {facts.name: seen for facts, seen, _ in looks if seen is not None}
    facts = {one.name: one for one, _, _ in looks}
    for name, of in _derived(log, shaft, spectra):
        facts[name] = replace(facts[name], derived_from=of)
    delay = None if shaft is None else delay_of(shaft.velocity_rad_s, _pace(shaft), shaft.period_s)
    if shaft is not None and delay is not None:
        angle, name = (log.roles[role] for role in shaft.names)
        facts[name] = replace(facts[name], delay_s=delay[0], delay_std_s=delay[1], delay_to=angle)
    own = [finding for _, _, found in looks for finding in found]
    pairs = (*_of_units(log), *_of_pairs(facts.values(), sampling))
    findings = (*_of_stamps(sampling), *own, *pairs)
    return Inspection(
        log.source, sampling, tuple(facts.values()), findings, _coverage(log), log.notes, spectra
    )


def _finding(name: str, channel: str | None, detail: str, **sizes: float) -> Finding:
    return Finding(name, channel, detail, _CONSEQUENCES[name].format(**sizes))


# --- stamps
def _shaft(log: Log, profile: ProfileData) -> Shaft | None:
    """Return angle and velocity side by side; None where one of them or the time is missing."""
    if log.time_s is None or len(log) < 5 or not (np.diff(log.time_s) > 0.0).all():
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
    even = bool((steps > 0.0).all())
    at = gap_steps(time) if even else np.flatnonzero(steps > 3.0 * median)
    usual = np.delete(steps, at)
    return Sampling(
        len(time),
        float(time[-1] - time[0]),
        median,
        float(1.0 / usual.mean()),
        float(np.sqrt(np.mean((usual / median - 1.0) ** 2))),
        int((steps == 0.0).sum()),
        int((steps < 0.0).sum()),
        None if shaft is None else bool(np.ptp(shaft.steps_s[shaft.good]) == 0.0),
        tuple(Gap(*gap) for gap in gaps_of(time, log.stage, at)),
    )


def _of_stamps(sampling: Sampling) -> Iterator[Finding]:
    if sampling.median_s is None:
        yield _finding("no-time", None, f"{sampling.rows} rows without a time")
        return
    if sampling.repeated or sampling.backward:
        detail = f"{sampling.repeated} stamps repeat the one before, {sampling.backward} go back"
        yield _finding("repeated-stamps", None, detail)
    jitter = sampling.jitter_share or 0.0
    # a wave at half the Nyquist frequency is off by a twentieth of its size
    if jitter > 0.05 / _TURNED:
        where = {
            None: "",
            True: "; angle and velocity fit even samples better: only the stamps are uneven",
            False: "; angle and velocity fit the stamps: the samples are uneven",
        }[sampling.even_beneath]
        detail = f"steps scatter by {100.0 * jitter:.3g} % of a period{where}"
        sizes = {"hertz": 0.25 / sampling.median_s, "percent": 100.0 * _TURNED * jitter}
        yield _finding("uneven-stamps", None, detail, **sizes)
    if sampling.gaps:
        lost = sum(gap.samples for gap in sampling.gaps)
        yield _finding("gaps", None, f"{len(sampling.gaps)} gaps, some {lost} samples")


# --- one channel
def _look(
    log: Log, name: str, rate_hz: float | None, alpha: float
) -> tuple[ChannelFacts, Spectrum | None, list[Finding]]:
    """Return what one channel says by itself."""
    values, unit, kind = log.channels[name], log.units.get(name, ""), log.kind(name)
    missing = ~np.isfinite(values)
    step = step_of(values)
    held = 0.0
    if kind != "given":
        held = float(held_samples(values, step, alpha).mean())
    # without a time the spectrum still tells the noise
    seen = None if kind == "angle" else spectrum_of(values, rate_hz or 1.0, step)
    # steps that are not smoothed by noise of 0.3 of them, beside that of the rounding itself
    noisy = seen is not None and seen.noise**2 - step**2 / 12.0 > (0.3 * step) ** 2
    limit = None if seen is None or rate_hz is None else seen.limit_hz
    share = float(missing.mean()) if len(values) else 1.0
    found = []
    if share:
        detail = f"{int(missing.sum())} of {len(values)} samples"
        found.append(_finding("missing-values", name, detail))
    if held:
        detail = f"{100.0 * held:.3g} % repeat the one before in motion"
        found.append(_finding("held-samples", name, detail))
    if kind == "effort":
        found += _of_counts(log, name, step)
        # a current without noise rests on a level, and a drive holds it at its limit on purpose
        current = log.roles.get("motor_current_a") == name
        found += _of_converter(log, name, alpha) if noisy and not current else ()
    if (
        kind in ("velocity", "effort")
        and seen is not None
        and not noisy
        and step / np.sqrt(12.0) > 0.01 * _size(values, kind)
    ):
        detail = f"steps of {step:.3g} {unit}".rstrip() + " show no noise"
        found.append(_finding("coarse-steps", name, detail))
    elif kind == "effort" and seen is not None and limit is not None:
        below = ", and no noise below" if seen.computed else ""
        detail = f"no noise and no signal above {limit:.3g} Hz{below}"
        found.append(_finding("computed" if seen.computed else "low-passed", name, detail))
    rate = None if rate_hz is None else rate_hz * (1.0 - held)
    band = None
    if seen is not None and rate is not None:
        band = 0.5 * rate if limit is None else limit
    noise = None if seen is None else seen.noise
    facts = ChannelFacts(name, unit, rate, band, step or None, noise, share, held)
    return facts, seen if rate_hz is not None else None, found


def _size(values: FloatArray, kind: str) -> float:
    """Return what steps are held against: the level of a speed, what changes of a torque."""
    return float(np.sqrt(np.nanmean(values**2)) if kind == "velocity" else np.nanstd(values))


def _of_counts(log: Log, name: str, step: float) -> Iterator[Finding]:
    """Return what is missing beside raw counts."""
    bits = log.signed.get(name)
    if bits:
        yield _finding("unsigned", name, f"whole numbers at both ends of {bits} bits", bits=bits)
    if not log.units.get(name) and step == 1.0:
        yield _finding("no-scale", name, "whole numbers without a unit")


def _of_converter(log: Log, name: str, alpha: float) -> Iterator[Finding]:
    """Return where a torque ended or stood still."""
    values, unit = log.channels[name], log.units.get(name, "")
    piled = piled_up(values, alpha)
    if piled:
        limit, count = max(piled, key=lambda one: one[1])
        detail = f"{count} samples at {limit:.4g} {unit}".rstrip() + ", its end"
        yield _finding("saturation", name, detail)
    stuck = stuck_samples(values)
    if stuck.any():
        runs = mask_runs(stuck)
        first, last = runs[0][0], runs[-1][1]
        place = f"rows {first} to {last}"
        if log.time_s is not None:
            place = f"{log.time_s[first]:.4g} to {log.time_s[last]:.4g} s"
        where = "one run" if len(runs) == 1 else f"{len(runs)} runs"
        detail = f"{int(stuck.sum())} samples in {where} of equal values, {place}"
        yield _finding("stuck-value", name, detail)


# --- two channels
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
        if noisy and _same_to_the_end(_pace(shaft), shaft.velocity_rad_s, rate, limit):
            yield log.roles[pair[0]], log.roles[pair[1]]
    torque = next((log.roles[n] for n in TORQUES if n in log.roles), None)
    current = log.roles.get("motor_current_a")
    if not torque or not current or torque == current:
        return
    if same_noise(log.channels[torque], log.channels[current]):
        yield torque, current


def _same_to_the_end(
    one: FloatArray, other: FloatArray, rate_hz: float, limit_hz: float | None
) -> bool:
    """Return whether two channels agree up to the end of their band, where motion has none."""
    from scipy.signal import coherence  # half a second of every start

    both = side_by_side(one, other)
    if both is None:
        return False
    a, b, size = both
    # side lobes 220 dB down: a strong slow part must not hide an empty floor behind them
    frequency, shared = coherence(a, b, rate_hz, ("kaiser", 30), nperseg=size)
    place = frequency / (limit_hz or 0.5 * rate_hz)
    end = shared[(place > 0.5) & (place < 0.9)]
    # two sensors share the motion and no noise: of K segments their coherence exceeds 1/2 by chance
    # with 2^(1 - K) at each frequency; here the median of many has to
    return bool(len(end) and float(np.median(end)) > 0.5)


def _pace(shaft: Shaft) -> FloatArray:
    """Return the mean rate of the angle around each sample, which has no delay, rad/s."""
    rate = np.where(shaft.good, shaft.moves_rad / shaft.steps_s, np.nan)
    return np.asarray(0.5 * (np.append(rate, np.nan) + np.append(np.nan, rate)))


def _of_units(log: Log) -> Iterator[Finding]:
    """Return where angle and velocity, in the units that they state, tell of unlike motions."""
    names = [log.roles.get(name, "") for name in ("motor_angle_rad", "motor_velocity_rad_s")]
    if log.time_s is None or not all(names):
        return
    angle, velocity = (
        log.channels[name] * float(unit_scale(log.units.get(name, ""), unit) or 1)
        for name, unit in zip(names, ("rad", "rad/s"), strict=True)
    )
    ratio = unlike_pace(log.time_s, angle, velocity)
    if ratio is not None:
        yield _finding("units-disagree", names[1], f"{ratio:.4g} times the rate of {names[0]}")


def _of_pairs(facts: Iterable[ChannelFacts], sampling: Sampling) -> Iterator[Finding]:
    for one in facts:
        if one.derived_from is not None:
            yield _finding("derived", one.name, f"computed from {one.derived_from}")
        if one.delay_s is None or one.delay_std_s is None or sampling.median_s is None:
            continue
        # chance does not reach five standard deviations
        if abs(one.delay_s) - 5.0 * one.delay_std_s > sampling.median_s:
            late = "later" if one.delay_s > 0.0 else "earlier"
            size = f"{1e3 * abs(one.delay_s):.3g} +- {1e3 * one.delay_std_s:.2g} ms"
            detail = f"{size} {late} than {one.delay_to}"
            yield _finding("delay", one.name, detail, hertz=0.05 / abs(one.delay_s))


# --- motion
def _coverage(log: Log) -> Coverage | None:
    """Return the motion that a log covers."""
    unit, velocity = _velocity(log)
    velocity = velocity[np.isfinite(velocity)]
    if not len(velocity):
        return None
    low, high = (float(v) for v in np.quantile(velocity, (0.01, 0.99)))
    # slower than a twentieth of the greatest speed is rest
    moving = velocity[np.abs(velocity) > 0.05 * max(abs(low), abs(high))]
    reversals = int(np.count_nonzero(np.diff(np.sign(moving)))) if len(moving) else 0
    angle = log.role("motor_angle_rad")
    turns = None
    if angle is not None and log.units.get(log.roles["motor_angle_rad"]) == "rad":
        turns = float(np.nanmax(angle) - np.nanmin(angle)) / (2.0 * np.pi)
    rest = 1.0 - len(moving) / len(velocity)
    limits = tuple(_limits(np.abs(moving), reversals, turns, unit))
    return Coverage(unit, (low, high), rest, reversals, turns, limits)


def _velocity(log: Log) -> tuple[str, FloatArray]:
    """Return the velocity, or the rate of the angle, with its unit; no values where none is."""
    role = next((n for n in (*VELOCITIES, *ANGLES) if n in log.roles), "")
    name = log.roles.get(role, "")
    unit = log.units.get(name, "")
    if role in VELOCITIES:
        return unit, log.channels[name]
    if not role or log.time_s is None or len(log) < 2:
        return "", np.zeros(0)
    steps = np.diff(log.time_s)
    rate = np.diff(log.channels[name])[steps > 0.0] / steps[steps > 0.0]
    return f"{unit}/s" if unit else "", rate


def _limits(
    speeds: FloatArray, reversals: int, turns: float | None, unit: str
) -> Iterator[Finding]:
    if not len(speeds) or not float(speeds.max()) > 0.0:
        yield _finding("at-rest", None, "the shaft does not move")
        return
    mean, spread = float(speeds.mean()), float(speeds.std())
    if spread < 0.1 * mean:
        detail = f"{mean:.4g} {unit} throughout".replace("  ", " ")
        yield _finding("one-speed", None, detail)
    if not reversals:
        yield _finding("no-reversal", None, "one direction only")
    if turns is not None and turns < 1.0:
        yield _finding("short-travel", None, f"{turns:.3g} motor turns")
