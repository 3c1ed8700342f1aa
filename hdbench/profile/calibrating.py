"""Tables of a calibration: arm, gravity, standards, plan, limits."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import (
    Field,
    PositiveFloat,
    PositiveInt,
    field_validator,
    model_validator,
)

from hdbench.profile.tables import Conflict, NonNegative, Positive, Table, refuse

GravityFormula = Literal["wgs84", "welmec"]

# WGS 84 defining and derived constants, NIMA TR8350.2 (2000), tables 3.1, 3.3 and 3.4
_EQUATOR_M_S2 = 9.7803253359
_SOMIGLIANA = 0.00193185265241
_ECCENTRICITY_SQUARED = 0.00669437999014
_SEMI_MAJOR_M = 6378137.0
_FLATTENING = 1.0 / 298.257223563
_CENTRIFUGAL = 0.00344978650684


def gravity_welmec(latitude_deg: float, altitude_m: float) -> float:
    """Return local gravity by the formula of European legal metrology.

    Notes
    -----
    ``g = 9.780318 (1 + 0.0053024 sin^2 f - 0.0000058 sin^2 2f) - 0.000003085 h``.

    References
    ----------
    .. [1] WELMEC, gravity zones, as printed in the documentation of the package AHRS,
       ahrs.readthedocs.io, function `welmec_gravity`.
    """
    phi = math.radians(latitude_deg)
    normal = 1.0 + 0.0053024 * math.sin(phi) ** 2 - 0.0000058 * math.sin(2.0 * phi) ** 2
    return 9.780318 * normal - 0.000003085 * altitude_m


def gravity_wgs84(latitude_deg: float, altitude_m: float) -> float:
    """Return normal gravity of the WGS 84 ellipsoid (Somigliana), at height.

    Notes
    -----
    ``g0 = g_e (1 + k sin^2 f) / sqrt(1 - e^2 sin^2 f)`` and
    ``g = g0 (1 - (2/a)(1 + fl + m - 2 fl sin^2 f) h + 3 h^2/a^2)``.

    References
    ----------
    .. [1] Department of Defense World Geodetic System 1984, NIMA TR8350.2, third edition, 2000,
       equations 4-1 and 4-3.
    """
    sine = math.sin(math.radians(latitude_deg)) ** 2
    surface = (
        _EQUATOR_M_S2 * (1.0 + _SOMIGLIANA * sine) / math.sqrt(1.0 - _ECCENTRICITY_SQUARED * sine)
    )
    slope = 2.0 / _SEMI_MAJOR_M * (1.0 + _FLATTENING + _CENTRIFUGAL - 2.0 * _FLATTENING * sine)
    return surface * (1.0 - slope * altitude_m + 3.0 * (altitude_m / _SEMI_MAJOR_M) ** 2)


def local_gravity(latitude_deg: float, altitude_m: float, formula: GravityFormula) -> float:
    """Return local gravity by the formula of that name."""
    chosen = gravity_wgs84 if formula == "wgs84" else gravity_welmec
    return chosen(latitude_deg, altitude_m)


_Share = Annotated[float, Field(ge=0.0, lt=1.0)]
_Text = Annotated[str, Field(max_length=200)]
_Angle = Annotated[float, Field(ge=-0.5, le=0.5)]
# plain number of a place that is not stated: refused by the rules between keys
_NOWHERE = math.nan


class MassStandard(Table):
    """Weights: what their certificate states. Blank: not declared."""

    certificate: _Text = Field(default="", description="number of the certificate")
    accuracy_class: Literal["", "E2", "F1", "F2", "M1", "M2", "M3"] = Field(
        default="", description="class of OIML R111; its limits serve where none are given"
    )
    relative_half_width: _Share | None = Field(
        default=None, description="limits +- of a mass, share of the mass"
    )
    relative_correction: float = Field(
        default=0.0, gt=-0.1, lt=0.1, description="conventional mass over nominal mass, less 1"
    )
    density_kg_m3: float = Field(
        default=7850.0, ge=1000.0, le=22000.0, description="density of the weights, kg/m^3"
    )
    mass_kind: Literal["conventional", "true"] = Field(
        default="conventional", description="which mass the certificate states"
    )


class LengthStandard(Table):
    """How the arm's length was measured. Blank: not declared."""

    certificate: _Text = Field(default="", description="number of the certificate")
    half_width_m: NonNegative | None = Field(
        default=None, description="limits +- of the arm's length, m"
    )


class TorqueStandard(Table):
    """Reference sensor, where torques are given and not made of weights. Blank: not declared."""

    certificate: _Text = Field(default="", description="number of the certificate")
    identity: _Text = Field(default="", description="maker, type, serial number")
    relative_expanded_uncertainty: _Share | None = Field(
        default=None, description="U (k = 2) of an applied torque, share of the torque"
    )


class InstrumentStandard(Table):
    """Voltmeter or DAQ that read the bridge. Blank: not declared."""

    certificate: _Text = Field(default="", description="number of the certificate")
    identity: _Text = Field(default="", description="maker, type, serial number")
    relative_expanded_uncertainty: _Share | None = Field(
        default=None, description="U (k = 2) of a reading, share of the reading"
    )
    resolution_v: Positive | None = Field(
        default=None, description="smallest step, V; else from daq range and bits"
    )


class Standards(Table):
    """What the calibration is traceable to, as the operator declares it."""

    mass: MassStandard = MassStandard()
    length: LengthStandard = LengthStandard()
    torque: TorqueStandard = TorqueStandard()
    instrument: InstrumentStandard = InstrumentStandard()


class Identity(Table):
    """Who calibrates what, and where. Blank: not declared."""

    laboratory: _Text = Field(default="", description="who calibrates, with address")
    place: _Text = Field(default="", description="where the calibration is made")
    customer: _Text = Field(default="", description="for whom")
    operator: _Text = Field(default="", description="who hangs the weights")
    drive_serial: _Text = Field(default="", description="type and serial number of the drive")
    flexspline_serial: _Text = Field(default="", description="serial number of the flexspline")
    bridge_ohm: Positive | None = Field(default=None, description="resistance of the bridge, ohm")
    cable: _Text = Field(default="", description="cable and wiring, such as 6-wire, 3 m")
    amplifier_serial: _Text = Field(default="", description="type and serial of the amplifier")


def _gravity_there(data: dict[str, Any]) -> float:
    """Return gravity by latitude and height; NaN where they are not stated."""
    latitude, altitude = data.get("latitude_deg"), data.get("altitude_m")
    if latitude is None or altitude is None:
        return _NOWHERE
    return local_gravity(latitude, altitude, data.get("gravity_formula", "wgs84"))


class Arm(Table):
    """Arm and weights of the calibration."""

    length_m: PositiveFloat = Field(description="axis to hanging point, m")
    latitude_deg: float | None = Field(
        default=None,
        ge=-90.0,
        le=90.0,
        description="latitude, deg; for gravity where none is given",
    )
    altitude_m: float | None = Field(
        default=None, ge=-500.0, le=9000.0, description="height, m; for gravity where none is given"
    )
    gravity_formula: GravityFormula = Field(
        default="wgs84", description="formula for gravity from latitude and height"
    )
    gravity_m_s2: float = Field(
        ge=9.7,
        le=9.9,
        default_factory=_gravity_there,
        description="local gravity, m/s^2; else latitude_deg and altitude_m are needed",
    )
    gravity_half_width_m_s2: NonNegative | None = Field(
        default=None,
        description="limits +- of a given gravity, m/s^2; from latitude and height it is 50 ppm",
    )
    thermal_expansion_per_k: float | None = Field(
        default=None, ge=0.0, le=1e-4, description="expansion of the arm's length, 1/K"
    )
    reference_temperature_c: float = Field(
        default=20.0, ge=-20.0, le=60.0, description="temperature at which length_m holds, deg C"
    )
    temperature_half_width_k: NonNegative | None = Field(
        default=None, description="limits +- of the arm's temperature, K"
    )
    tilt_rad: _Angle | None = Field(
        default=None, description="downward tilt of the arm without weights, rad"
    )
    tilt_half_width_rad: NonNegative | None = Field(
        default=None, description="limits +- of the tilt, rad"
    )
    torsional_stiffness_nm_per_rad: Positive | None = Field(
        default=None, description="stiffness between arm and ground, N m/rad; the arm sinks by it"
    )
    lost_motion_rad: NonNegative = Field(
        default=0.0, le=0.1, description="soft wind-up of the gear at first load, rad"
    )
    hang_offset_m: float | None = Field(
        default=None,
        ge=-1.0,
        le=1.0,
        description="hanging point below the line through the axis, m",
    )
    hang_offset_half_width_m: NonNegative | None = Field(
        default=None, description="limits +- of the hanging point's offset, m"
    )
    cant_half_width_rad: NonNegative | None = Field(
        default=None, le=0.2, description="the arm's plane off the vertical by at most this, rad"
    )
    tare_kg: NonNegative = Field(
        default=0.0, description="pan and hook that come on with the first weight, kg"
    )
    side_force_distance_m: Positive | None = Field(
        default=None, description="plane of the arm to plane of the gauges, m"
    )
    air_density_kg_m3: float | None = Field(
        default=None, ge=0.0, le=2.0, description="air density, kg/m^3; 1.20 is usual"
    )
    air_density_half_width_kg_m3: NonNegative = Field(
        default=0.10, description="limits +- of the air density, kg/m^3"
    )
    loading: Literal["single", "couple"] = Field(
        default="single", description="one weight on one arm, or a couple without side force"
    )

    @model_validator(mode="after")
    def _placed(self) -> Arm:
        if math.isnan(self.gravity_m_s2):
            needed = "local gravity in m/s^2, or latitude_deg and altitude_m"
            refuse(
                [
                    Conflict(
                        ("gravity_m_s2",),
                        f"is missing; needed: {needed}",
                        "give gravity_m_s2, or where the bench stands",
                    )
                ]
            )
        return self

    @property
    def gravity_source(self) -> Literal["given", "wgs84", "welmec"]:
        """Where the local gravity comes from."""
        return "given" if "gravity_m_s2" in self.model_fields_set else self.gravity_formula


class StepSequence(Table):
    """Sequence of the preset ``cg14``, in the manner of EURAMET cg-14."""

    positions: PositiveInt = Field(
        default=3, ge=1, le=64, description="positions, equally spaced over a turn"
    )
    masses_kg: tuple[NonNegative, ...] = Field(
        default=(),
        description="weights, kg; empty: 0, 20, 40, 60, 80, 100 % of the largest full one",
    )
    repeat_series: int = Field(
        default=1,
        ge=0,
        le=10,
        description="further up and down at the first position, not remounted",
    )
    preloads_first: int = Field(
        default=3, ge=0, le=10, description="loadings to the largest weight before the first series"
    )
    preloads_remounted: int = Field(
        default=1, ge=0, le=10, description="the same after each new position or direction"
    )
    preload_s: NonNegative = Field(default=30.0, description="time under each preload, s")
    read_after_s: NonNegative = Field(
        default=30.0, description="earliest reading after a change of load, s"
    )


class AcceptanceLimits(Table):
    """Limits of `accepted` beside the consistency; a limit that is absent is not tested."""

    decision_rule: Literal["simple", "guarded"] = Field(
        default="simple",
        description="simple: the value is within its limit; guarded: so is the upper end of "
        "its 95 % interval, where it has one",
    )
    max_expanded_uncertainty: Positive | None = Field(
        default=None, description="expanded uncertainty of the mean gain, 95 %, share of the gain"
    )
    max_class: Positive | None = Field(
        default=None, description="worst indicative class, such as 2"
    )
    max_zero_return: Positive | None = Field(
        default=None, description="zero before less after a series, share of largest"
    )
    max_hysteresis: Positive | None = Field(
        default=None, description="down less up at one torque, share of largest"
    )
    max_lack_of_fit: Positive | None = Field(
        default=None, description="deviation from the line, share of largest"
    )
    max_direction_asymmetry: Positive | None = Field(
        default=None, description="gain cw less ccw, share of their mean"
    )


class ShuntCheck(Table):
    """Resistor across one arm of the bridge: checks amplifier, excitation and wiring."""

    resistor_ohm: PositiveFloat = Field(description="shunt resistor, ohm")
    bridge_ohm: PositiveFloat = Field(default=350.0, description="resistance of each arm, ohm")
    expected_v: float | None = Field(
        default=None, description="reading with less without shunt at the last calibration, V"
    )
    tolerance: Positive = Field(
        default=0.001, lt=1.0, description="accepted change of the shunt reading, share of it"
    )


class CalibrationPlan(Table):
    """Which loads, where, and when a reading counts as settled."""

    preset: Literal["report", "cg14"] = Field(
        default="report",
        description="report: the report's experiments; cg14: in the manner of EURAMET cg-14",
    )
    positions: PositiveInt = Field(
        ge=1, le=64, description="flexspline positions, equally spaced over a turn"
    )
    directions: tuple[Literal["cw", "ccw"], ...] = Field(
        min_length=1, description="loading directions"
    )
    ranges: tuple[Literal["low", "full"], ...] = Field(min_length=1, description="load ranges")
    full_masses_kg: tuple[NonNegative, ...] = Field(
        min_length=3, description="masses of the full range, kg"
    )
    low_masses_kg: tuple[NonNegative, ...] = Field(
        min_length=3, description="masses of the low range, kg"
    )
    sample_period_s: PositiveFloat = Field(
        default=0.01, ge=1e-3, le=1.0, description="sampling period of readings, s"
    )
    average_s: PositiveFloat = Field(default=1.0, description="time averaged for a reading, s")
    settle_timeout_s: PositiveFloat = Field(
        default=30.0, description="longest wait for a reading to settle, s"
    )
    settle_band_nm: PositiveFloat = Field(
        default=0.02, description="two adjacent windows must agree within this (plus noise), N m"
    )
    max_consistency: PositiveFloat = Field(
        default=0.05, description="accepted when consistency is at most this"
    )
    max_lock_motion_rad: PositiveFloat = Field(
        default=0.02, description="motor angle change that means the lock slipped, rad"
    )
    gross_error_fraction: Positive = Field(
        default=0.3,
        lt=0.5,
        description="a reading off the expected torque by more than this share of the smallest "
        "load step is asked about",
    )
    validity_days: Positive = Field(
        default=365.0, description="age from which a run refuses this calibration, days"
    )
    cg14: StepSequence = Field(default=StepSequence(), description="sequence of the preset cg14")
    limits: AcceptanceLimits = Field(
        default=AcceptanceLimits(), description="further limits of acceptance"
    )
    shunt: ShuntCheck | None = Field(default=None, description="shunt check, if the bridge has one")

    @field_validator("directions", "ranges")
    @classmethod
    def _each_once(cls, words: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(words)) != len(words):
            what = f"names one entry twice: {', '.join(words)}"
            refuse([Conflict((), what, "name each once")])
        return words

    @field_validator("full_masses_kg", "low_masses_kg")
    @classmethod
    def _enough_for_a_line(cls, masses: tuple[float, ...]) -> tuple[float, ...]:
        if len(set(masses)) < 3:
            what = f"holds {len(set(masses))} different masses; needed: at least 3 for a line"
            refuse([Conflict((), what, "use different weights")])
        return masses
