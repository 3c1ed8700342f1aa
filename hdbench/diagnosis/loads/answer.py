"""Answer of a diagnosis of readings: what causes are worth, and everything that is told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.answer.records import DataFlag, Gain, LeftOutSamples, Testable
from hdbench.diagnosis.answer.result import (
    Diagnosis,
    LoadPictures,
    NamedCause,
    Rest,
    Unexplained,
)
from hdbench.diagnosis.loads.fit import LoadFit, fit_loads
from hdbench.diagnosis.loads.forms import NAMES, Term, form_named
from hdbench.diagnosis.loads.gains import GainScatter
from hdbench.diagnosis.loads.search import Accepted, Look, without
from hdbench.diagnosis.loads.table import LoadTable, levels, load_table, one_hot
from hdbench.errors import DataError
from hdbench.model import BenchModel, CauseTerm, catalogue, cause_named, cause_parameters
from hdbench.profile.schema import ProfileData
from hdbench.records import Loads
from hdbench.records.trace import FloatArray

__all__ = ["LoadAnswer", "left_out", "simulate_loads"]

# an effect that has to be this many of its standard deviations large is seen without a test
_BLIND_SIGMAS = 20.0
# standard normal quantile of 90 %
_POWER = 1.2815515655446004
# draws of the bootstrap: its 2.5 % quantile is known to a twentieth of a standard deviation
_DRAWS = 2000
# fewer units than this cannot carry a bootstrap: readings are drawn instead
_LEAST_UNITS = 5
# a fold with more of an effect's sum of squares than this is not predicted by the others
_MOST_IN_ONE = 0.5
# a reading that is alone in fixing a coefficient says nothing about the prediction
_ALONE = 3e-5
# held-out residual above the noise that chance makes: 1.25 is 3 standard deviations of 144 readings
_ABOVE_NOISE = 1.25
_BASELINE = ("gain", "zero of each experiment")

IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class LoadAnswer:
    """Everything from which the answer is put together."""

    profile: ProfileData
    given: BenchModel
    baseline: LoadFit  # gain, zeros and the given model's causes
    fit: LoadFit  # with all names
    places: LoadFit  # with the places without a name after them
    base: FloatArray  # baseline's columns of `fit`
    accepted: tuple[Accepted, ...]  # names and outliers of `fit`
    left: tuple[Accepted, ...]  # places of `places`
    scatter: GainScatter | None
    uneven: Unexplained | None  # scatter that changes with the torque
    looks: tuple[Look, ...]  # last ones at the residual
    flags: tuple[DataFlag, ...]
    known: int  # terms of the given model come first
    rng: np.random.Generator

    @property
    def table(self) -> LoadTable:
        """Readings with the signal of the final fit."""
        return self.fit.table

    def build(self, settings: Mapping[str, Any]) -> Diagnosis:
        """Return the diagnosis."""
        line, alpha = float(settings["materiality"]), float(settings["alpha"])
        terms = self.fit.terms
        outliers = [one for one in self.accepted if terms[one.places[0]].name == "outlier"]
        named = [self._named(one) for one in self.accepted if one not in outliers]
        causes = [
            c for c in named if c.share_of_variance >= line and c.gain.explained_fraction > 0.0
        ]
        places = [self._place(one, self.places) for one in (*self.left, *outliers)]
        places += [self.uneven] if self.uneven is not None else []
        if self.scatter is not None and not self.scatter.within_profile:
            places.append(self._scattered(self.scatter))
        unexplained = [u for u in places if u.share_of_variance >= line]
        folds, before, after = self._held_out()
        model = self._extended()
        known = [term.name for term in terms[: self.known]]
        simulated = {"terms": [*_BASELINE, *known], "heldout_rms_nm": before}
        verdict, reason = self._verdict(bool(causes), bool(unexplained), alpha)
        apart = [self._outlier_entry(one.places[0]) for one in outliers]
        times = [float(self.table.motion.time_s[int(entry["reading"]) - 1]) for entry in apart]
        return Diagnosis(
            verdict,
            tuple(causes),
            tuple(c for c in named if c not in causes),
            tuple(unexplained),
            tuple(u for u in places if u not in unexplained),
            (*self.flags, *(DataFlag("outlier", time, time, 1) for time in times)),
            self._minimum_detectable(alpha),
            {**simulated, "as_given_rms_nm": self._as_given_rms()},
            {"terms": [*_BASELINE, *(t.name for t in model.causes)], "heldout_rms_nm": after},
            model,
            {**settings, **self._settings(folds), "outliers": apart},
            reason,
            load_pictures=self._pictures(),
            left_out=left_out(self.table, self.flags),
            rest=None if after is None else self._rest(after, tuple(unexplained)),
            testable=self._testable(),
        )

    def _verdict(self, causes: bool, unexplained: bool, alpha: float) -> tuple[str, str]:
        """Return the verdict and its sentence: too few readings cannot tell."""
        if causes or unexplained:
            verdict = "named-and-unexplained" if causes and unexplained else "unexplained"
            return ("named" if not unexplained else verdict), self._reason()
        dof = self.fit.dof
        needed = [
            self._sigmas(look, alpha) for look in self.looks if look.family.form.name in NAMES
        ]
        if min(needed, default=np.inf) <= _BLIND_SIGMAS:
            return "nothing-found", self._reason()
        return "cannot-tell", (
            f"{int(self.table.used.sum())} readings leave {dof} degrees of freedom beside gain and "
            "zeros: too few to tell an effect from noise"
        )

    def _reason(self) -> str:
        """Return the sentence that tells a scatter of gains that is no finding."""
        scatter = self.scatter
        if scatter is None or not scatter.within_profile:
            return ""
        return (
            f"gains differ between {scatter.between} by {100.0 * scatter.relative_std:.2g} % "
            "(standard deviation) without a form; the profile states "
            f"{100.0 * scatter.expected:.2g} %"
        )

    # causes and places

    def _named(self, one: Accepted) -> NamedCause:
        # a loop of several elements has no shape of one: it is told by the best single one
        fit, place = (self.fit, one.places[0]) if one.alone is None else (one.alone, -1)
        form = fit.terms[place].form
        table = cause_parameters(self._cause_term(fit, place), extra=self.given.extra_causes)
        missing = {p.name for i, p in enumerate(form.cause.linear) if i not in form.linear}
        pairs = {name.replace("cosine", "amplitude") for name in missing}
        pairs |= {name.replace("cosine", "phase").replace("_nm", "_rad") for name in missing}
        return NamedCause(
            form.name,
            one.group,
            one.rivals,
            {k: self._entry(entry) for k, entry in table.items() if k not in missing | pairs},
            one.nats,
            one.false_alarm,
            self._gain(one.places),
            form.cause.experiment if len(one.group) > 1 or one.rivals else None,
            self._share(self.fit, one.places),
            "time" if form.cause.locked_to == "time" else "torque",
            probability=one.probability,
        )

    def _entry(self, entry: Mapping[str, float | str | None]) -> dict[str, float | str | None]:
        """Return a parameter: no uncertainty where none was found, time in readings if counted."""
        unit = str(entry["unit"])
        if not self.table.time_measured:
            unit = "reading" if unit == "s" else unit
            unit = unit.removesuffix("/s") + "/reading" if unit.endswith("/s") else unit
        return {**entry, "std": entry["std"] or None, "unit": unit}

    def _place(self, one: Accepted, fit: LoadFit) -> Unexplained:
        """Return a place without a name."""
        term = fit.terms[one.places[0]]
        columns = term.columns(fit.table)
        effect, touched = columns @ fit.linear[one.places[0]], np.any(columns != 0.0, axis=1)
        share = self._share(fit, one.places)
        if term.name == "outlier":
            number = float(np.flatnonzero(touched)[0] + 1)
            extent, unit, domain = (number, number), "reading", "outliers"
        else:
            over_time = term.name in ("drift", "stretch")
            axis = fit.table.motion.time_s if over_time else fit.table.torque_nm
            extent = (float(axis[touched].min()), float(axis[touched].max()))
            unit, domain = (fit.table.time_unit, "time") if over_time else ("N m", "torque")
        centre = 0.5 * (extent[0] + extent[1])
        if term.name in ("curve", "gain"):
            centre = max(extent, key=abs)
        basis = fit_loads(fit.table, self.base, without(fit.terms, one.places), refine=False)
        left = basis.space()
        seen = left.basis @ (left.basis.T @ effect[fit.table.used])
        size = float(np.abs(effect if term.name == "outlier" else seen).max())
        return Unexplained(domain, centre, extent, unit, size, share, one.false_alarm)

    def _scattered(self, scatter: GainScatter) -> Unexplained:
        torque = self.table.torque_nm
        top = self.table.top_nm
        common = fit_loads(self.table, self._plain, self.fit.terms, refine=False)
        share = self._share_of(common.rss - self.fit.rss)
        extent = (float(torque.min()), float(torque.max()))
        size, chance = scatter.relative_std * top, scatter.false_alarm
        return Unexplained("torque", top, extent, "N m", size, share, chance)

    def _outlier_entry(self, place: int) -> dict[str, Any]:
        table, offset = self.table, float(self.fit.linear[place][0])
        index = round(self.fit.terms[place].shape["place"])
        lever = self.profile.arm.gravity_m_s2 * self.profile.arm.length_m
        return {
            "reading": index + 1,
            "experiment": table.names[table.experiment[index]],
            "torque_nm": float(table.torque_nm[index]),
            "offset_nm": offset,
            "fitting_mass_kg": abs(float(table.torque_nm[index]) + offset) / lever,
        }

    # what they are worth

    @property
    def _plain(self) -> FloatArray:
        return self.base[:, : 1 + len(self.table.names)]

    def _share_of(self, drop: float) -> float:
        """Return a fall of the sum of squares, V^2, as a share of the baseline's."""
        return float(np.clip(drop / max(self.baseline.rss, 1e-300), 0.0, 1.0))

    def _share(self, fit: LoadFit, places: Sequence[int]) -> float:
        """Return the share of variance of terms, added first to last or lost alone."""
        before = fit.terms[: places[0]]
        mine = tuple(fit.terms[place] for place in places)
        rss = [
            fit_loads(fit.table, self.base, terms, refine=False).rss
            for terms in (before, (*before, *mine), without(fit.terms, places), fit.terms)
        ]
        return self._share_of(max(rss[0] - rss[1], rss[2] - rss[3]))

    def _fold_kinds(self) -> list[tuple[str, IntArray]]:
        """Return the ways to leave readings out that this table allows, the best one first."""
        table, level = self.table, levels(self.table)
        kinds = [("experiment", table.experiment)] if len(table.names) > 2 else []
        if level.max() > 2 and len(level) > level.max() + 1:
            kinds.append(("load level", level))
        return [*kinds, ("reading", np.arange(len(table), dtype=np.int64))]

    def _held_out(self) -> tuple[str, float | None, float | None]:
        """Return what was left out together, and the RMS of baseline and final model on it."""
        kinds = self._fold_kinds()
        for name, folds in kinds:
            before = held_out_nm(self.baseline, self._plain, folds)
            after = held_out_nm(self.fit, self.base, folds)
            if before is not None and after is not None:
                return name, _rms(before), _rms(after)
        return kinds[-1][0], None, None

    def _gain(self, places: Sequence[int]) -> Gain:
        """Return the held-out gain of a cause by the best way of leaving out that it allows."""
        fit, used = self.fit, self.table.used
        less = fit_loads(self.table, self.base, without(fit.terms, places), refine=False).space()
        effect = np.sum([fit.effect_nm(place) for place in places], axis=0)
        seen = (less.basis @ (less.basis.T @ effect[used])) ** 2
        for _, folds in self._fold_kinds():
            parts = np.bincount(folds[used], weights=seen)
            after = held_out_nm(fit, self.base, folds)
            before = held_out_nm(fit, self.base, folds, places)
            if parts.max() > _MOST_IN_ONE * parts.sum() or after is None or before is None:
                continue
            return self._bootstrap(before**2, after**2)
        return Gain(fit.noise_nm, fit.noise_nm, 0.0, (0.0, 0.0))

    def _bootstrap(self, before: FloatArray, after: FloatArray) -> Gain:
        units = self.table.experiment[self.table.used]
        if len(np.unique(units)) < _LEAST_UNITS:
            units = np.arange(len(before), dtype=np.int64)
        old, new = (one_hot(units).T @ squares for squares in (before, after))
        pick = self.rng.integers(0, len(old), (_DRAWS, len(old)))
        tiny = float(np.finfo(float).tiny)
        drawn = 1.0 - new[pick].sum(axis=1) / np.maximum(old[pick].sum(axis=1), tiny)
        low, high = np.percentile(drawn, (2.5, 97.5))
        share = float(1.0 - after.mean() / max(float(before.mean()), tiny))
        return Gain(_rms(before**0.5), _rms(after**0.5), share, (float(low), float(high)))

    def _as_given_rms(self) -> float:
        """Return the RMS of readings by the profile's gain less the given model, N m."""
        measured = self.table.reading_v * self.profile.sensor.gain_nm_per_v
        motion = self.baseline.table.with_signal(self.table.torque_nm).motion
        simulated = self.table.torque_nm + self.given.cause_torque_nm(motion)
        return _rms((measured - simulated)[self.table.used])

    # what would have been seen

    def _sigmas(self, look: Look, alpha: float) -> float:
        """Return how many of its standard deviations an effect needs to be found with 90 %.

        The share of the residual that the false-alarm rate asks for is carried to standard
        deviations by the F law.
        """
        from scipy.special import betaincinv

        rank, dof = look.family.cells[look.best][1].shape[1], self.fit.dof
        rest = float(betaincinv((dof - rank) / 2.0, rank / 2.0, alpha / look.trials))
        return float(np.sqrt((1.0 - rest) / max(rest, 1e-300) * (dof - rank))) + _POWER

    def _minimum_detectable(self, alpha: float) -> tuple[tuple[str, float], ...]:
        """Return the largest torque of each kind of effect that would have been found."""
        space = self.fit.space()
        limits: dict[str, float] = {}
        for look in self.looks:
            form = look.family.form
            if form.name == "outlier":
                continue
            sizes = []
            for term, _ in look.family.cells:
                columns = term.columns(self.table)[self.table.used]
                length = np.linalg.norm(space.basis.T @ columns, axis=0)
                seen = length > 0.0
                sizes.append(np.mean(np.abs(columns[:, seen]).max(axis=0) / length[seen]))
            size = self._sigmas(look, alpha) * self.fit.noise_nm * float(np.median(sizes))
            limits[form.name] = min(size, limits.get(form.name, size))
        return tuple(limits.items())

    def _rest(self, after: float, unexplained: tuple[Unexplained, ...]) -> Rest:
        """Return what the extended model leaves; what accounts for it where that is too much."""
        noise = self.places.noise_nm
        return Rest(after, noise, unexplained if after > _ABOVE_NOISE * noise else ())

    def _testable(self) -> tuple[Testable, ...]:
        """Return of each name of the catalogue whether these readings can show it."""
        seen = {look.family.form.name for look in self.looks}
        seen |= {name for one in self.accepted for name in (*one.group, *one.rivals)}
        told = []
        for name, cause in catalogue().items():
            because = cause.applicable(self.table.motion) or ""
            if name not in NAMES:
                because = "readings stand still: a run shows it"
            elif not because and name not in seen:
                because = "gain, zeros and what was found take all of it on these loads"
            told.append(Testable(name, not because, because))
        return tuple(told)

    # the extended model, the pictures and the settings

    def _pictures(self) -> LoadPictures:
        table, fit, before = self.table, self.fit, self.baseline
        return LoadPictures(
            reading=np.arange(1, len(table) + 1),
            experiment=tuple(table.names[i] for i in table.experiment.tolist()),
            time_s=table.motion.time_s,
            torque_nm=table.torque_nm,
            position_rad=table.motion.output_angle_rad,
            falling=table.falling,
            used=table.used,
            measured_nm=table.reading_v / fit.slope_v_per_nm,
            simulated_nm=before.fitted_v / before.slope_v_per_nm,
            extended_nm=fit.fitted_v / fit.slope_v_per_nm,
            residual_before_nm=(table.reading_v - before.fitted_v) / before.slope_v_per_nm,
            residual_after_nm=(table.reading_v - fit.fitted_v) / fit.slope_v_per_nm,
        )

    def _cause_term(self, fit: LoadFit, place: int) -> CauseTerm:
        """Return a fitted term as the model writes it; what its form leaves out is 0."""
        term = fit.terms[place]
        form, found, small = term.form, fit.linear[place], fit.covariances[place]
        whole = cause_named(term.name, where="model", extra=self.given.extra_causes)
        names = [p.name for p in (*whole.linear, *whole.shape)]
        linear, matrix = np.zeros(len(whole.linear)), np.zeros((len(names), len(names)))
        count = len(form.linear)
        linear[list(form.linear)] = found[:count]
        own = [p.name for p in (*form.parameters, *form.shape)]
        rows = [*range(count), *range(len(found), len(small))]
        at = [names.index(name) for name in own]
        matrix[np.ix_(at, at)] = small[np.ix_(rows, rows)]
        shape = {**form.fixed, **term.shape}
        # a later cause may push an earlier one past its domain by what the readings cannot tell
        values = tuple(
            float(np.clip(x, p.lower, p.upper)) for x, p in zip(linear, whole.linear, strict=True)
        )
        shapes = {p.name: shape.get(p.name, p.default or p.lower) for p in whole.shape}
        return CauseTerm(term.name, shapes, values, tuple(map(tuple, matrix.tolist())))

    def _extended(self) -> BenchModel:
        """Return the given model with all causes, and gain, zeros and forms in its provenance."""
        fit, names = self.fit, self.table.names
        zeros = fit.base[1 : 1 + len(names)] / fit.slope_v_per_nm
        calibration = {
            "gain_nm_per_v": 1.0 / fit.slope_v_per_nm,
            "zeros_nm": dict(zip(names, zeros.tolist(), strict=True)),
            "forms": self._forms(),
        }
        shown = {term.name for term in fit.terms if term.known}
        kept = tuple(term for term in self.given.causes if term.name not in shown)
        provenance = {**self.given.provenance, "calibration": calibration}
        model = replace(self.given, causes=kept, provenance=provenance)
        for place, term in enumerate(fit.terms):
            if "place" in term.shape:
                continue
            model = model.with_cause(self._cause_term(fit, place))
            values = fit.linear[place][len(term.form.linear) :].tolist()
            for cause, value in zip(term.form.beside, values, strict=True):
                model = model.with_cause(CauseTerm(cause.name, {}, (value,)))
        return model

    def _forms(self) -> dict[str, str]:
        return {t.name: t.form.label for t in self.fit.terms if t.form.label}

    def _settings(self, folds: str) -> dict[str, Any]:
        fit, table = self.fit, self.table
        own = table.mean_std_v[table.used]
        known = own[np.isfinite(own)]
        samples = _rms(known) / abs(fit.slope_v_per_nm) if len(known) else None
        return {
            "regression": "reading on torque",
            "gain_nm_per_v": 1.0 / fit.slope_v_per_nm,
            "noise": {"std_nm": fit.noise_nm, "dof": fit.dof, "of_samples_nm": samples},
            "readings_used": int(table.used.sum()),
            "time": "time_s" if table.time_measured else "reading number",
            "held_out": folds,
            "forms": self._forms(),
            "gain_scatter": None if self.scatter is None else self.scatter.to_dict(),
        }


def left_out(table: LoadTable, flags: Sequence[DataFlag]) -> tuple[LeftOutSamples, ...]:
    """Return which readings took no part, and why."""
    words = {
        "missed-samples": "the reading is lost",
        "saturation": "at the end of the converter's range",
        "stuck-value": "equal readings under different loads",
    }
    counts = {words[flag.name]: flag.samples for flag in flags}
    others = int((~table.used).sum()) - sum(counts.values())
    if others > 0:
        counts["a preload or shunt reading"] = others
    return tuple(LeftOutSamples(why, n, n / len(table)) for why, n in counts.items())


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def held_out_nm(
    fit: LoadFit, base: FloatArray, folds: IntArray, places: Sequence[int] = ()
) -> FloatArray | None:
    """Return measured less predicted of each fold from all others, N m, terms `places` left out.

    None where the rest does not fix what a fold needs. Of an experiment that is left out as a whole
    the zero is the mean of its residuals, and what stays is scaled to the variance of a prediction
    with a known zero.
    """
    table, used = fit.table, fit.table.used
    zeros = one_hot(table.experiment)[used]
    gains = np.delete(base, np.s_[1 : 1 + zeros.shape[1]], axis=1)
    for i, term in enumerate(fit.terms):
        columns = term.columns(table)
        if i in places:
            continue
        if term.form.whole:
            gains[:, 0] += columns[:, 0]
        else:
            gains = np.hstack([gains, columns])
    known = gains[used]
    size = np.sqrt(np.einsum("nk,nk->k", known, known))
    known = known / np.where(size > 0.0, size, 1.0)
    response, numbers = table.reading_v[used], folds[used]
    left = np.full(len(response), np.nan)
    for number in np.unique(numbers):
        test = numbers == number
        train, asked = np.hstack([known, zeros])[~test], np.hstack([known, zeros])[test]
        solution = np.linalg.lstsq(train, response[~test], rcond=1e-9)[0]
        _, s, v = np.linalg.svd(train, full_matrices=len(train) < train.shape[1])
        blind = v[int((s > 1e-9 * s[0]).sum()) :].T
        # a zero that no training reading shows is allowed to be unknown, nothing else is
        unseen = asked[:, : known.shape[1]] @ blind[: known.shape[1]]
        if float(np.abs(unseen).max(initial=0.0)) > _ALONE:
            return None
        left[test] = response[test] - asked @ solution
        for column in np.flatnonzero(~zeros[~test].any(axis=0) & zeros[test].any(axis=0)):
            mine = np.flatnonzero(test)[zeros[test][:, column] > 0.0]
            if len(mine) > 1:
                spread = left[mine] - left[mine].mean()
                left[mine] = spread * np.sqrt(len(mine) / (len(mine) - 1.0))
    return left / fit.slope_v_per_nm


def simulate_loads(model: BenchModel, loads: Loads, profile: ProfileData) -> Loads:
    """Return the readings that a model found in readings gives under the same loads.

    A limit acts last; an experiment that the model does not know has the zero 0. `DataError` where
    the model has no calibration or a cause does not fit the catalogue.
    """
    calibration = model.provenance.get("calibration")
    if not isinstance(calibration, dict) or "gain_nm_per_v" not in calibration:
        raise DataError(
            "the model holds no calibration; needed: gain and zeros as found in readings",
            where=loads.source,
            fix="diagnose a loads file and use the model that this writes",
        )
    table = load_table(loads, profile)
    zeros, forms = calibration.get("zeros_nm", {}), calibration.get("forms", {})
    signal = table.torque_nm + np.array(
        [float(zeros.get(table.names[number], 0.0)) for number in table.experiment]
    )
    for term in sorted(model.causes, key=lambda t: "limit_nm" in t.shape):
        cause = cause_named(term.name, where="model", extra=model.extra_causes)
        form = form_named(cause, forms.get(term.name, ""), term.shape)
        columns = Term(form, dict(term.shape)).columns(table.with_signal(signal))
        signal = signal + columns @ np.asarray(term.linear)[list(form.linear)]
    volts = (signal / float(calibration["gain_nm_per_v"])).tolist()
    readings = zip(loads.readings, volts, strict=True)
    return replace(loads, readings=tuple(replace(r, reading_v=v) for r, v in readings))
