"""What was found, put together as the answer of a diagnosis."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hdbench.diagnosis.answer.baselinetold import baseline_told
from hdbench.diagnosis.answer.extend import cause_term, extended_model
from hdbench.diagnosis.answer.pictures import pictures_of
from hdbench.diagnosis.answer.result import Diagnosis, NamedCause, Unexplained
from hdbench.diagnosis.confirm.conditions import left_out_gains
from hdbench.diagnosis.confirm.demoted import spoken_against
from hdbench.diagnosis.confirm.gain import Gain, HeldOut, gain_between
from hdbench.diagnosis.confirm.predicted import held_out_residuals
from hdbench.diagnosis.confirm.share import as_given_rms, mean_square, share_of
from hdbench.diagnosis.detect.limits import minimum_detectable
from hdbench.diagnosis.fit.jointfit import JointFit, fit_jointly
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.measured.preflight import Preflight
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.naming.curveplaces import curve_place, is_curve
from hdbench.diagnosis.naming.nameless import unnamed
from hdbench.diagnosis.naming.walk import WALK, walk_cause, walk_shape
from hdbench.diagnosis.search import Found
from hdbench.diagnosis.state import Accepted
from hdbench.model import BenchModel, CauseTerm, cause_parameters

__all__ = ["Answer"]

_DOMAINS = {
    "motor": "motor-order",
    "output": "output-order",
    "clock": "frequency",
    "velocity": "velocity",
    "acceleration": "acceleration",
    "load": "torque",
    "time": "time",
}


@dataclass(frozen=True, slots=True)
class Answer:
    """Everything from which the answer is put together.

    Parameters
    ----------
    record : Record
        Record.
    given : BenchModel
        Model that was held against it.
    preflight : Preflight
        Flags and masked samples.
    found : Found
        What the search found.
    n_known : int
        Causes that `given` already held; they come first in the fit.
    materiality : float
        Smallest share of the residual variance of a cause that counts, in [0, 1).
    rng : Generator
        For the bootstrap.
    acquired : tuple of NamedCause
        Causes of the acquisition that were named before the search; the same materiality line
        parts them.
    """

    record: Record
    given: BenchModel
    preflight: Preflight
    found: Found
    n_known: int
    materiality: float
    rng: np.random.Generator
    acquired: tuple[NamedCause, ...] = ()

    def build(self, settings: dict[str, object]) -> Diagnosis:
        """Return the diagnosis."""
        record, found = self.record, self.found
        whitener = found.noise.whitener
        baseline = fit_jointly(record, found.fit.terms[: self.n_known], whitener, refine=False)
        variance = mean_square(record, baseline)
        named, places, held_out = self._findings(variance)
        causes = tuple(c for c in named if c.share_of_variance >= self.materiality)
        unexplained = tuple(u for u in places if u.share_of_variance >= self.materiality)
        extended = extended_model(record, self.given, found.fit, whitener)
        if found.walk is not None:
            extended = extended.with_cause(CauseTerm(WALK, walk_shape(found), ()))
        noise = found.noise.model
        return Diagnosis(
            _verdict(causes, unexplained),
            causes,
            tuple(c for c in named if c not in causes),
            unexplained,
            tuple(u for u in places if u not in unexplained),
            self.preflight.flags,
            minimum_detectable(found.last, found.survey, float(str(settings["alpha"]))),
            {
                "terms": list(self.given.terms()),
                "heldout_rms_nm": held_out[1].rms_nm,
                "as_given_rms_nm": as_given_rms(record, self.given),
            },
            {"terms": list(extended.terms()), "heldout_rms_nm": held_out[0].rms_nm},
            extended,
            {
                **settings,
                "noise": noise.to_dict(),
                "slow_noise": None if found.noise.slow is None else found.noise.slow.to_dict(),
                "load_coefficient": record.load,
                "samples_used": int(record.valid.sum()),
                **baseline_told(record, found.fit, named),
            },
            "",
            pictures_of(record, (self.given, extended), found, baseline),
        )

    def _findings(
        self, variance: float
    ) -> tuple[list[NamedCause], list[Unexplained], list[HeldOut]]:
        """Return causes, places without a name, and residuals with and without all causes."""
        found, first = self.found, self.n_known
        count = len(found.accepted)
        left_out = [None, -1, *range(first, first + count)]
        whitener = found.noise.whitener
        walking = found.walk is not None
        held_out = held_out_residuals(self.record, found.fit, whitener, left_out, walking=walking)
        still = (
            held_out_residuals(self.record, found.fit, whitener, left_out[:2])
            if walking
            else held_out
        )
        conditions = left_out_gains(self.record, found.fit, whitener, range(first, first + count))
        named = list(self.acquired)
        places: list[Unexplained] = []
        for index, accepted in enumerate(found.accepted):
            if accepted.form:
                continue
            share = share_of(self.record, found, first + index, variance)
            before = held_out[2 + index]
            if unnamed(found.fit.terms[first + index]):
                places.append(self._unnamed(first + index, accepted, share))
            elif before.chi2 > held_out[0].chi2:
                gain = gain_between(before, held_out[0], self.record, self.rng)
                cause = self._named(first + index, accepted, share, gain)
                cause = replace(cause, left_out=conditions[index])
                against = spoken_against(cause)
                named += [] if against else [cause]
                places += [] if against is None else [against]
        if found.walk is not None:
            gain = gain_between(still[0], held_out[0], self.record, self.rng)
            named.append(walk_cause(found, found.walk, variance, gain))
        places += [
            Unexplained(
                left.domain,
                left.location,
                left.extent,
                left.unit,
                left.size_nm,
                min(1.0, left.variance_nm2 / variance),
                left.p_value,
            )
            for left in found.left
        ]
        return named, places, [held_out[0], still[1]]

    def _named(self, place: int, accepted: Accepted, share: float, gain: Gain) -> NamedCause:
        term = self.found.fit.terms[place]
        fit, where = self._alone(place)
        parameters = dict(cause_parameters(cause_term(fit, where), extra=self.given.extra_causes))
        for other in accepted.group[1:]:
            for name, value in other.shape.items():
                unit = next(p.unit for p in other.cause.shape if p.name == name)
                std = self._alternative_std(term, name)
                parameters.setdefault(name, {"value": value, "std": std, "unit": unit})
        group = _names(accepted.group)
        rivals = tuple(n for n in _names(accepted.rivals) if n not in group)
        several = len(group) > 1 or bool(rivals)
        return NamedCause(
            term.cause.name,
            group,
            rivals,
            parameters,
            accepted.evidence_nats,
            accepted.false_alarm,
            gain,
            term.cause.experiment if several else None,
            share,
            _DOMAINS.get(term.cause.locked_to, term.cause.locked_to),
            probability=accepted.probability,
        )

    def _alone(self, place: int) -> tuple[JointFit, int]:
        """Return a fit in which a term has one shape, and its place in it."""
        fit = self.found.fit
        name = fit.terms[place].cause.name
        kept = [
            k for k, term in enumerate(fit.terms) if not (term.form and term.cause.name == name)
        ]
        if len(kept) == len(fit.terms):
            return fit, place
        terms = tuple(fit.terms[k] for k in kept)
        return fit_jointly(self.record, terms, self.found.noise.whitener), kept.index(place)

    def _alternative_std(self, term: Term, name: str) -> float | None:
        """Return the uncertainty of a place carried from the other axis by the mean speed."""
        place = self.found.fit.terms.index(term)
        covariance = self.found.fit.covariances[place]
        if len(term.shape) != 1 or name in term.shape:
            return None
        (value,) = term.shape.values()
        relative = float(np.sqrt(float(covariance[-1, -1]))) / abs(value)
        other = {"order": "frequency_hz", "frequency_hz": "order"}.get(next(iter(term.shape)))
        if other != name:
            return None
        turns = float(np.abs(np.diff(self.record.motion.angle_rad[self.record.valid])).sum())
        ratio = turns / (2.0 * np.pi * float(np.ptp(self.record.motion.time_s)))
        scaled = value * ratio if name == "frequency_hz" else value / ratio
        return float(relative * scaled)

    def _unnamed(self, place: int, accepted: Accepted, share: float) -> Unexplained:
        fit = self.found.fit
        if is_curve(fit.terms[place]):
            curve = curve_place(self.record, fit, place)
            size, chance = curve.size_nm, accepted.false_alarm
            return Unexplained(
                curve.domain, curve.location, curve.extent, curve.unit, size, share, chance
            )
        term, covariance = fit.terms[place], fit.covariances[place]
        (key, value), std = next(iter(term.shape.items())), float(np.sqrt(covariance[-1, -1]))
        return Unexplained(
            "frequency" if key == "frequency_hz" else "output-order",
            value,
            (value - 1.96 * std, value + 1.96 * std),
            term.cause.shape[0].unit,
            float(np.hypot(*fit.linear[place])),
            share,
            accepted.false_alarm,
        )


def _names(terms: tuple[Term, ...]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(term.cause.name for term in terms))


def _verdict(causes: tuple[NamedCause, ...], unexplained: tuple[Unexplained, ...]) -> str:
    if causes and unexplained:
        return "named-and-unexplained"
    if causes:
        return "named"
    return "unexplained" if unexplained else "nothing-found"
