"""Answer of a diagnosis of readings: what causes are worth, and everything that is told."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hdbench.diagnosis.answer.result import Diagnosis, by_share, verdict_of
from hdbench.diagnosis.loads.fit import LoadFit, fit_loads, gain_of, held_out, rms
from hdbench.diagnosis.loads.forms import NAMES
from hdbench.diagnosis.loads.gains import GainScatter
from hdbench.diagnosis.loads.search import Accepted, Look
from hdbench.diagnosis.loads.table import LoadTable, left_out
from hdbench.model import BenchModel, CauseTerm, catalogue, cause_parameters
from hdbench.model.definition import quadratures
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray
from hdbench.results.diagnosis import (
    Detectable,
    ModelFit,
    NamedCause,
    ParameterValue,
    Rest,
    StretchFlag,
    Testable,
    Unexplained,
    parameter_values,
)

_BASELINE = ("gain", "zero of each experiment")


@dataclass(frozen=True, slots=True)
class LoadAnswer:
    """Everything from which the answer is put together."""

    profile: ProfileData
    given: BenchModel
    baseline: LoadFit  # gain, zeros and the given model's causes
    fit: LoadFit  # with all names
    places: LoadFit  # with the places without a name after them
    accepted: Sequence[Accepted]  # names and outliers of `fit`
    left: Sequence[Accepted]  # places of `places`
    scatter: GainScatter | None
    uneven: Unexplained | None  # scatter that changes with the torque
    looks: Sequence[Look]  # last ones at the residual
    flags: Sequence[StretchFlag]
    rng: np.random.Generator

    @property
    def table(self) -> LoadTable:
        """Readings with the signal of the final fit."""
        return self.fit.table

    def build(self, settings: Mapping[str, Any]) -> Diagnosis:
        """Return the diagnosis."""
        line, alpha = float(settings["materiality"]), float(settings["alpha"])
        table, terms = self.table, self.fit.terms
        outliers = [one for one in self.accepted if terms[one.places[0]].unnamed]
        named = [self._named(one) for one in self.accepted if one not in outliers]
        causes = tuple(
            c for c in named if c.share_of_variance >= line and c.gain.explained_fraction > 0.0
        )
        found = [self._place(one, self.places) for one in (*self.left, *outliers)]
        found += [self.uneven] if self.uneven is not None else []
        if self.scatter is not None and not self.scatter.within_profile:
            found.append(self._scattered(self.scatter))
        unexplained, small = by_share(found, line)
        folds, before, after = held_out(self.baseline, self.fit)
        model = self._extended()
        apart = [self._outlier_entry(one.places[0]) for one in outliers]
        times = [float(table.motion.time_s[int(entry["reading"]) - 1]) for entry in apart]
        noise = self.places.noise_nm
        # chance makes 1.25 of 144 readings at 3 standard deviations
        told = unexplained if after is not None and after > 1.25 * noise else ()
        verdict, reason = self._verdict(causes, unexplained, alpha)
        return Diagnosis(
            verdict=verdict,
            reason=reason,
            causes=causes,
            minor=tuple(c for c in named if c not in causes),
            unexplained=unexplained,
            minor_unexplained=small,
            data_flags=(*self.flags, *(StretchFlag("outlier", time, time, 1) for time in times)),
            left_out=left_out(table, self.flags),
            rest=None if after is None else Rest(after, noise, told),
            testable=self._testable(),
            minimum_detectable=self._minimum_detectable(alpha),
            simulated=ModelFit(
                terms=(*_BASELINE, *(term.name for term in self.baseline.terms)),
                heldout_rms_nm=before,
                as_given_rms_nm=self._as_given_rms(),
            ),
            extended=ModelFit(
                terms=(*_BASELINE, *(term.name for term in model.causes)), heldout_rms_nm=after
            ),
            settings={**settings, **self._settings(folds), "outliers": apart},
            model=model,
            load_pictures=self._pictures(),
        )

    def _verdict(
        self, causes: Sequence[NamedCause], unexplained: Sequence[Unexplained], alpha: float
    ) -> tuple[str, str]:
        """Return the verdict and its sentence: too few readings cannot tell."""
        verdict, scatter = verdict_of(causes, unexplained), self.scatter
        needed = [self._sigmas(look, alpha) for look in self.looks if look.form.name in NAMES]
        # an effect of 20 of its standard deviations is seen without a test
        if verdict == "nothing-found" and not min(needed, default=np.inf) <= 20.0:
            return "cannot-tell", (
                f"{int(self.table.used.sum())} readings leave {self.fit.dof} degrees of freedom "
                "beside gain and zeros: too few to tell an effect from noise"
            )
        if scatter is None or not scatter.within_profile:
            return verdict, ""
        return verdict, (
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
        missing = {p.name for p in form.cause.linear} - {p.name for p in form.parameters}
        for pair in quadratures(form.cause):
            if pair.cosine in missing:
                missing |= {pair.amplitude, pair.phase}
        shown = parameter_values({k: v for k, v in table.items() if k not in missing})
        return NamedCause(
            name=form.name,
            group=one.group,
            rivals=one.rivals,
            parameters={name: self._stated(value) for name, value in shown.items()},
            evidence_nats=one.nats,
            probability=one.probability,
            false_alarm_probability=one.false_alarm,
            gain=gain_of(self.fit, one.places, self.rng),
            separating_experiment=(
                form.cause.experiment if len(one.group) > 1 or one.rivals else None
            ),
            share_of_variance=self._share(self.fit, one.places),
            domain="time" if form.cause.locked_to == "time" else "torque",
        )

    def _stated(self, value: ParameterValue) -> ParameterValue:
        """Return a parameter: no uncertainty where none was found, time in readings if counted."""
        unit = value.unit
        if not self.table.time_measured:
            unit = re.sub(r"(^|/)s$", r"\1reading", unit)
        return ParameterValue(value.value, value.std or None, unit)

    def _place(self, one: Accepted, fit: LoadFit) -> Unexplained:
        """Return a place without a name."""
        place, table = one.places[0], fit.table
        name, effect = fit.terms[place].name, fit.effect_nm(place)
        touched = np.any(fit.terms[place].columns(table) != 0.0, axis=1)
        size = float(np.abs(fit.refit(fit.others(one.places)).space().seen(effect)).max())
        axis, domain, unit = table.torque_nm, "torque", "N m"
        if name == "outlier":
            axis, domain, unit = np.arange(1.0, len(table) + 1.0), "outliers", "reading"
            size = float(np.abs(effect).max())
        elif name in ("drift", "stretch"):
            axis, domain = table.motion.time_s, "time"
            unit = "s" if table.time_measured else "reading"
        extent = (float(axis[touched].min()), float(axis[touched].max()))
        centre = max(extent, key=abs) if name in ("curve", "gain") else 0.5 * sum(extent)
        return Unexplained(
            domain=domain,
            location=centre,
            extent=extent,
            unit=unit,
            size_nm=size,
            share_of_variance=self._share(fit, one.places),
            false_alarm_probability=one.false_alarm,
        )

    def _scattered(self, scatter: GainScatter) -> Unexplained:
        torque, top = self.table.torque_nm, self.table.top_nm
        common = fit_loads(self.table, self.baseline.base, self.fit.terms, refine=False)
        return Unexplained(
            domain="torque",
            location=top,
            extent=(float(torque.min()), float(torque.max())),
            unit="N m",
            size_nm=scatter.relative_std * top,
            share_of_variance=self._share_of(common.rss - self.fit.rss),
            false_alarm_probability=scatter.false_alarm,
        )

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

    def _share_of(self, drop: float) -> float:
        """Return a fall of the sum of squares, V^2, as a share of the baseline's."""
        return float(np.clip(drop / max(self.baseline.rss, 1e-300), 0.0, 1.0))

    def _share(self, fit: LoadFit, places: Sequence[int]) -> float:
        """Return the share of variance of terms, added first to last or lost alone."""
        before = fit.terms[: places[0]]
        mine = tuple(fit.terms[place] for place in places)
        sets = (before, (*before, *mine), fit.others(places), fit.terms)
        rss = [fit.refit(terms).rss for terms in sets]
        return self._share_of(max(rss[0] - rss[1], rss[2] - rss[3]))

    def _as_given_rms(self) -> float:
        """Return the RMS of readings by the profile's gain less the given model, N m."""
        measured = self.table.reading_v * self.profile.sensor.gain_nm_per_v
        motion = self.table.with_signal(self.table.torque_nm).motion
        simulated = self.table.torque_nm + self.given.cause_torque_nm(motion)
        return rms((measured - simulated)[self.table.used])

    # what would have been seen

    def _sigmas(self, look: Look, alpha: float) -> float:
        """Return how many of its standard deviations an effect needs to be found with 90 %."""
        from scipy.special import betaincinv, ndtri

        # the share of the residual that the false-alarm rate asks for, by the F law
        rank, more = look.rank, self.fit.dof - look.rank
        rest = float(betaincinv(more / 2.0, rank / 2.0, alpha / look.trials))
        return float(np.sqrt((1.0 - rest) / max(rest, 1e-300) * more) + ndtri(0.9))

    def _minimum_detectable(self, alpha: float) -> tuple[Detectable, ...]:
        """Return the largest torque of each kind of effect that would have been found."""
        space = self.fit.space()
        limits: dict[str, float] = {}
        for look in self.looks:
            name = look.form.name
            if name == "outlier":
                continue
            sizes = []
            for term, _ in look.cells:
                columns = term.columns(self.table)[space.used]
                length = np.linalg.norm(space.basis.T @ columns, axis=0)
                seen = length > 0.0
                sizes.append(np.mean(np.abs(columns[:, seen]).max(axis=0) / length[seen]))
            size = self._sigmas(look, alpha) * self.fit.noise_nm * float(np.median(sizes))
            limits[name] = min(size, limits.get(name, size))
        return tuple(Detectable(*limit) for limit in limits.items())

    def _testable(self) -> tuple[Testable, ...]:
        """Return of each name of the catalogue whether these readings can show it."""
        seen = {look.form.name for look in self.looks}
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

    def _pictures(self) -> dict[str, FloatArray]:
        table, before, after = self.table, self.baseline, self.fit
        return {
            "reading": np.arange(1.0, len(table) + 1.0),
            "time_s": table.motion.time_s,
            "torque_nm": table.torque_nm,
            "position_rad": table.motion.output_angle_rad,
            "falling": table.falling.astype(float),
            "used": table.used.astype(float),
            "measured_nm": table.reading_v / after.slope_v_per_nm,
            "simulated_nm": before.fitted_v / before.slope_v_per_nm,
            "extended_nm": after.fitted_v / after.slope_v_per_nm,
            "residual_before_nm": (table.reading_v - before.fitted_v) / before.slope_v_per_nm,
            "residual_after_nm": (table.reading_v - after.fitted_v) / after.slope_v_per_nm,
        }

    def _cause_term(self, fit: LoadFit, place: int) -> CauseTerm:
        """Return a fitted term as the model writes it; what its form leaves out is 0."""
        term, found, small = fit.terms[place], fit.linear[place], fit.covariances[place]
        form = term.form
        cause, count = form.cause, len(form.parameters)
        names = [p.name for p in (*cause.linear, *cause.shape)]
        own = [p.name for p in (*form.parameters, *form.shape)]
        at = [names.index(name) for name in own]
        rows = [*range(count), *range(len(found), len(small))]
        matrix = np.zeros((len(names), len(names)))
        matrix[np.ix_(at, at)] = small[np.ix_(rows, rows)]
        linear = dict(zip(own, found[:count].tolist(), strict=False))
        # a later cause may push an earlier one past its domain by what the readings cannot tell
        values = tuple(min(max(linear.get(p.name, 0.0), p.lower), p.upper) for p in cause.linear)
        shape = {**form.fixed, **term.shape}
        shapes = {p.name: shape.get(p.name, p.default or p.lower) for p in cause.shape}
        return CauseTerm(term.name, shapes, values, tuple(map(tuple, matrix.tolist())))

    def _extended(self) -> BenchModel:
        """Return the given model with all causes, and gain, zeros and forms in its provenance."""
        fit, names = self.fit, self.table.names
        zeros = fit.baseline_v[1 : 1 + len(names)] / fit.slope_v_per_nm
        calibration = {
            "gain_nm_per_v": 1.0 / fit.slope_v_per_nm,
            "zeros_nm": dict(zip(names, zeros.tolist(), strict=True)),
            "forms": self._forms(),
        }
        shown = {term.name for term in self.baseline.terms}
        kept = tuple(term for term in self.given.causes if term.name not in shown)
        provenance = {**self.given.provenance, "calibration": calibration}
        model = replace(self.given, causes=kept, provenance=provenance)
        for place, term in enumerate(fit.terms):
            if term.unnamed:
                continue
            model = model.with_cause(self._cause_term(fit, place))
            values = fit.linear[place][len(term.form.parameters) :].tolist()
            for cause, value in zip(term.form.beside, values, strict=True):
                model = model.with_cause(CauseTerm(cause.name, {}, (value,)))
        return model

    def _forms(self) -> dict[str, str]:
        return {t.name: t.form.label for t in self.fit.terms if t.form.label}

    def _settings(self, folds: str) -> dict[str, Any]:
        fit, table = self.fit, self.table
        own = table.mean_std_v[table.used]
        known = own[np.isfinite(own)]
        samples = rms(known) / abs(fit.slope_v_per_nm) if len(known) else None
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
