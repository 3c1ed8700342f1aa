"""Diagnosis of a calibration: what one gain and one zero each get wrong, and why."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hdbench.diagnosis.answer.result import Diagnosis
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.loads.answer import LoadAnswer
from hdbench.diagnosis.loads.between import name_between
from hdbench.diagnosis.loads.fit import LoadFit, fit_loads
from hdbench.diagnosis.loads.forms import in_form, load_causes
from hdbench.diagnosis.loads.left import challenge_loads
from hdbench.diagnosis.loads.preflight import inspect_loads
from hdbench.diagnosis.loads.scatter import GainScatter, find_scatter
from hdbench.diagnosis.loads.search import LoadSearch, search_loads
from hdbench.diagnosis.loads.table import LoadTable, base_columns, load_table
from hdbench.diagnosis.loads.weigh import Weighing
from hdbench.diagnosis.measured.preflight import DataFlag
from hdbench.errors import DataError
from hdbench.model import BenchModel, catalogue, cause_named
from hdbench.profile import Profile
from hdbench.records import Loads

__all__ = ["diagnose_loads"]

# readings beyond the zeros and the gain that a residual needs before anything can be read from it
_LEAST_FREE = 3
# the null is drawn over all readings at once: these take a minute and half a gigabyte
_MOST_READINGS = 2000
# shares of the false-alarm rate: names, and places without a name
_NAMES, _PLACES = 0.7, 0.3


def _silent(_what: str, _share: float) -> None:
    return None


def diagnose_loads(
    loads: Loads,
    profile: Profile,
    *,
    model: BenchModel | None = None,
    alpha: float = 0.01,
    materiality: float = 0.01,
    seed: int = 0,
    progress: Callable[[str, float], None] | None = None,
) -> Diagnosis:
    """Say what one gain and one zero per experiment get wrong on a calibration, and why.

    Parameters
    ----------
    loads : Loads
        Static readings.
    profile : Profile
        Bench.
    model : BenchModel or None
        Model to hold against the readings; the profile's where None. Its causes that readings can
        show are fitted, not reported.
    alpha : float
        Probability of any finding on readings without an effect, in (0, 1).
    materiality : float
        Smallest share of the baseline's residual variance of a cause that counts, in [0, 1).
    seed : int
        Seed of the draws of the null and the bootstrap.
    progress : callable or None
        Called with what is being done and the share done in [0, 1].

    Returns
    -------
    Diagnosis
        Verdict ``data-bad`` where gain and zeros cannot be fitted.

    Raises
    ------
    DataError
        If there are no readings or more than 2000, or a torque or position is not finite.
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
    if len(loads) > _MOST_READINGS:
        raise DataError(
            f"found {len(loads)} readings; needed: at most {_MOST_READINGS}",
            where=loads.source,
            fix="average the samples of each load to one reading",
        )
    report = progress or _silent
    given = model or BenchModel.from_profile(profile.data)
    settings: dict[str, object] = {"alpha": alpha, "materiality": materiality, "seed": seed}
    report("inspecting the readings", 0.02)
    table, flags = inspect_loads(load_table(loads, profile.data), profile.data)
    reason = _unfit(table)
    if reason:
        nothing: dict[str, object] = {"terms": [], "heldout_rms_nm": None}
        return Diagnosis(
            "data-bad", (), (), (), (), flags, (), nothing, nothing, given, settings, reason
        )
    return _diagnose(table, profile, given, flags, settings, report)


def _diagnose(
    table: LoadTable,
    profile: Profile,
    given: BenchModel,
    flags: tuple[DataFlag, ...],
    settings: dict[str, object],
    report: Callable[[str, float], None],
) -> Diagnosis:
    alpha = float(str(settings["alpha"]))
    rng = np.random.default_rng(int(str(settings["seed"])))
    causes = load_causes(tuple(catalogue().values()), given.extra_causes, table.motion)
    known = _known_terms(given, table)
    base = base_columns(table)
    baseline = fit_loads(table, base, known, refine=False)
    report("looking for causes", 0.1)
    search = LoadSearch(base, causes, _NAMES * alpha, rng)
    found = search_loads(baseline.table, search, known)
    expected = profile.data.sensor.gain_consistency
    scatter: GainScatter | None = None
    while (finer := find_scatter(found.fit, len(known), expected, scatter)) is not None:
        report("looking for causes beside gains that scatter", 0.4)
        scatter = finer[0]
        base = base_columns(table, scatter.groups)
        found = search_loads(baseline.table, replace(search, base=base), known)
    if scatter is not None:
        found, scatter, base = name_between(found, causes, scatter, _NAMES * alpha)
    report("looking for what has no name", 0.7)
    left = challenge_loads(found.fit, found.space, _PLACES * alpha, rng)
    report("measuring the gain on held-out readings", 0.9)
    weighing = Weighing(found.fit, base, baseline, rng)
    return LoadAnswer(profile.data, given, found, weighing, left, scatter, flags, len(known)).build(
        settings
    )


def _known_terms(given: BenchModel, table: LoadTable) -> tuple[Term, ...]:
    """Return the causes of the model that the readings can show."""
    extra = given.extra_causes
    names = {cause.name for cause in load_causes(tuple(catalogue().values()), extra, table.motion)}
    forms = given.provenance.get("calibration", {}).get("forms", {})
    terms = []
    for term in given.causes:
        if term.name in names:
            plain = cause_named(term.name, where="model", extra=extra)
            cause = in_form(plain, forms.get(term.name, ""))
            terms.append(Term(cause, dict(term.shape), True))
    return tuple(terms)


def _unfit(table: LoadTable) -> str:
    """Return why gain and zeros cannot be fitted, or an empty text."""
    base = base_columns(table)[table.used]
    seen = base[:, base.any(axis=0)] if len(base) else base
    enough = len(seen) >= seen.shape[1] + _LEAST_FREE
    if not (enough and np.linalg.matrix_rank(seen) == seen.shape[1] and base[:, 0].any()):
        return (
            f"{len(seen)} readings do not fix one gain and {len(table.names)} zeros; needed: "
            f"{len(table.names) + 1 + _LEAST_FREE} readings under different loads"
        )
    fit: LoadFit = fit_loads(table, base_columns(table), (), refine=False)
    spread = float(np.ptp(table.reading_v[table.used]))
    if not (spread > 0.0 and abs(fit.slope_v_per_nm) * float(np.ptp(table.torque_nm)) > 0.0):
        return (
            f"the readings are {float(table.reading_v[table.used][0]):.6g} V throughout; needed: a "
            "live channel"
        )
    return ""
