"""Bench model: baseline terms and causes, and the torque they give on a motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hdbench.errors import DataError
from hdbench.model.cause import catalogue, check_term
from hdbench.model.causes.kinematic import TRANSMISSION_ERROR, angle_error_rad
from hdbench.model.definition import Cause, CauseTerm, amplitude_phase
from hdbench.model.motion import Motion, gauge_order_factor, turns_of
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray

# orders of the contract's baseline where the profile says no others, relative to the gauges:
# report, section 4
_GAUGE_ORDERS = (2.0, 4.0)
# orders closer than this are one: no record of this bench tells them apart
_SAME_ORDER = 1e-6


def baseline_orders(profile: ProfileData) -> tuple[float, ...]:
    """Return the motor orders of the baseline.

    Parameters
    ----------
    profile : ProfileData
        Drive, and the ripple of its model.

    Returns
    -------
    tuple of float
        The profile's `model.baseline_orders` (2 and 4 where it has none) and every further ripple
        order of its model, relative to the gauges, times `gauge_order_factor`; increasing, each
        once.
    """
    orders: list[float] = []
    of_ripple = (component.order for component in profile.model.ripple)
    for wanted in (*(profile.model.baseline_orders or _GAUGE_ORDERS), *of_ripple):
        if all(abs(wanted - order) > _SAME_ORDER for order in orders):
            orders.append(wanted)
    factor = gauge_order_factor(profile.drive)
    return tuple(order * factor for order in sorted(orders))


def expected_torque_nm(motion: Motion, inertia_nm_s2: float) -> FloatArray:
    r"""Return the expected torque."""
    return np.asarray(inertia_nm_s2 * motion.acceleration_rad_s2)


def baseline_columns(
    motion: Motion, profile: ProfileData, *, load: float = 1.0
) -> tuple[FloatArray, tuple[str, ...], FloatArray]:
    """Return the baseline as a fixed torque and columns with free coefficients.

    Parameters
    ----------
    motion : Motion
        Motion of the record.
    profile : ProfileData
        Load inertia, gear ratio, flexspline and ripple orders.
    load : float
        Coefficient of the measured load torque.

    Returns
    -------
    fixed_nm : ndarray, shape (n_samples,)
        Expected torque with the coefficient J_load/N and, where the motion has one, the measured
        load torque, N m; NaN at lost samples.
    names : tuple of str
        ``zero``, ``ripple:<order>:cosine`` and ``ripple:<order>:sine`` for every order of
        `baseline_orders` (the order as the shortest decimal that gives it back), and
        ``misalignment:cosine`` and ``misalignment:sine`` where the output covers a whole turn.
    columns : ndarray, shape (n_samples, n_names)
        N m per unit of each coefficient, so that each coefficient is in N m.
    """
    drive = profile.drive
    fixed = expected_torque_nm(motion, drive.load_inertia_kg_m2 / drive.gear_ratio)
    if motion.load_torque_nm is not None and load != 0.0:
        fixed = fixed + load * motion.load_torque_nm
    names, columns = ["zero"], [np.ones(len(motion))]
    for order in baseline_orders(profile):
        angle = order * motion.angle_rad
        names += [f"ripple:{order!r}:cosine", f"ripple:{order!r}:sine"]
        columns += [np.cos(angle), np.sin(angle)]
    if turns_of(motion.output_angle_rad, motion) >= 1.0:
        names += ["misalignment:cosine", "misalignment:sine"]
        columns += [np.cos(motion.output_angle_rad), np.sin(motion.output_angle_rad)]
    return fixed, tuple(names), np.column_stack(columns)


# angle over which the slope of a ripple is formed: 2e-6 off at order 360, the highest of any cause,
# and as much by the rounding of an angle of 1e4 turns
_ANGLE_STEP_RAD = 1e-5


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
        If the numbers do not fit the cause, the record lacks a channel that it needs, or the
        columns of a user's own cause have another shape.
    """
    cause = check_term(term, extra=extra)
    for channel in cause.channels:
        if getattr(motion, channel) is None:
            raise DataError(
                f"the model's cause {cause.name} needs {channel}, which the record does not have",
                where=f"cause {cause.name!r}",
                fix=f"give a record with a column {channel}, or take the cause out of the model",
            )
    linear = np.asarray(term.linear, dtype=np.float64)
    columns = np.asarray(cause.columns(motion, term.shape))
    if columns.shape != (len(motion), len(linear)):
        raise DataError(
            f"the columns of {cause.name} have shape {columns.shape}; needed: "
            f"{(len(motion), len(linear))}, one column for each linear parameter",
            where=f"cause {cause.name!r}",
            fix="mend the function `columns` of this cause",
        )
    return np.asarray(columns @ linear)


def with_signal(
    motion: Motion,
    torque_nm: Callable[[Motion], FloatArray],
    error_rad: FloatArray | float = 0.0,
) -> Motion:
    """Return the motion with a simulated torque, for causes that act on the whole signal.

    Parameters
    ----------
    motion : Motion
        Motion at every sample.
    torque_nm : callable
        Simulated torque on a motion, N m, shape (n_samples,).
    error_rad : ndarray of shape (n_samples,) or float
        Error of the recorded motor angle, rad.

    Returns
    -------
    Motion
        With `simulated_nm`, its slope over the motor angle at the same output angle, from the true
        angle to the recorded one, and the error.
    """
    way = np.where(np.abs(error_rad) > 2.0 * _ANGLE_STEP_RAD, error_rad, 2.0 * _ANGLE_STEP_RAD)
    middle = motion.angle_rad - 0.5 * error_rad
    ahead, behind = (
        torque_nm(replace(motion, angle_rad=middle + half)) for half in (0.5 * way, -0.5 * way)
    )
    slope = (ahead - behind) / way
    return replace(
        motion,
        simulated_nm=torque_nm(motion),
        ripple_slope_nm_per_rad=slope,
        angle_error_rad=np.broadcast_to(error_rad, motion.angle_rad.shape),
    )


@dataclass(frozen=True, slots=True)
class BenchModel:
    r"""Zero, expected torque, load, ripple, misalignment and causes of a bench.

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
    load : float
        Coefficient of the measured load torque, 1; 0 where the channel does not hold it.

    Notes
    -----
    .. math:: \tau = z + \frac{J}{N} \alpha_m + k \tau_{load}
              + \sum_i A_i \cos(o_i \theta_m + \varphi_i)
              + A_o \cos(\theta_o + \varphi_o) + \sum_j c_j(\text{motion})

    with the load term where the motion has a measured load.
    """

    zero_nm: float
    inertia_nm_s2: float
    ripple: tuple[tuple[float, float, float], ...]
    misalignment: tuple[float, float]
    causes: tuple[CauseTerm, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)
    extra_causes: tuple[Cause, ...] = ()
    load: float = 1.0

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
            Motion at every sample, as it was recorded.

        Returns
        -------
        ndarray, shape (n_samples,)
            Torque, N m; NaN at samples whose motion is not valid.

        Raises
        ------
        DataError
            If a cause does not fit the catalogue, or needs a channel that the record lacks.

        Notes
        -----
        Baseline and causes are computed on the motion that the bench had: causes that are faults of
        angle or clock are undone first (`true_motion`). Causes of the noise add nothing.
        """
        true = self.true_motion(motion)
        torque = self.baseline_torque_nm(true) + self.cause_torque_nm(true)
        return np.where(true.valid, torque, np.nan)

    def true_motion(self, motion: Motion) -> Motion:
        """Return the motion that the bench had when `motion` was recorded.

        Parameters
        ----------
        motion : Motion
            Motion as it was recorded.

        Returns
        -------
        Motion
            Without the faults of angle and clock among the causes; `motion` itself if there is
            none.

        Raises
        ------
        DataError
            If a cause does not fit the catalogue.
        """
        for term in self.causes:
            cause = check_term(term, extra=self.extra_causes)
            if cause.change_motion is not None:
                motion = cause.change_motion(motion, term.shape)
        return motion

    def baseline_torque_nm(self, motion: Motion) -> FloatArray:
        """Return zero, expected torque, load, ripple, misalignment, N m, shape (n_samples,)."""
        torque = self.zero_nm + expected_torque_nm(motion, self.inertia_nm_s2)
        if motion.load_torque_nm is not None and self.load != 0.0:
            torque = torque + self.load * motion.load_torque_nm
        for order, amplitude, phase in self.ripple:
            torque = torque + amplitude * np.cos(order * motion.angle_rad + phase)
        amplitude, phase = self.misalignment
        return np.asarray(torque + amplitude * np.cos(motion.output_angle_rad + phase))

    def cause_torque_nm(self, motion: Motion) -> FloatArray:
        """Return the sum of the causes, N m, shape (n_samples,).

        Parameters
        ----------
        motion : Motion
            Motion at every sample, as the bench had it.

        Returns
        -------
        ndarray, shape (n_samples,)
            N m; NaN where a cause needs what is lost there.

        Raises
        ------
        DataError
            As `torque_nm`.

        Notes
        -----
        What acts on the whole signal (a time skew, a saturation) acts on the sum of the baseline
        and of all causes that do not.
        """
        early, late = self._early_and_late()
        torque = self._summed(early, motion)
        return torque + self._summed(late, self.signal_motion(motion)) if late else torque

    def signal_motion(self, motion: Motion) -> Motion:
        """Return the motion with the signal that causes of the whole signal act on.

        Parameters
        ----------
        motion : Motion
            Motion at every sample, as the bench had it.

        Returns
        -------
        Motion
            With `simulated_nm` and its slope: the baseline and all causes that do not act on the
            whole signal.

        Raises
        ------
        DataError
            As `torque_nm`.
        """
        early, late = self._early_and_late()
        errors = [angle_error_rad(motion, t.linear) for t in late if t.name == TRANSMISSION_ERROR]
        error = sum(errors, np.zeros(len(motion)))
        return with_signal(
            motion, lambda on: self.baseline_torque_nm(on) + self._summed(early, on), error
        )

    def _early_and_late(self) -> tuple[list[CauseTerm], list[CauseTerm]]:
        """Return the causes that are part of the signal, and those that act on all of it."""
        parts: tuple[list[CauseTerm], list[CauseTerm]] = ([], [])
        for term in self.causes:
            parts[check_term(term, extra=self.extra_causes).whole_signal].append(term)
        return parts

    def _summed(self, terms: Iterable[CauseTerm], motion: Motion) -> FloatArray:
        torques = (term_torque_nm(term, motion, extra=self.extra_causes) for term in terms)
        return sum(torques, np.zeros(len(motion)))

    def terms(self) -> tuple[str, ...]:
        """Return the names of the model's terms: baseline, then causes, in order.

        ``load`` is the measured load torque, in records that have one.
        """
        ripple = tuple(f"ripple-{order:g}" for order, _, _ in self.ripple)
        causes = tuple(term.name for term in self.causes)
        load = ("load",) if self.load != 0.0 else ()
        return ("zero", "expected-torque", *load, *ripple, "misalignment", *causes)

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
        check_term(term, extra=self.extra_causes)
        return replace(self, causes=(*self.causes, term))

    def with_extra(self, causes: Sequence[Cause]) -> BenchModel:
        """Return the model that may also name these causes.

        Parameters
        ----------
        causes : sequence of Cause
            Causes of the user's own. One that the model has already, by the same declaration, is
            the same.

        Returns
        -------
        BenchModel

        Raises
        ------
        DataError
            If a name stands for another cause.
        """
        known = {cause.name: cause for cause in self.extra_causes}
        for cause in causes:
            same = known.get(cause.name)
            if same is not None and same.definition == cause.definition is not None:
                continue
            catalogue((*known.values(), cause))
            known[cause.name] = cause
        return replace(self, extra_causes=tuple(known.values()))

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
        misalignment = pairs.pop("misalignment", (0.0, 0.0))
        return replace(
            self,
            zero_nm=values.get("zero", self.zero_nm),
            ripple=tuple((float(stem.rpartition(":")[2]), *pair) for stem, pair in pairs.items()),
            misalignment=misalignment,
        )
