"""Uncertainty of the applied torque, source by source."""

from __future__ import annotations

import math
from typing import Literal

from hdbench.calibration.torque.lever import AppliedTorque
from hdbench.profile.calibrating import Arm, MassStandard, Standards, TorqueStandard
from hdbench.results.calibration import BudgetRow

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
