"""Diagnosis of a calibration: what one gain and one zero each get wrong, and why."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.answer.result import Diagnosis, data_bad
from hdbench.diagnosis.evidence import LEAST_DOF, Told, check_rates, silent
from hdbench.diagnosis.loads.answer import LoadAnswer
from hdbench.diagnosis.loads.fit import fit_loads
from hdbench.diagnosis.loads.forms import Term, form_named, load_forms, outliers, places
from hdbench.diagnosis.loads.gains import find_scatter, name_between
from hdbench.diagnosis.loads.search import Search, uneven_scatter
from hdbench.diagnosis.loads.table import LoadTable, base_columns, left_out, load_table
from hdbench.errors import DataError
from hdbench.model import BenchModel, cause_named
from hdbench.profile import Profile
from hdbench.records import Loads

# the null is drawn over all readings at once: these take a minute and half a gigabyte
_MOST_READINGS = 2000
# shares of the false-alarm rate: names, places without a name, scatter that changes
_SHARES = (0.7, 0.15, 0.15)


def diagnose_loads(
    loads: Loads,
    profile: Profile,
    *,
    model: BenchModel | None = None,
    alpha: float = 0.01,
    materiality: float = 0.01,
    seed: int = 0,
    progress: Told = silent,
) -> Diagnosis:
    """Say what one gain and one zero per experiment get wrong on a calibration, and why.

    Parameters
    ----------
    loads : Loads
        Static readings.
    profile, model, alpha, materiality, seed, progress : as by `diagnose_trace`
        Of the model's causes those that readings can show are fitted.

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
    """
    check_rates(alpha, materiality)
    if len(loads) > _MOST_READINGS:
        raise DataError(
            f"found {len(loads)} readings; needed: at most {_MOST_READINGS}",
            where=loads.source,
            fix="average the samples of each load to one reading",
        )
    rng = np.random.default_rng(seed)
    given = model or BenchModel.from_profile(profile.data)
    settings = {"alpha": alpha, "materiality": materiality, "seed": seed}
    progress("inspecting the readings", 0.02)
    table, flags = load_table(loads, profile.data)
    reason = _unfit(table)
    if reason:
        return data_bad(given, (), flags, settings, reason, left_out(table, flags))
    known = _known_terms(given, table)
    for_names, for_places, for_scatter = (share * alpha for share in _SHARES)
    base = base_columns(table)
    baseline = fit_loads(table, base, known, refine=False)
    names = load_forms(table, given.extra_causes)
    progress("looking for causes", 0.1)
    search = Search((*names, outliers(table)), for_names, len(known), rng)
    fit, chances, looks = search.run(fit_loads(table, base, known))
    scatter = find_scatter(fit, profile.data.sensor.gain_consistency)
    if scatter is not None:
        progress("looking for causes beside gains that scatter", 0.4)
        base = base_columns(table, scatter.groups)
        fit, chances, looks = search.run(fit_loads(table, base, known))
    accepted = search.accepted(fit, chances)
    if scatter is not None:
        fit, scatter, between = name_between(fit, names, scatter, for_names)
        accepted += between
    progress("looking for what has no name", 0.7)
    rest = Search(places(table), for_places, len(fit.terms), rng)
    with_places, chances, _ = rest.run(fit)
    left = rest.accepted(with_places, chances)
    uneven = uneven_scatter(with_places, baseline, for_scatter, rng)
    progress("measuring the gain on held-out readings", 0.9)
    return LoadAnswer(
        profile.data, given, baseline, fit, with_places, accepted, left, scatter, uneven, looks,
        flags, rng,
    ).build(settings)  # fmt: skip


def _known_terms(given: BenchModel, table: LoadTable) -> tuple[Term, ...]:
    """Return the causes of the model that the readings can show."""
    names = {form.name for form in load_forms(table, given.extra_causes)}
    forms = given.provenance.get("calibration", {}).get("forms", {})
    terms = []
    for term in given.causes:
        if term.name in names:
            cause = cause_named(term.name, where="model", extra=given.extra_causes)
            form = form_named(cause, forms.get(term.name, ""), term.shape)
            free = {p.name: term.shape[p.name] for p in form.shape}
            terms.append(Term(form, free, known=True))
    return tuple(terms)


def _unfit(table: LoadTable) -> str:
    """Return why gain and zeros cannot be fitted, or an empty text."""
    base, volts = base_columns(table)[table.used], table.reading_v[table.used]
    seen = base[:, base.any(axis=0)]
    enough = len(seen) >= seen.shape[1] + LEAST_DOF and base[:, 0].any()
    if not (enough and np.linalg.matrix_rank(seen) == seen.shape[1]):
        return (
            f"{len(seen)} readings do not fix one gain and {len(table.names)} zeros; needed: "
            f"{len(table.names) + 1 + LEAST_DOF} readings under different loads"
        )
    if not float(np.ptp(volts)) > 0.0:
        return f"the readings are {float(volts[0]):.6g} V throughout; needed: a live channel"
    return ""
