"""Tables of a calibration: arm, gravity, standards, plan, limits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, PositiveFloat, PositiveInt, field_validator

from hdbench.profile.tables import Conflict, NonNegative, Positive, Table, item, refuse

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


_Share = Annotated[float, Field(ge=0.0, lt=1.0)]
_Text = Annotated[str, Field(max_length=200)]
_Angle = Annotated[float, Field(ge=-0.5, le=0.5)]
# plain number of a place that is not stated: refused by the rules between keys
_NOWHERE = math.nan


class MassStandard(Table):
    """Weights: what their certificate states. Blank: not declared."""

    certificate: _Text = item("number of the certificate", "")
    accuracy_class: Literal["", "E2", "F1", "F2", "M1", "M2", "M3"] = item(
        "class of OIML R111; its limits serve where none are given", ""
    )
    relative_half_width: _Share | None = item("limits +- of a mass, share of the mass", None)
    relative_correction: float = item(
        "conventional mass over nominal mass, less 1", 0.0, gt=-0.1, lt=0.1
    )
    density_kg_m3: float = item("density of the weights, kg/m^3", 7850.0, ge=1000.0, le=22000.0)
    mass_kind: Literal["conventional", "true"] = item(
        "which mass the certificate states", "conventional"
    )


class LengthStandard(Table):
    """How the arm's length was measured. Blank: not declared."""

    certificate: _Text = item("number of the certificate", "")
    half_width_m: NonNegative | None = item("limits +- of the arm's length, m", None)


class TorqueStandard(Table):
    """Reference sensor, where torques are given and not made of weights. Blank: not declared."""

    certificate: _Text = item("number of the certificate", "")
    identity: _Text = item("maker, type, serial number", "")
    relative_expanded_uncertainty: _Share | None = item(
        "U (k = 2) of an applied torque, share of the torque", None
    )


class InstrumentStandard(Table):
    """Voltmeter or DAQ that read the bridge. Blank: not declared."""

    certificate: _Text = item("number of the certificate", "")
    identity: _Text = item("maker, type, serial number", "")
    relative_expanded_uncertainty: _Share | None = item(
        "U (k = 2) of a reading, share of the reading", None
    )
    resolution_v: Positive | None = item("smallest step, V; else from daq range and bits", None)


class Standards(Table):
    """What the calibration is traceable to, as the operator declares it."""

    mass: MassStandard = MassStandard()
    length: LengthStandard = LengthStandard()
    torque: TorqueStandard = TorqueStandard()
    instrument: InstrumentStandard = InstrumentStandard()


class Identity(Table):
    """Who calibrates what, and where. Blank: not declared."""

    laboratory: _Text = item("who calibrates, with address", "")
    place: _Text = item("where the calibration is made", "")
    customer: _Text = item("for whom", "")
    operator: _Text = item("who hangs the weights", "")
    drive_serial: _Text = item("type and serial number of the drive", "")
    flexspline_serial: _Text = item("serial number of the flexspline", "")
    bridge_ohm: Positive | None = item("resistance of the bridge, ohm", None)
    cable: _Text = item("cable and wiring, such as 6-wire, 3 m", "")
    amplifier_serial: _Text = item("type and serial of the amplifier", "")


def _gravity_there(data: dict[str, Any]) -> float:
    """Return gravity by latitude and height; NaN where they are not stated."""
    latitude, altitude = data.get("latitude_deg"), data.get("altitude_m")
    if latitude is None or altitude is None:
        return _NOWHERE
    welmec = data.get("gravity_formula") == "welmec"
    return (gravity_welmec if welmec else gravity_wgs84)(latitude, altitude)


class Arm(Table):
    """Arm and weights of the calibration."""

    length_m: PositiveFloat = item("axis to hanging point, m")
    latitude_deg: float | None = item(
        "latitude, deg; for gravity where none is given", None, ge=-90.0, le=90.0
    )
    altitude_m: float | None = item(
        "height, m; for gravity where none is given", None, ge=-500.0, le=9000.0
    )
    gravity_formula: GravityFormula = item("formula for gravity from latitude and height", "wgs84")
    gravity_m_s2: float = item(
        "local gravity, m/s^2; else latitude_deg and altitude_m are needed",
        ge=9.7,
        le=9.9,
        default_factory=_gravity_there,
    )
    gravity_half_width_m_s2: NonNegative | None = item(
        "limits +- of a given gravity, m/s^2; from latitude and height it is 50 ppm", None
    )
    thermal_expansion_per_k: float | None = item(
        "expansion of the arm's length, 1/K", None, ge=0.0, le=1e-4
    )
    reference_temperature_c: float = item(
        "temperature at which length_m holds, deg C", 20.0, ge=-20.0, le=60.0
    )
    temperature_half_width_k: NonNegative | None = item(
        "limits +- of the arm's temperature, K", None
    )
    tilt_rad: _Angle | None = item("downward tilt of the arm without weights, rad", None)
    tilt_half_width_rad: NonNegative | None = item("limits +- of the tilt, rad", None)
    torsional_stiffness_nm_per_rad: Positive | None = item(
        "stiffness between arm and ground, N m/rad; the arm sinks by it", None
    )
    lost_motion_rad: NonNegative = item("soft wind-up of the gear at first load, rad", 0.0, le=0.1)
    hang_offset_m: float | None = item(
        "hanging point below the line through the axis, m", None, ge=-1.0, le=1.0
    )
    hang_offset_half_width_m: NonNegative | None = item(
        "limits +- of the hanging point's offset, m", None
    )
    cant_half_width_rad: NonNegative | None = item(
        "the arm's plane off the vertical by at most this, rad", None, le=0.2
    )
    tare_kg: NonNegative = item("pan and hook that come on with the first weight, kg", 0.0)
    side_force_distance_m: Positive | None = item(
        "plane of the arm to plane of the gauges, m", None
    )
    air_density_kg_m3: float | None = item(
        "air density, kg/m^3; 1.20 is usual", None, ge=0.0, le=2.0
    )
    air_density_half_width_kg_m3: NonNegative = item("limits +- of the air density, kg/m^3", 0.10)
    loading: Literal["single", "couple"] = item(
        "one weight on one arm, or a couple without side force", "single"
    )

    def conflicts(self) -> Iterator[Conflict]:
        """Return that nothing tells the gravity, where that is so."""
        if math.isnan(self.gravity_m_s2):
            what = "is missing; needed: local gravity in m/s^2, or latitude_deg and altitude_m"
            yield Conflict(("gravity_m_s2",), what, "give gravity_m_s2, or where the bench stands")

    @property
    def gravity_source(self) -> Literal["given", "wgs84", "welmec"]:
        """Where the local gravity comes from."""
        return "given" if "gravity_m_s2" in self.model_fields_set else self.gravity_formula


class StepSequence(Table):
    """Sequence of the preset ``cg14``, in the manner of EURAMET cg-14."""

    positions: PositiveInt = item("positions, equally spaced over a turn", 3, ge=1, le=64)
    masses_kg: tuple[NonNegative, ...] = item(
        "weights, kg; empty: 0, 20, 40, 60, 80, 100 % of the largest full one", ()
    )
    repeat_series: int = item(
        "further up and down at the first position, not remounted", 1, ge=0, le=10
    )
    preloads_first: int = item(
        "loadings to the largest weight before the first series", 3, ge=0, le=10
    )
    preloads_remounted: int = item("the same after each new position or direction", 1, ge=0, le=10)
    preload_s: NonNegative = item("time under each preload, s", 30.0)
    read_after_s: NonNegative = item("earliest reading after a change of load, s", 30.0)


class AcceptanceLimits(Table):
    """Limits of `accepted` beside the consistency; a limit that is absent is not tested."""

    decision_rule: Literal["simple", "guarded"] = item(
        "simple: the value is within its limit; guarded: so is the upper end of its 95 % "
        "interval, where it has one",
        "simple",
    )
    max_expanded_uncertainty: Positive | None = item(
        "expanded uncertainty of the mean gain, 95 %, share of the gain", None
    )
    max_class: Positive | None = item("worst indicative class, such as 2", None)
    max_zero_return: Positive | None = item(
        "zero before less after a series, share of largest", None
    )
    max_hysteresis: Positive | None = item("down less up at one torque, share of largest", None)
    max_lack_of_fit: Positive | None = item("deviation from the line, share of largest", None)
    max_direction_asymmetry: Positive | None = item("gain cw less ccw, share of their mean", None)


class ShuntCheck(Table):
    """Resistor across one arm of the bridge: checks amplifier, excitation and wiring."""

    resistor_ohm: PositiveFloat = item("shunt resistor, ohm")
    bridge_ohm: PositiveFloat = item("resistance of each arm, ohm", 350.0)
    expected_v: float | None = item(
        "reading with less without shunt at the last calibration, V", None
    )
    tolerance: Positive = item("accepted change of the shunt reading, share of it", 0.001, lt=1.0)


class CalibrationPlan(Table):
    """Which loads, where, and when a reading counts as settled."""

    preset: Literal["report", "cg14"] = item(
        "report: the report's experiments; cg14: in the manner of EURAMET cg-14", "report"
    )
    positions: PositiveInt = item("flexspline positions, equally spaced over a turn", ge=1, le=64)
    directions: tuple[Literal["cw", "ccw"], ...] = item("loading directions", min_length=1)
    ranges: tuple[Literal["low", "full"], ...] = item("load ranges", min_length=1)
    full_masses_kg: tuple[NonNegative, ...] = item("masses of the full range, kg", min_length=3)
    low_masses_kg: tuple[NonNegative, ...] = item("masses of the low range, kg", min_length=3)
    sample_period_s: PositiveFloat = item("sampling period of readings, s", 0.01, ge=1e-3, le=1.0)
    average_s: PositiveFloat = item("time averaged for a reading, s", 1.0)
    settle_timeout_s: PositiveFloat = item("longest wait for a reading to settle, s", 30.0)
    settle_band_nm: PositiveFloat = item(
        "two adjacent windows must agree within this (plus noise), N m", 0.02
    )
    max_consistency: PositiveFloat = item("accepted when consistency is at most this", 0.05)
    max_lock_motion_rad: PositiveFloat = item(
        "motor angle change that means the lock slipped, rad", 0.02
    )
    gross_error_fraction: Positive = item(
        "a reading off the expected torque by more than this share of the smallest load step is "
        "asked about",
        0.3,
        lt=0.5,
    )
    validity_days: Positive = item("age from which a run refuses this calibration, days", 365.0)
    cg14: StepSequence = item("sequence of the preset cg14", StepSequence())
    limits: AcceptanceLimits = item("further limits of acceptance", AcceptanceLimits())
    shunt: ShuntCheck | None = item("shunt check, if the bridge has one", None)

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
