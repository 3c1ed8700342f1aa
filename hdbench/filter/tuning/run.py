"""From traces to a tuned filter model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hdbench.filter.channels import Channels
from hdbench.filter.guard import GUARD_STATES, guard_torque
from hdbench.filter.model import FilterModel
from hdbench.filter.tuning.checks import check_innovations
from hdbench.filter.tuning.data import (
    check_records,
    describe_motion,
    noise_guess_nm2,
    stuck_after,
)
from hdbench.filter.tuning.estimates import estimate_all
from hdbench.filter.tuning.finish import finished
from hdbench.filter.tuning.limits import notes_on
from hdbench.filter.tuning.memory import (
    forget_beyond_the_data,
    leave_the_torque,
    with_moving_offset,
)
from hdbench.filter.tuning.outliers import without_outliers
from hdbench.filter.tuning.result import CandidateResult, TuningResult
from hdbench.filter.tuning.settings import TuningSettings
from hdbench.filter.tuning.trial import Trial, kinds_of

__all__ = ["tune"]


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
    base, records, guess = _guarded(base, records, settings)
    motion = describe_motion(records)
    trial, kinds = Trial.of(base, settings, motion, guess), kinds_of(settings)
    tried, chosen, usable, outliers = _search(trial, records)
    logs = tried[chosen].optimum.logs
    model = trial.model(kinds[chosen], logs, usable)
    if trial.start.slow:
        model = with_moving_offset(model, motion)
    estimates = estimate_all(trial.problem(kinds[chosen]), logs, usable)
    model, estimates = forget_beyond_the_data(model, estimates, motion)
    model, estimates = leave_the_torque(model, estimates, motion)
    consistency = check_innovations(model, usable)
    result = TuningResult(
        model=finished(model, base, settings, records, origins or {}),
        estimates=estimates,
        candidates=(tried[chosen], *(c for i, c in enumerate(tried) if i != chosen)),
        consistency=consistency,
        outliers=outliers,
        notes=notes_on(model, motion, estimates, settings, consistency),
    )
    return replace(result, model=replace(result.model, tuning=result.to_dict()))


def _guarded(
    base: FilterModel, records: Sequence[Channels], settings: TuningSettings
) -> tuple[FilterModel, list[Channels], float]:
    """Return model and traces guarded against a faulty sensor, and a first guess of the noise."""
    guess = noise_guess_nm2(records) if records else 0.0
    guarded = replace(
        base,
        torque_limit_nm=settings.torque_limit_nm,
        stuck_samples=stuck_after(records, guess) if records else None,
    )
    kept = []
    for record in records:
        torque = guard_torque(guarded, record.torque_nm, np.zeros(GUARD_STATES))[0]
        kept.append(replace(record, torque_nm=torque))
    check_records(kept)
    return guarded, kept, guess


def _search(
    trial: Trial, records: list[Channels]
) -> tuple[list[CandidateResult], int, list[Channels], int]:
    """Try every kind of slow torque, again without outliers where there are some."""
    kinds, gate = kinds_of(trial.settings), trial.settings.gate_sigma
    tried = [trial.attempt(kind, records) for kind in kinds]
    chosen = _choose(tried)
    if gate is None:
        return tried, chosen, records, 0
    model = trial.model(kinds[chosen], tried[chosen].optimum.logs, records)
    usable, outliers = without_outliers(model, records, gate)
    if outliers:
        tried = [trial.attempt(kind, usable) for kind in kinds]
        chosen = _choose(tried)
    return tried, chosen, usable, outliers


def _choose(tried: Sequence[CandidateResult]) -> int:
    eligible = [i for i, candidate in enumerate(tried) if candidate.refused is None]
    return max(eligible, key=lambda i: tried[i].penalised)
