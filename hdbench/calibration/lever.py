"""Torque of weights on an arm: corrections, uncertainties, and the torque of every reading."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from hdbench.calibration.readings import TakenReading
from hdbench.profile.calibrating import Arm, MassStandard, Standards, TorqueStandard
from hdbench.profile.schema import ProfileData
from hdbench.results.calibration import AppliedTorqueAccount, BudgetRow, Correction

# conventional mass: balance in air of 1.2 kg/m^3 with weights of 8000 kg/m^3 (OIML D 28, R 111-1)
CONVENTIONAL_AIR_KG_M3 = 1.2
CONVENTIONAL_MASS_KG_M3 = 8000.0
STANDARD_GRAVITY = 9.80665
# the tilt settles by a factor T / (K L) < 1e-2 in every turn of the loop: 1e-15 after eight
_TURNS = 20


@dataclass(frozen=True, slots=True)
class Conditions:
    """What may differ from reading to reading."""

    # air and arm at the reading; None where not told
    temperature_c: float | None = None
    pressure_hpa: float | None = None
    humidity_percent: float | None = None
    # another arm than the profile's, m
    arm_length_m: float | None = None


def air_density(pressure_hpa: float, humidity_percent: float, temperature_c: float) -> float:
    """Return the density of moist air.

    Notes
    -----
    ``rho = (0.34848 p - 0.009 h exp(0.061 t)) / (273.15 + t)``.

    References
    ----------
    .. [1] OIML R 111-1 (2004), annex E, equation E.3-1.
    """
    if not (
        600.0 <= pressure_hpa <= 1100.0
        and 0.0 <= humidity_percent <= 100.0
        and 0.0 <= temperature_c <= 50.0
    ):
        raise ValueError(
            f"air of {pressure_hpa:g} hPa, {humidity_percent:g} %, {temperature_c:g} deg C; "
            "needed: 600 to 1100 hPa, 0 to 100 %, 0 to 50 deg C"
        )
    vapour = 0.009 * humidity_percent * math.exp(0.061 * temperature_c)
    return (0.34848 * pressure_hpa - vapour) / (273.15 + temperature_c)


def buoyancy_factors(
    air_kg_m3: float, weight_kg_m3: float, *, conventional: bool
) -> tuple[float, float]:
    """Return what turns a stated mass into the mass that presses down in air.

    Notes
    -----
    ``to_true = (1 - rho0/rhoc) / (1 - rho0/rho_m)`` with rho0 = 1.2 kg/m^3, rhoc = 8000 kg/m^3;
    ``in_air = 1 - rho_a / rho_m``.
    """
    stated = 1.0 - CONVENTIONAL_AIR_KG_M3 / CONVENTIONAL_MASS_KG_M3
    own = 1.0 - CONVENTIONAL_AIR_KG_M3 / weight_kg_m3
    return (stated / own if conventional else 1.0), 1.0 - air_kg_m3 / weight_kg_m3


@dataclass(frozen=True, slots=True)
class AppliedTorque:
    """Torque of one load, with every correction."""

    # applied torque, N m, at least 0
    torque_nm: float
    # mass times local gravity times length, N m
    nominal_nm: float
    # downward tilt of the arm under this load, rad
    tilt_rad: float
    # length and hang-point offset used, m
    length_m: float
    offset_m: float
    # in the order in which they were made
    corrections: tuple[Correction, ...]


def applied_torque(
    mass_kg: float, arm: Arm, mass: MassStandard, conditions: Conditions | None = None
) -> AppliedTorque:
    """Return the torque of a mass on the arm.

    Notes
    -----
    ``F = m g (1 - rho0/rhoc) / (1 - rho0/rho_m) (1 - rho_a/rho_m)`` for a conventional mass;
    ``T = F (L_t cos a - e sin a)``, ``L_t = L (1 + alpha (t - t_ref))``,
    ``a = a0 + T/K + a_lost``, solved by fixed-point steps. The arm's own weight is a part of the
    zero. A couple has no tilt that matters: its forces stay at right angles by the pulley.
    """
    if not (math.isfinite(mass_kg) and mass_kg >= 0.0):
        raise ValueError(f"mass {mass_kg!r} kg; needed: a finite number of at least 0 kg")
    around = conditions or Conditions()
    length = around.arm_length_m or arm.length_m
    nominal = mass_kg * arm.gravity_m_s2 * length
    force, forces = _force(mass_kg, arm, mass, around)
    stretched, thermal = _length(length, arm, around)
    flat = force * stretched
    tilt = _tilt(flat, stretched, arm) if mass_kg > 0.0 else arm.tilt_rad or 0.0
    offset = arm.hang_offset_m or 0.0
    torque = force * (stretched * math.cos(tilt) - offset * math.sin(tilt))
    return AppliedTorque(
        torque,
        nominal,
        tilt,
        stretched,
        offset,
        (*forces, thermal, *_geometry(tilt, offset, stretched, arm)),
    )


def _force(
    mass_kg: float, arm: Arm, mass: MassStandard, around: Conditions
) -> tuple[float, tuple[Correction, ...]]:
    loaded = mass_kg + (arm.tare_kg if mass_kg > 0.0 else 0.0)
    tare = loaded / mass_kg - 1.0 if mass_kg > 0.0 else 0.0
    air = _air(arm, around)
    to_true, in_air = buoyancy_factors(
        air or 0.0, mass.density_kg_m3, conventional=mass.mass_kind == "conventional"
    )
    if air is None:
        # a stated mass is conventional: it weighs like its nominal value only with its buoyancy
        to_true = in_air = 1.0
    density = f"weights of {mass.density_kg_m3:g} kg/m^3"
    air_words = "air density not declared" if air is None else f"air of {air:.4f} kg/m^3, {density}"
    corrections = (
        Correction("pan and hook", tare, True, f"{arm.tare_kg:g} kg"),
        Correction(
            "certified mass", mass.relative_correction, True, "certified over nominal mass, less 1"
        ),
        Correction("conventional mass", to_true - 1.0, air is not None, density),
        Correction("air buoyancy", in_air - 1.0, air is not None, air_words),
    )
    factor = (1.0 + mass.relative_correction) * to_true * in_air
    return loaded * arm.gravity_m_s2 * factor, corrections


def _air(arm: Arm, around: Conditions) -> float | None:
    known = (around.pressure_hpa, around.humidity_percent, around.temperature_c)
    if known[0] is not None and known[1] is not None and known[2] is not None:
        return air_density(known[0], known[1], known[2])
    return arm.air_density_kg_m3


def _length(length: float, arm: Arm, around: Conditions) -> tuple[float, Correction]:
    expansion, temperature = arm.thermal_expansion_per_k, around.temperature_c
    if expansion is None or temperature is None:
        missing = "expansion" if expansion is None else "temperature"
        return length, Correction("arm temperature", 0.0, False, f"{missing} not declared")
    relative = expansion * (temperature - arm.reference_temperature_c)
    detail = f"{temperature:.2f} deg C, length stated at {arm.reference_temperature_c:g} deg C"
    return length * (1.0 + relative), Correction("arm temperature", relative, True, detail)


def _tilt(flat_nm: float, length: float, arm: Arm) -> float:
    """Return the tilt under load: where it started, wound up by the torque that it carries."""
    rest = (arm.tilt_rad or 0.0) + arm.lost_motion_rad
    if arm.torsional_stiffness_nm_per_rad is None:
        return rest
    ratio, tilt = (arm.hang_offset_m or 0.0) / length, rest
    for _ in range(_TURNS):
        torque = flat_nm * (math.cos(tilt) - ratio * math.sin(tilt))
        tilt = rest + torque / arm.torsional_stiffness_nm_per_rad
    return tilt


def _geometry(tilt: float, offset: float, length: float, arm: Arm) -> tuple[Correction, Correction]:
    known = arm.tilt_rad is not None or arm.torsional_stiffness_nm_per_rad is not None
    words = f"tilt {math.degrees(tilt):.3f} deg" if known else "tilt not declared"
    below = arm.hang_offset_m
    hung = "offset not declared" if below is None else f"{1e3 * below:g} mm below the axis line"
    level = math.cos(tilt)
    return (
        Correction("arm tilt", level - 1.0, known, words),
        Correction(
            "hang-point offset",
            0.0 - offset * math.sin(tilt) / (length * level),
            known and below is not None,
            f"{hung}, {words}",
        ),
    )


# largest permissible errors from 100 g up, share of the mass: OIML R 111-1 (2004), table 1
_CLASSES = {"E2": 1.6e-6, "F1": 5e-6, "F2": 1.6e-5, "M1": 5e-5, "M2": 1.6e-4, "M3": 5e-4}
# local anomalies of gravity seldom exceed this share of it
_GRAVITY_ANOMALY = 50e-6
# what makes a half width a standard uncertainty; of a certificate the expanded one, k = 2
_DIVISORS = {"rectangular": math.sqrt(3.0), "normal": 2.0, "in full": 1.0}


def _mass_limits(mass: MassStandard) -> float | None:
    """Return the limits of the weights, stated or of their class, share of the mass."""
    if mass.relative_half_width is not None:
        return mass.relative_half_width
    return _CLASSES.get(mass.accuracy_class)


def torque_sources(applied: AppliedTorque, arm: Arm, standards: Standards) -> tuple[BudgetRow, ...]:
    """Return the standard uncertainties of one applied torque, relative to it.

    Notes
    -----
    With ``T = F (L cos a - e sin a)``: ``d ln T / da = -(L sin a + e cos a) / (L cos a - e sin a)``
    and ``d ln T / de = -sin a / (L cos a - e sin a)``. A cant of the arm's plane by c lowers the
    torque by 1 - cos c at most, which is taken in full.
    """
    tilt, length, offset = applied.tilt_rad, applied.length_m, applied.offset_m
    lever = length * math.cos(tilt) - offset * math.sin(tilt)
    by_tilt = (length * math.sin(tilt) + offset * math.cos(tilt)) / lever
    by_offset = abs(math.sin(tilt)) / lever
    density, expansion = standards.mass.density_kg_m3, arm.thermal_expansion_per_k
    air = None if arm.air_density_kg_m3 is None else arm.air_density_half_width_kg_m3
    warmth = None if expansion is None else arm.temperature_half_width_k
    cant = None if arm.cant_half_width_rad is None else 1.0 - math.cos(arm.cant_half_width_rad)
    measured = standards.length
    of_profile = (
        ("air density", air, "kg/m^3", 1.0 / density, "rectangular"),
        ("arm temperature", warmth, "K", expansion or 0.0, "rectangular"),
        ("arm tilt", arm.tilt_half_width_rad, "rad", abs(by_tilt), "rectangular"),
        ("hang-point offset", arm.hang_offset_half_width_m, "m", by_offset, "rectangular"),
        ("cant of the arm", cant, "1", 1.0, "in full"),
    )
    return (
        budget_row("mass of the weights", _mass_limits(standards.mass), standards.mass.certificate),
        budget_row("arm length", measured.half_width_m, measured.certificate, "m", 1.0 / length),
        _gravity(arm),
        *(
            budget_row(
                name, half, "" if half is None else "profile", unit, slope, distribution=kind
            )
            for name, half, unit, slope, kind in of_profile
        ),
    )


def given_sources(standard: TorqueStandard) -> tuple[BudgetRow, ...]:
    """Return the uncertainty of torques that a reference sensor measured."""
    expanded = standard.relative_expanded_uncertainty
    return (budget_row("reference torque", expanded, standard.certificate, distribution="normal"),)


def _gravity(arm: Arm) -> BudgetRow:
    half_width = arm.gravity_half_width_m_s2
    if half_width is None and arm.gravity_source != "given":
        half_width = _GRAVITY_ANOMALY * arm.gravity_m_s2
    slope = 1.0 / arm.gravity_m_s2
    return budget_row("local gravity", half_width, arm.gravity_source, "m/s^2", slope)


def budget_row(
    name: str,
    half_width: float | None,
    origin: str,
    unit: str = "1",
    sensitivity: float = 1.0,
    *,
    group: str = "applied torque",
    distribution: str = "rectangular",
) -> BudgetRow:
    """Return a source by its half width; normal: by its expanded uncertainty, k = 2."""
    divisor = _DIVISORS[distribution]
    return BudgetRow(
        name=name,
        group=group,
        half_width=half_width,
        unit=unit,
        distribution=distribution,
        divisor=divisor,
        sensitivity=sensitivity,
        relative_std=0.0 if half_width is None else half_width / divisor * sensitivity,
        declared=half_width is not None,
        origin=origin,
    )


def relative_std(rows: Sequence[BudgetRow]) -> float:
    """Return the root sum of squares of a budget."""
    return math.sqrt(math.fsum(row.relative_std**2 for row in rows))


def with_shares(rows: Sequence[BudgetRow]) -> tuple[BudgetRow, ...]:
    """Return the rows with the share of each in the variance."""
    total = math.fsum(row.relative_std**2 for row in rows)
    return tuple(
        replace(
            row,
            share=row.relative_std**2 / total if total > 0.0 else 0.0,
            origin=row.origin or "not declared",
        )
        for row in rows
    )


# a stated torque this close to mass times gravity times length was made of these three: a file with
# ten digits keeps them to 1e-10, one correction that is worth making is larger
_SAME_TORQUE = 1e-9

# source of uncertainty of a correction, where it has another name
_SOURCE = {"certified mass": "mass of the weights", "air buoyancy": "air density"}


@dataclass(frozen=True, slots=True)
class TorqueAccount:
    """Where the applied torques come from and what they are uncertain by."""

    # `masses`, `given` or `mixed`
    source: str
    # the largest load that was made of a mass, with its corrections
    largest: AppliedTorque | None
    # relative uncertainties at that load, common to all readings
    rows: tuple[BudgetRow, ...]
    # local gravity and where it comes from
    gravity_m_s2: float
    gravity_source: str
    # applied torque, N m, and its relative standard uncertainty, for each load made of a mass
    relative_at: tuple[tuple[float, float], ...]
    # readings with a mass whose torque is stated and is not mass times gravity times length
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
