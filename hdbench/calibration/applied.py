"""The applied torque of every reading: given as it stands, or made of its mass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from hdbench.calibration.budget import relative_std, with_shares
from hdbench.calibration.lever import (
    STANDARD_GRAVITY,
    AppliedTorque,
    Conditions,
    applied_torque,
    given_sources,
    torque_sources,
)
from hdbench.calibration.readings import TakenReading
from hdbench.profile.schema import ProfileData
from hdbench.results.calibration import AppliedTorqueAccount, BudgetRow, Correction

# a stated torque this close to mass times gravity times length was made of these three: a file with
# ten digits keeps them to 1e-10, one correction that is worth making is larger
_SAME_TORQUE = 1e-9

# source of uncertainty of a correction, where it has another name
_SOURCE = {"certified mass": "mass of the weights", "air buoyancy": "air density"}


@dataclass(frozen=True, slots=True)
class TorqueAccount:
    """Where the applied torques come from and what they are uncertain by.

    Parameters
    ----------
    source : str
        ``masses``, ``given`` or ``mixed``.
    largest : AppliedTorque or None
        The largest load that was made of a mass, with its corrections.
    rows : tuple of BudgetRow
        Relative uncertainties at that load, common to all readings.
    gravity_m_s2, gravity_source : float, str
        Local gravity and where it comes from.
    relative_at : tuple of (float, float)
        Applied torque, N m, and its relative standard uncertainty, for each load made of a mass.
    n_stated : int
        Readings with a mass whose torque is stated and is not mass times gravity times length.
    """

    source: str
    largest: AppliedTorque | None
    rows: tuple[BudgetRow, ...]
    gravity_m_s2: float
    gravity_source: str
    relative_at: tuple[tuple[float, float], ...]
    n_stated: int = 0

    def relative_std_at(self, torque_nm: float) -> float:
        """Return the relative standard uncertainty at the load nearest to a torque."""
        if not self.relative_at:
            return relative_std(self.rows)
        size = abs(torque_nm)
        return min(self.relative_at, key=lambda entry: abs(entry[0] - size))[1]

    def record(self) -> AppliedTorqueAccount:
        """Return the account as results hold it."""
        largest = self.largest
        return AppliedTorqueAccount(
            source=self.source,
            gravity_m_s2=self.gravity_m_s2,
            gravity_source=self.gravity_source,
            gravity_over_standard=self.gravity_m_s2 / STANDARD_GRAVITY - 1.0,
            largest_nm=None if largest is None else largest.torque_nm,
            largest_nominal_nm=None if largest is None else largest.nominal_nm,
            tilt_rad=None if largest is None else largest.tilt_rad,
            corrections=() if largest is None else self._corrections(largest),
            relative_std=relative_std(self.rows),
            budget=with_shares(self.rows),
            not_declared=tuple(row.name for row in self.rows if not row.declared),
        )

    def _corrections(self, largest: AppliedTorque) -> tuple[Correction, ...]:
        """Return every correction with what it adds to the uncertainty of the applied torque."""
        gravity = Correction(
            name="local gravity",
            relative=self.gravity_m_s2 / STANDARD_GRAVITY - 1.0,
            made=True,
            detail=f"{self.gravity_m_s2:.6f} m/s^2 ({self.gravity_source}) "
            f"over {STANDARD_GRAVITY:g}",
        )
        shares = {row.name: row.share for row in with_shares(self.rows) if row.declared}
        return tuple(
            replace(c, uncertainty_share=shares.get(_SOURCE.get(c.name, c.name)))
            for c in (gravity, *largest.corrections)
        )


def apply_torque(
    readings: Sequence[TakenReading], bench: ProfileData
) -> tuple[tuple[TakenReading, ...], TorqueAccount]:
    """Give every reading that was loaded by a mass the torque of that mass.

    Notes
    -----
    A torque that the file states and that is not mass times gravity times length of the arm was
    measured or worked out by somebody: it stays as it is.
    """
    out: list[TakenReading] = []
    made: list[AppliedTorque] = []
    for taken in readings:
        applied = _of_mass(taken, bench)
        if applied is None:
            out.append(taken)
            continue
        made.append(applied)
        sign = 1.0 if taken.reading.direction == "cw" else -1.0
        torque = sign * applied.torque_nm
        out.append(replace(taken, reading=replace(taken.reading, torque_nm=torque)))
    stated = sum(t.reading.mass_kg is not None for t in readings) - len(made)
    return tuple(out), replace(_account(made, len(readings), bench), n_stated=stated)


def _of_mass(taken: TakenReading, bench: ProfileData) -> AppliedTorque | None:
    reading, detail, arm = taken.reading, taken.detail, bench.arm
    if reading.mass_kg is None:
        return None
    lengths = {arm.length_m, detail.arm_length_m or arm.length_m}
    nominal = [reading.mass_kg * arm.gravity_m_s2 * length for length in lengths]
    stated = abs(reading.torque_nm)
    if not any(abs(stated - torque) <= _SAME_TORQUE * torque for torque in nominal):
        return None
    conditions = Conditions(
        reading.temperature_c, detail.pressure_hpa, detail.humidity_percent, detail.arm_length_m
    )
    return applied_torque(reading.mass_kg, arm, bench.standards.mass, conditions)


def _account(made: list[AppliedTorque], n_readings: int, bench: ProfileData) -> TorqueAccount:
    arm = bench.arm
    if not made:
        rows = given_sources(bench.standards.torque)
        return TorqueAccount("given", None, rows, arm.gravity_m_s2, arm.gravity_source, ())
    largest = max(made, key=lambda applied: applied.torque_nm)
    relative = {
        applied.torque_nm: relative_std(torque_sources(applied, arm, bench.standards))
        for applied in made
        if applied.torque_nm > 0.0
    }
    return TorqueAccount(
        "masses" if len(made) == n_readings else "mixed",
        largest,
        torque_sources(largest, arm, bench.standards),
        arm.gravity_m_s2,
        arm.gravity_source,
        tuple(sorted(relative.items())),
    )
