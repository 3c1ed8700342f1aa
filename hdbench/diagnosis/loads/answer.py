"""What was found in readings, put together as the answer of a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdbench.diagnosis.answer.result import Diagnosis, NamedCause, Unexplained
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.loads.extended import extended_by_loads, load_cause_term
from hdbench.diagnosis.loads.fit import LoadFit, fit_loads
from hdbench.diagnosis.loads.left import Left
from hdbench.diagnosis.loads.limits import least_sigmas, minimum_detectable_load
from hdbench.diagnosis.loads.names import Accepted, is_outlier
from hdbench.diagnosis.loads.pictures import load_pictures
from hdbench.diagnosis.loads.scatter import GainScatter
from hdbench.diagnosis.loads.search import Found
from hdbench.diagnosis.loads.table import LoadTable
from hdbench.diagnosis.loads.told import outliers_of, reason_of, settings_of
from hdbench.diagnosis.loads.weigh import Weighing
from hdbench.diagnosis.measured.preflight import DataFlag
from hdbench.model import BenchModel, catalogue, cause_parameters
from hdbench.profile.schema import ProfileData

__all__ = ["LoadAnswer"]

# an effect that has to be this many of its standard deviations large is seen without a test
_BLIND_SIGMAS = 20.0
_BASELINE = ("gain", "zero of each experiment")


@dataclass(frozen=True, slots=True)
class LoadAnswer:
    """Everything from which the answer is put together.

    Parameters
    ----------
    profile : ProfileData
        Bench.
    given : BenchModel
        Model that was held against the readings.
    found : Found
        What the search found.
    weighing : Weighing
        What causes are weighed by.
    left : tuple of Left
        Places without a name.
    scatter : GainScatter or None
        Gains that differ without a form.
    flags : tuple of DataFlag
        Doubtful readings.
    n_known : int
        Causes that `given` already held; they come first in the fit.
    """

    profile: ProfileData
    given: BenchModel
    found: Found
    weighing: Weighing
    left: tuple[Left, ...]
    scatter: GainScatter | None
    flags: tuple[DataFlag, ...]
    n_known: int

    @property
    def fit(self) -> LoadFit:
        """Final fit."""
        return self.found.fit

    @property
    def table(self) -> LoadTable:
        """Readings with the torque of the final fit."""
        return self.found.fit.table

    def build(self, settings: Mapping[str, Any]) -> Diagnosis:
        """Return the diagnosis."""
        line, alpha = float(settings["materiality"]), float(settings["alpha"])
        named, places = self._named_causes(), self._places()
        causes = tuple(c for c in named if _counts(c, line))
        unexplained = tuple(u for u in places if u.share_of_variance >= line)
        folds = self.weighing.folds()
        before, after = self.weighing.rms_nm(folds)
        model = extended_by_loads(self.fit, self.given)
        known = [t.cause.name for t in self.fit.terms[: self.n_known]]
        simulated = {"terms": [*_BASELINE, *known], "heldout_rms_nm": before}
        names = [t.name for t in model.causes]
        verdict, reason = self._verdict(causes, unexplained, alpha)
        return Diagnosis(
            verdict,
            causes,
            tuple(c for c in named if c not in causes),
            unexplained,
            tuple(u for u in places if u not in unexplained),
            (*self.flags, *self._outlier_flags()),
            minimum_detectable_load(self.fit, self.found.space, self.found.looks, alpha),
            {**simulated, "as_given_rms_nm": self._as_given_rms()},
            {"terms": [*_BASELINE, *names], "heldout_rms_nm": after},
            model,
            {**settings, **settings_of(self.weighing, self.profile, self.scatter, folds.kind)},
            reason,
            load_pictures=load_pictures(self.weighing.baseline, self.fit),
        )

    def _verdict(
        self, causes: tuple[NamedCause, ...], unexplained: tuple[Unexplained, ...], alpha: float
    ) -> tuple[str, str]:
        """Return the verdict and its sentence: too few readings cannot tell."""
        verdict = _verdict(causes, unexplained)
        needed = least_sigmas(self.found.space, self.found.looks, alpha)
        if verdict != "nothing-found" or needed <= _BLIND_SIGMAS:
            return verdict, reason_of(self.scatter)
        count, dof = int(self.table.used.sum()), self.found.space.dof
        return "cannot-tell", (
            f"{count} readings leave {dof} degrees of freedom beside gain and zeros: too few to "
            "tell an effect from noise"
        )

    def _named_causes(self) -> list[NamedCause]:
        return [
            self._named(accepted)
            for accepted in self.found.accepted
            if not is_outlier(accepted.term)
        ]

    def _places(self) -> list[Unexplained]:
        places = [self._unexplained(left) for left in self.left]
        for accepted in self.found.accepted:
            if is_outlier(accepted.term):
                places.append(self._outlier(accepted))
        if self.scatter is not None and not self.scatter.within_profile:
            places.append(self._scatter_place(self.scatter))
        return places

    def _named(self, accepted: Accepted) -> NamedCause:
        # a loop of several elements has no shape of one: it is told by the best single one
        fit, places = accepted.alone or self.fit, accepted.places
        place = places[0] if accepted.alone is None else len(fit.terms) - 1
        term = load_cause_term(fit, place, self.given)
        table = {
            name: self._entry(entry)
            for name, entry in cause_parameters(term, extra=self.given.extra_causes).items()
            if not _left_out(name, accepted.term)
        }
        group = _names(accepted.group)
        rivals = tuple(n for n in _names(accepted.rivals) if n not in group)
        cause = accepted.term.cause
        return NamedCause(
            cause.name,
            group,
            rivals,
            table,
            accepted.evidence_nats,
            accepted.false_alarm,
            self.weighing.gain(places),
            cause.experiment if len(group) > 1 or rivals else None,
            self.weighing.share(places),
            "time" if cause.locked_to == "time" else "torque",
            probability=accepted.probability,
        )

    def _entry(self, entry: Mapping[str, float | str | None]) -> dict[str, float | str | None]:
        """Return a parameter: no uncertainty where none was found, time in readings if counted."""
        unit = str(entry["unit"])
        if not self.table.time_measured:
            unit = "reading" if unit == "s" else unit
            unit = unit.removesuffix("/s") + "/reading" if unit.endswith("/s") else unit
        return {**entry, "std": entry["std"] or None, "unit": unit}

    def _as_given_rms(self) -> float:
        """Return the RMS of readings by the profile's gain less the given model, N m."""
        table = self.table
        measured = table.reading_v * self.profile.sensor.gain_nm_per_v
        simulated = table.torque_nm + self.given.cause_torque_nm(table.motion)
        return float(np.sqrt(np.mean((measured - simulated)[table.used] ** 2)))

    def _unexplained(self, left: Left) -> Unexplained:
        share = min(1.0, left.variance_nm2 / self.weighing.variance_nm2)
        extent, chance = left.extent, left.false_alarm
        return Unexplained(
            left.domain, left.location, extent, left.unit, left.size_nm, share, chance
        )

    def _outlier(self, accepted: Accepted) -> Unexplained:
        places = accepted.places
        number = float(round(accepted.term.shape["reading"]) + 1)
        size, share = abs(float(self.fit.linear[places[0]][0])), self.weighing.share(places)
        chance = accepted.false_alarm
        return Unexplained("outliers", number, (number, number), "reading", size, share, chance)

    def _scatter_place(self, scatter: GainScatter) -> Unexplained:
        torque = self.table.torque_nm
        top = float(np.abs(torque).max())
        common = fit_loads(self.table, self.weighing.plain, self.fit.terms)
        share = self.weighing.share_of(common.rss - self.fit.rss)
        extent = (float(torque.min()), float(torque.max()))
        size = scatter.relative_std * top
        return Unexplained("torque", top, extent, "N m", size, share, scatter.false_alarm)

    def _outlier_flags(self) -> tuple[DataFlag, ...]:
        time = self.table.motion.time_s
        return tuple(
            DataFlag("outlier", float(time[i]), float(time[i]), 1) for i, _ in outliers_of(self.fit)
        )


def _left_out(name: str, term: Term) -> bool:
    """Return whether a parameter of the catalogue is none of the form that was fitted."""
    whole = catalogue().get(term.cause.name, term.cause)
    fitted = {p.name for p in term.cause.linear}
    missing = {p.name for p in whole.linear} - fitted
    pairs = {n.replace("cosine", "amplitude") for n in missing}
    pairs |= {n.replace("cosine", "phase").replace("_nm", "_rad") for n in missing}
    return name in missing | pairs


def _counts(cause: NamedCause, materiality: float) -> bool:
    return cause.share_of_variance >= materiality and cause.gain.explained_fraction > 0.0


def _names(terms: tuple[Term, ...]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(term.cause.name for term in terms))


def _verdict(causes: tuple[NamedCause, ...], unexplained: tuple[Unexplained, ...]) -> str:
    if causes and unexplained:
        return "named-and-unexplained"
    if causes:
        return "named"
    return "unexplained" if unexplained else "nothing-found"
