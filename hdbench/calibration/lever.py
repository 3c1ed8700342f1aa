"""Torque of weights on an arm: air, force, length, tilt, hanging point, and their limits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from hdbench.profile.calibrating import Arm, MassStandard, Standards, TorqueStandard
from hdbench.results.calibration import BudgetRow, Correction

# conventional mass: balance in air of 1.2 kg/m^3 with weights of 8000 kg/m^3 (OIML D 28, R 111-1)
CONVENTIONAL_AIR_KG_M3 = 1.2
CONVENTIONAL_MASS_KG_M3 = 8000.0
STANDARD_GRAVITY = 9.80665
# the tilt settles by a factor T / (K L) < 1e-2 in every turn of the loop: 1e-15 after eight
_TURNS = 20


@dataclass(frozen=True, slots=True)
class Conditions:
    """What may differ from reading to reading.

    Parameters
    ----------
    temperature_c, pressure_hpa, humidity_percent : float or None
        Air and arm at the reading; None where not told.
    arm_length_m : float or None
        Another arm than the profile's, m.
    """

    temperature_c: float | None = None
    pressure_hpa: float | None = None
    humidity_percent: float | None = None
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
    """Torque of one load, with every correction.

    Parameters
    ----------
    torque_nm : float
        Applied torque, N m, at least 0.
    nominal_nm : float
        Mass times local gravity times length, N m.
    tilt_rad : float
        Downward tilt of the arm under this load, rad.
    length_m, offset_m : float
        Length and hang-point offset used, m.
    corrections : tuple of Correction
        In the order in which they were made.
    """

    torque_nm: float
    nominal_nm: float
    tilt_rad: float
    length_m: float
    offset_m: float
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
        _correction("pan and hook", tare, True, f"{arm.tare_kg:g} kg"),
        _correction(
            "certified mass", mass.relative_correction, True, "certified over nominal mass, less 1"
        ),
        _correction("conventional mass", to_true - 1.0, air is not None, density),
        _correction("air buoyancy", in_air - 1.0, air is not None, air_words),
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
        return length, _correction("arm temperature", 0.0, False, f"{missing} not declared")
    relative = expansion * (temperature - arm.reference_temperature_c)
    detail = f"{temperature:.2f} deg C, length stated at {arm.reference_temperature_c:g} deg C"
    return length * (1.0 + relative), _correction("arm temperature", relative, True, detail)


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
        _correction("arm tilt", level - 1.0, known, words),
        _correction(
            "hang-point offset",
            0.0 - offset * math.sin(tilt) / (length * level),
            known and below is not None,
            f"{hung}, {words}",
        ),
    )


def _correction(name: str, relative: float, made: bool, detail: str) -> Correction:
    return Correction(name=name, relative=relative, made=made, detail=detail)


# largest permissible errors from 100 g up, share of the mass: OIML R 111-1 (2004), table 1
_CLASSES = {"E2": 1.6e-6, "F1": 5e-6, "F2": 1.6e-5, "M1": 5e-5, "M2": 1.6e-4, "M3": 5e-4}
# local anomalies of gravity seldom exceed this share of it
_GRAVITY_ANOMALY = 50e-6
_Distribution = Literal["rectangular", "in full"]


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
    density, limits = standards.mass.density_kg_m3, _mass_limits(standards.mass)
    air = None if arm.air_density_kg_m3 is None else arm.air_density_half_width_kg_m3
    expansion = arm.thermal_expansion_per_k
    cant = None if arm.cant_half_width_rad is None else 1.0 - math.cos(arm.cant_half_width_rad)
    return (
        _row("mass of the weights", limits, "1", 1.0, standards.mass.certificate),
        _row(
            "arm length",
            standards.length.half_width_m,
            "m",
            1.0 / length,
            standards.length.certificate,
        ),
        _gravity(arm),
        _row("air density", air, "kg/m^3", 1.0 / density, _told(air)),
        _row(
            "arm temperature",
            None if expansion is None else arm.temperature_half_width_k,
            "K",
            expansion or 0.0,
            _told(arm.temperature_half_width_k),
        ),
        _row(
            "arm tilt", arm.tilt_half_width_rad, "rad", abs(by_tilt), _told(arm.tilt_half_width_rad)
        ),
        _row(
            "hang-point offset",
            arm.hang_offset_half_width_m,
            "m",
            abs(math.sin(tilt)) / lever,
            _told(arm.hang_offset_half_width_m),
        ),
        _row("cant of the arm", cant, "1", 1.0, _told(cant), distribution="in full"),
    )


def given_sources(standard: TorqueStandard) -> tuple[BudgetRow, ...]:
    """Return the uncertainty of torques that a reference sensor measured."""
    expanded = standard.relative_expanded_uncertainty
    return (certified_row("reference torque", "applied torque", expanded, standard.certificate),)


def certified_row(name: str, group: str, expanded: float | None, origin: str) -> BudgetRow:
    """Return the row of a certificate that states a relative expanded uncertainty, k = 2."""
    return BudgetRow(
        name=name,
        group=group,
        half_width=expanded,
        distribution="normal",
        divisor=2.0,
        relative_std=0.0 if expanded is None else expanded / 2.0,
        declared=expanded is not None,
        origin=origin,
    )


def _told(half_width: float | None) -> str:
    """Return the origin of what no certificate states."""
    return "" if half_width is None else "profile"


def _gravity(arm: Arm) -> BudgetRow:
    half_width = arm.gravity_half_width_m_s2
    if half_width is None and arm.gravity_source != "given":
        half_width = _GRAVITY_ANOMALY * arm.gravity_m_s2
    return _row("local gravity", half_width, "m/s^2", 1.0 / arm.gravity_m_s2, arm.gravity_source)


def _row(
    name: str,
    half_width: float | None,
    unit: str,
    sensitivity: float,
    origin: str = "",
    *,
    distribution: _Distribution = "rectangular",
) -> BudgetRow:
    divisor = 1.0 if distribution == "in full" else math.sqrt(3.0)
    return BudgetRow(
        name=name,
        group="applied torque",
        half_width=half_width,
        unit=unit,
        distribution=distribution,
        divisor=divisor,
        sensitivity=sensitivity,
        relative_std=0.0 if half_width is None else half_width / divisor * sensitivity,
        declared=half_width is not None,
        origin=origin,
    )
