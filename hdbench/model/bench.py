"""The bench model: baseline terms and causes, and the torque they give on a motion."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hdbench.errors import DataError
from hdbench.model.baseline import expected_torque_nm
from hdbench.model.cause import Cause, CauseTerm, check_term
from hdbench.model.gauges import gauge_order_factor
from hdbench.model.harmonics import amplitude_phase
from hdbench.model.motion import Motion
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray

__all__ = ["BenchModel", "term_torque_nm"]


@dataclass(frozen=True, slots=True)
class BenchModel:
    r"""What `simulate` computes.

    Parameters
    ----------
    zero_nm : float
        Zero offset, N m.
    inertia_nm_s2 : float
        :math:`J_{load}/N`, N m per rad/s^2 of the motor.
    ripple : tuple of (float, float, float)
        (order, amplitude in N m, phase in rad) of each ripple component; orders per motor turn.
    misalignment : tuple of float
        Amplitude in N m and phase in rad of the torque once per output turn.
    causes : tuple of CauseTerm
        Causes that were found, with their numbers.
    provenance : mapping
        Where the numbers came from.
    extra_causes : tuple of Cause
        Causes beside the catalogue that `causes` may name.

    Notes
    -----
    .. math:: \tau = z + \frac{J}{N} \alpha_m + \sum_i A_i \cos(o_i \theta_m + \varphi_i)
              + A_o \cos(\theta_o + \varphi_o) + \sum_j c_j(\text{motion})
    """

    zero_nm: float
    inertia_nm_s2: float
    ripple: tuple[tuple[float, float, float], ...]
    misalignment: tuple[float, float]
    causes: tuple[CauseTerm, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)
    extra_causes: tuple[Cause, ...] = ()

    @classmethod
    def from_profile(cls, data: ProfileData) -> BenchModel:
        """Return exactly the model that a profile describes.

        Parameters
        ----------
        data : ProfileData
            Profile. Its ripple orders are relative to the gauges; on a turning flexspline they
            become motor orders times (1 + 1/N).

        Returns
        -------
        BenchModel
            Without causes.
        """
        factor = gauge_order_factor(data.drive)
        ripple = tuple((r.order * factor, r.amplitude_nm, r.phase_rad) for r in data.model.ripple)
        return cls(
            data.model.zero_nm,
            data.drive.load_inertia_kg_m2 / data.drive.gear_ratio,
            ripple,
            (data.model.misalignment.amplitude_nm, data.model.misalignment.phase_rad),
            (),
            {"baseline": f"profile {data.name}"},
        )

    def torque_nm(self, motion: Motion) -> FloatArray:
        """Return the simulated torque.

        Parameters
        ----------
        motion : Motion
            Motion at every sample.

        Returns
        -------
        ndarray, shape (n_samples,)
            Torque, N m; NaN at samples whose motion is not valid.

        Raises
        ------
        DataError
            If a cause does not fit the catalogue, or needs a channel that the record lacks.
        """
        torque = self.baseline_torque_nm(motion) + self.cause_torque_nm(motion)
        return np.where(motion.valid, torque, np.nan)

    def baseline_torque_nm(self, motion: Motion) -> FloatArray:
        """Return zero, expected torque, ripple and misalignment, N m, shape (n_samples,)."""
        torque = self.zero_nm + expected_torque_nm(motion, self.inertia_nm_s2)
        for order, amplitude, phase in self.ripple:
            torque = torque + amplitude * np.cos(order * motion.angle_rad + phase)
        amplitude, phase = self.misalignment
        return np.asarray(torque + amplitude * np.cos(motion.output_angle_rad + phase))

    def cause_torque_nm(self, motion: Motion) -> FloatArray:
        """Return the sum of the causes, N m, shape (n_samples,).

        Parameters
        ----------
        motion : Motion
            Motion at every sample.

        Returns
        -------
        ndarray, shape (n_samples,)
            N m; NaN where a cause needs what is lost there.

        Raises
        ------
        DataError
            As `torque_nm`.
        """
        torque = np.zeros(len(motion))
        for term in self.causes:
            torque += term_torque_nm(term, motion, extra=self.extra_causes)
        return torque

    def terms(self) -> tuple[str, ...]:
        """Return the names of the model's terms: baseline, then causes, in order."""
        ripple = tuple(f"ripple-{order:g}" for order, _, _ in self.ripple)
        causes = tuple(term.name for term in self.causes)
        return ("zero", "expected-torque", *ripple, "misalignment", *causes)

    def with_cause(self, term: CauseTerm) -> BenchModel:
        """Return the model extended by one cause.

        Parameters
        ----------
        term : CauseTerm
            The cause with its numbers.

        Returns
        -------
        BenchModel

        Raises
        ------
        DataError
            If the numbers do not fit the cause.
        """
        check_term(term, where=f"cause {term.name!r}", extra=self.extra_causes)
        return replace(self, causes=(*self.causes, term))

    def with_baseline(self, names: Sequence[str], coefficients: Sequence[float]) -> BenchModel:
        """Return the model with a fitted baseline.

        Parameters
        ----------
        names : sequence of str
            Names as `baseline_columns` gives them.
        coefficients : sequence of float
            Fitted coefficient of each column, N m.

        Returns
        -------
        BenchModel
            Zero, ripple and misalignment by the fit. A misalignment that was not fitted is zero:
            the fitted zero holds what there was of it.

        Raises
        ------
        ValueError
            If the lengths differ, a name is unknown or a coefficient is not finite.
        """
        values = dict(zip(names, (float(c) for c in coefficients), strict=True))
        if not all(math.isfinite(value) for value in values.values()):
            raise ValueError(f"baseline coefficients must be finite, got {values}")
        pairs: dict[str, tuple[float, float]] = {}
        for name in values:
            stem, _, part = name.rpartition(":")
            if part == "cosine":
                pairs[stem] = amplitude_phase(values[name], values[f"{stem}:sine"])[:2]
            elif part not in ("sine", "zero"):
                raise ValueError(f"unknown baseline term {name!r}")
        ripple = tuple(
            (float(stem.removeprefix("ripple:")), *pair)
            for stem, pair in pairs.items()
            if stem.startswith("ripple:")
        )
        return replace(
            self,
            zero_nm=values.get("zero", self.zero_nm),
            ripple=ripple,
            misalignment=pairs.get("misalignment", (0.0, 0.0)),
        )


def term_torque_nm(term: CauseTerm, motion: Motion, *, extra: Sequence[Cause] = ()) -> FloatArray:
    """Return the torque of one cause.

    Parameters
    ----------
    term : CauseTerm
        A cause with numbers.
    motion : Motion
        Motion at every sample.
    extra : sequence of Cause
        Causes beside the catalogue.

    Returns
    -------
    ndarray, shape (n_samples,)
        N m.

    Raises
    ------
    DataError
        If the numbers do not fit the cause, or the record lacks a channel that it needs.
    """
    cause = check_term(term, where=f"cause {term.name!r}", extra=extra)
    for channel in cause.channels:
        if getattr(motion, channel) is None:
            raise DataError(
                f"the model's cause {cause.name} needs {channel}, which the record does not have",
                where=f"cause {cause.name!r}",
                fix=f"give a record with a column {channel}, or take the cause out of the model",
            )
    return np.asarray(cause.columns(motion, term.shape) @ np.asarray(term.linear))
