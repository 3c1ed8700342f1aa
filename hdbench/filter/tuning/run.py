"""Tuning: the noise of a filter model by maximum likelihood of its innovations on traces."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.estimation.stretches import true_runs
from hdbench.filter.kalman import GATE_SAMPLES, GATED
from hdbench.filter.model import FilterModel, SlowKind
from hdbench.filter.online import (
    SCREEN_STATES,
    Channels,
    filter_channels,
    run_channels,
    screen_torque,
)
from hdbench.filter.tuning import limits
from hdbench.filter.tuning.problem import (
    Motion,
    Problem,
    SlowChoice,
    TuningSettings,
    build_problem,
    check_records,
    describe_motion,
    noise_guess_nm2,
    preview,
    relative_model,
    scaled,
    score,
    stuck_after,
)
from hdbench.filter.tuning.result import CandidateResult, TuningResult, check_innovations
from hdbench.filter.tuning.search import estimate_all, maximise
from hdbench.profile import Profile
from hdbench.profile.schema import ProfileData
from hdbench.records import FloatArray, Trace

# ripple and misalignment stay below a tenth of the rated torque on a bench worth filtering
_ORDER_SHARE = 0.1


def settings_of(profile: ProfileData, *, slow: SlowChoice = "auto") -> TuningSettings:
    """Return the settings that a bench's own numbers give.

    Parameters
    ----------
    profile : ProfileData
        The bench: rated torque, sensor gain and converter range.
    slow : str
        As in `TuningSettings`.

    Returns
    -------
    TuningSettings
        Priors of a tenth of the rated torque for each order and of the rated torque for the
        offset; the torque at which the converter saturates.
    """
    rated = profile.drive.rated_torque_nm
    return TuningSettings(
        order_prior_std_nm=_ORDER_SHARE * rated,
        slow_prior_std_nm=rated,
        slow=slow,
        torque_limit_nm=abs(profile.sensor.gain_nm_per_v) * profile.daq.range_v,
    )


_AUTO: tuple[SlowKind | None, ...] = (None, "ornstein-uhlenbeck", "resonance")


def _kinds_of(settings: TuningSettings) -> tuple[SlowKind | None, ...]:
    """Return the kinds of slow torque that are tried."""
    if settings.slow == "auto":
        return _AUTO
    return (None,) if settings.slow == "none" else (settings.slow,)


@dataclass(frozen=True, slots=True)
class _Trial:
    """One problem, searched for each kind of slow torque."""

    start: FilterModel
    settings: TuningSettings
    motion: Motion
    noise_nm2: float

    def problem(self, kind: SlowKind | None) -> Problem:
        """Return what is varied for one kind of slow torque."""
        return build_problem(self.start, kind, self.motion, self.noise_nm2)

    def attempt(self, kind: SlowKind | None, records: Sequence[Channels]) -> CandidateResult:
        """Search the most likely point for one kind of slow torque."""
        problem = self.problem(kind)
        best = maximise(
            problem,
            problem.likelihood(records),
            preview=problem.likelihood([preview(record) for record in records]),
            max_evaluations=self.settings.max_evaluations,
        )
        penalty = 0.5 * math.log(self.motion.samples) * len(problem.parameters)
        automatic = self.settings.slow == "auto"
        return CandidateResult(
            kind or "none",
            best.log_likelihood,
            best.log_likelihood - penalty,
            best,
            limits.refusal(problem.model(best.logs), self.motion) if automatic else None,
        )

    def model(
        self, kind: SlowKind | None, logs: FloatArray, records: Sequence[Channels]
    ) -> FilterModel:
        """Return the model of a point in absolute units, without a gate."""
        relative = self.problem(kind).model(logs)
        return scaled(relative, score(relative, records).noise_nm2)


def tune(
    base: FilterModel,
    records: Sequence[Channels],
    settings: TuningSettings,
    *,
    origins: Mapping[str, str] | None = None,
) -> TuningResult:
    """Fit the noise of a filter model to traces.

    Parameters
    ----------
    base : FilterModel
        Gives orders, expected torque and angle; its noise is replaced.
    records : sequence of Channels
        One or many traces, taken as independent records of one bench.
    settings : TuningSettings
        What is asked.
    origins : mapping of str to str or None
        Further provenance, e.g. the digest of each trace.

    Returns
    -------
    TuningResult
        The tuned model, its standard errors and checks.

    Raises
    ------
    DataError
        If a trace is too short, or its torque holds no noise.

    Notes
    -----
    What is varied: the process noise of every order per radian of the motor, the numbers of one
    slow block; the measurement noise is concentrated out. States start at the prior of `settings`.
    """
    base, records, guess = _screened(base, records, settings)
    motion = describe_motion(records)
    start = relative_model(base, motion, guess, settings)
    trial, kinds = _Trial(start, settings, motion, guess), _kinds_of(settings)
    tried, chosen, usable, outliers = _search(trial, records)
    logs = tried[chosen].optimum.logs
    model = trial.model(kinds[chosen], logs, usable)
    if trial.start.slow:
        model = limits.with_moving_offset(model, motion)
    estimates = estimate_all(trial.problem(kinds[chosen]), logs, usable)
    model, estimates = limits.forget_beyond_the_data(model, estimates, motion)
    model, estimates = limits.leave_the_torque(model, estimates, motion)
    consistency = check_innovations(model, usable)
    result = TuningResult(
        model=_finished(model, base, settings, records, origins or {}),
        estimates=estimates,
        candidates=(tried[chosen], *(c for i, c in enumerate(tried) if i != chosen)),
        consistency=consistency,
        outliers=outliers,
        notes=limits.notes_on(model, motion, estimates, settings.slow, consistency),
    )
    return replace(result, model=replace(result.model, tuning=result.to_dict()))


def tune_traces(
    profile: Profile,
    base: FilterModel,
    traces: Sequence[Trace],
    origins: Mapping[str, str],
    settings: TuningSettings | None = None,
) -> TuningResult:
    """Tune a filter on traces."""
    channels = [filter_channels(trace, profile.data, use_measured_angle=True) for trace in traces]
    measured = replace(base, use_measured_angle=True)
    return tune(measured, channels, settings or settings_of(profile.data), origins=dict(origins))


def _screened(
    base: FilterModel, records: Sequence[Channels], settings: TuningSettings
) -> tuple[FilterModel, list[Channels], float]:
    """Return model and traces screened for a faulty sensor, and a first guess of the noise."""
    guess = noise_guess_nm2(records) if records else 0.0
    screened = replace(
        base,
        torque_limit_nm=settings.torque_limit_nm,
        stuck_samples=stuck_after(records, guess) if records else None,
    )
    kept = []
    for record in records:
        torque = screen_torque(screened, record.torque_nm, np.zeros(SCREEN_STATES))[0]
        kept.append(replace(record, torque_nm=torque))
    check_records(kept)
    return screened, kept, guess


def _search(
    trial: _Trial, records: list[Channels]
) -> tuple[list[CandidateResult], int, list[Channels], int]:
    """Try every kind of slow torque, again without outliers where there are some."""
    kinds, gate = _kinds_of(trial.settings), trial.settings.gate_sigma
    tried = [trial.attempt(kind, records) for kind in kinds]
    chosen = _choose(tried)
    if gate is None:
        return tried, chosen, records, 0
    model = trial.model(kinds[chosen], tried[chosen].optimum.logs, records)
    usable, outliers = _without_outliers(model, records, gate)
    if outliers:
        tried = [trial.attempt(kind, usable) for kind in kinds]
        chosen = _choose(tried)
    return tried, chosen, usable, outliers


def _choose(tried: Sequence[CandidateResult]) -> int:
    eligible = [i for i, candidate in enumerate(tried) if candidate.refused is None]
    return max(eligible, key=lambda i: tried[i].penalised)


def _finished(
    model: FilterModel,
    base: FilterModel,
    settings: TuningSettings,
    records: Sequence[Channels],
    origins: Mapping[str, str],
) -> FilterModel:
    """Return the model with its stated priors, gate and provenance."""
    names = ", ".join(record.source for record in records)
    span = float(np.sum([record.time_s[-1] - record.time_s[0] for record in records]))
    return replace(
        model,
        name="tuned",
        order_prior_std_nm=settings.order_prior_std_nm,
        slow_prior_std_nm=settings.slow_prior_std_nm,
        gate_sigma=settings.gate_sigma,
        provenance={
            **{k: v for k, v in base.provenance.items() if k != "noise"},
            "noise": f"maximum likelihood on {names} ({span:.6g} s)",
            "slow torque": f"kind asked for: {settings.slow}; chosen by penalised likelihood",
            "prior": "stated before the data: order_prior_std_nm and slow_prior_std_nm",
            **origins,
        },
    )


def _without_outliers(
    model: FilterModel, records: Sequence[Channels], gate_sigma: float
) -> tuple[list[Channels], int]:
    """Return the traces with the torque of outliers missing.

    Notes
    -----
    The set is fixed before the likelihood is maximised again: a gate inside of the likelihood
    would reward small noise, under which more samples are refused. Where the gate refuses as many
    samples in a row as it may, the torque has moved: a step of the load is no outlier.
    """
    gated = replace(model, gate_sigma=gate_sigma)
    kept, outliers = [], 0
    for record in records:
        refused = _short_runs((run_channels(gated, record).flags & GATED) != 0, GATE_SAMPLES)
        count = int(np.count_nonzero(refused))
        if count:
            record = replace(record, torque_nm=np.where(refused, np.nan, record.torque_nm))
        outliers += count
        kept.append(record)
    return kept, outliers


def _short_runs(refused: NDArray[np.bool_], longest: int) -> NDArray[np.bool_]:
    """Return the samples of runs shorter than `longest`."""
    kept = refused.copy()
    for first, after in true_runs(refused):
        if after - first >= longest:
            kept[first:after] = False
    return kept
