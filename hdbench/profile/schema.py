"""The profile: one bench as data, every key with its unit, domain and meaning."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, PositiveFloat, PositiveInt, ValidationInfo, field_validator

from hdbench.profile.acquiring import AnyAcquisition
from hdbench.profile.calibrating import Arm, CalibrationPlan, Identity, Standards
from hdbench.profile.tables import Conflict, NonNegative, Table, item, refuse

# shares of a period given as decimals add up to 1 within a few roundings
_SHARE_ROUNDING = 1e-12
Name = Annotated[
    str,
    Field(
        pattern=r"^[a-z0-9][a-z0-9._-]{0,63}$",
        description="name of the bench: small letters, digits, '.', '_', '-', at most 64",
    ),
]


class Drive(Table):
    """The harmonic drive and the load on it."""

    gear_ratio: float = item("motor turns per output turn", ge=1.0, le=1000.0)
    rated_torque_nm: PositiveFloat = item("rated output torque, N m")
    load_inertia_kg_m2: PositiveFloat = item("inertia of the load about the output, kg m^2")
    flexspline_diameter_mm: PositiveFloat = item("flexspline diameter, mm")
    flexspline_length_mm: PositiveFloat = item("flexspline length, mm")
    flexspline: Literal["standing", "turning"] = item(
        "whether the flexspline with its gauges stands or turns with the output; gauge ripple has "
        "motor order 2 on a standing one, 2 (1 + 1/N) on a turning one",
        "standing",
    )


class Sensor(Table):
    """Strain-gauge bridge on the flexspline and its amplifier."""

    gain_nm_per_v: PositiveFloat = item("torque per amplified volt, N m/V")
    gain_consistency: NonNegative = item(
        "std over mean of the gain between flexspline positions", lt=0.5
    )
    excitation_v: PositiveFloat = item("bridge supply, V")
    amplifier_gain: PositiveFloat = item("amplifier gain, V/V")
    gauge_factor: PositiveFloat = item("gauge factor K of the gauges", 2.0)
    wave_strain: NonNegative = item(
        "strain amplitude Psi_0 that the wave generator imposes at a gauge pair", 200e-6
    )
    noise_nm: NonNegative = item("white noise of the torque channel, N m per sample", 0.05)


class Tacho(Table):
    """Tachogenerator on the motor."""

    gain_rad_s_per_v: PositiveFloat = item("motor speed per volt, rad/s/V")
    noise_v: NonNegative = item("white noise, V per sample", 0.001)


class Encoder(Table):
    """Incremental encoder on the motor."""

    counts_per_turn: PositiveInt = item("counts per motor turn after quadrature, 1")


class Servo(Table):
    """Motor with its servo amplifier: a velocity loop with limits."""

    velocity_gain_rad_s_per_v: PositiveFloat = item(
        "commanded motor speed per reference volt, rad/s/V"
    )
    bandwidth_hz: PositiveFloat = item("velocity loop bandwidth, Hz")
    max_acceleration_rad_s2: PositiveFloat = item("acceleration at the current limit, rad/s^2")
    max_current_a: PositiveFloat = item("amplifier current limit, A")
    torque_constant_nm_per_a: PositiveFloat = item("motor torque constant, N m/A")


class Limits(Table):
    """What a plan may ask of this bench; checked before anything moves."""

    velocity_rad_s: PositiveFloat = item("motor speed, rad/s")
    reference_v: PositiveFloat = item("motor reference, V")
    torque_nm: PositiveFloat = item("output torque, N m")
    current_a: PositiveFloat = item("motor current, A")
    duration_s: PositiveFloat = item("longest single run, s")
    travel_rad: PositiveFloat | None = item(
        "motor angle from where a run began, either way, rad; none: endless", None
    )


class ReferenceWave(Table):
    """Reference generator of the free-motion run, in volts of motor reference."""

    wave: Literal["constant", "sine", "square", "triangle", "trapezoid", "chirp"] = item(
        "wave type"
    )
    bias_v: float = item("offset, V", 0.0)
    amplitude_v: float = item("amplitude, V", 0.0)
    frequency_hz: NonNegative = item("frequency, Hz; of a chirp at its start", 0.0)
    end_frequency_hz: NonNegative = item("frequency of a chirp at its end, Hz", 0.0)
    duty: float = item(
        "share of the period that is high (square), of each half wave at full amplitude "
        "(trapezoid)",
        0.5,
        ge=0.0,
        le=1.0,
    )
    rise: float = item("rise of a trapezoid, share of each half wave", 0.0, ge=0.0, le=1.0)
    fall: float = item("fall of a trapezoid, share of each half wave", 0.0, ge=0.0, le=1.0)

    def conflicts(self) -> Iterator[Conflict]:
        """Return the keys that make no wave together."""
        total = math.fsum((self.rise, self.duty, self.fall))
        if self.wave == "trapezoid" and not total <= 1.0 + _SHARE_ROUNDING:
            yield Conflict(
                ("duty",),
                f"rise + duty + fall of a trapezoid make {total:g}; needed: at most 1",
                "shorten rise, duty or fall",
            )
        if self.wave != "constant" and not self.frequency_hz > 0.0:
            yield Conflict(
                ("frequency_hz",),
                f"found {self.frequency_hz:g} Hz for a {self.wave}; needed: above 0 Hz",
                "give the wave a frequency",
            )
        if self.wave == "chirp" and not self.end_frequency_hz > 0.0:
            yield Conflict(
                ("end_frequency_hz",),
                f"found {self.end_frequency_hz:g} Hz for a chirp; needed: above 0 Hz",
                "give the chirp an end frequency",
            )

    @property
    def peak_v(self) -> float:
        """Largest motor reference that the wave reaches, either sign, V."""
        if self.wave == "constant":
            return abs(self.bias_v + self.amplitude_v)
        return abs(self.bias_v) + abs(self.amplitude_v)


class MisalignmentPlan(Table):
    """Constant-velocity run over whole output turns, both directions."""

    velocity_rad_s: PositiveFloat = item("motor speed, rad/s")
    output_turns: float = item("output turns in each direction", ge=2.0, le=100.0)
    settle_s: NonNegative = item("time after the start left out, s", 0.5)


class RipplePlan(Table):
    """Free-motion run."""

    reference: ReferenceWave
    duration_s: PositiveFloat = item("length of the run, s")
    steady_tolerance: PositiveFloat = item(
        "velocity spread, share of its mean, of a steady stretch", 0.02, lt=0.5
    )


class FilterSettings(Table):
    """The shared filter module on this bench."""

    model: str = item("report-a1, report-a2, report-6 or a model file", "report-6", min_length=1)
    differentiator_time_constant_s: PositiveFloat = item("time constant of s/(T s + 1), s")
    ripple_process_noise: PositiveFloat = item("Q of the ripple blocks, (N m)^2 per sample")
    misalignment_process_noise: PositiveFloat = item(
        "Q of the output-order block, (N m)^2 per sample"
    )
    measurement_noise: PositiveFloat = item("R, (N m)^2")
    butterworth_cutoff_hz: PositiveFloat = item("low-pass for comparison, cut-off, Hz", 20.0)
    butterworth_order: int = item("low-pass for comparison, order", 2, ge=1, le=8)


class HarmonicParameters(Table):
    """One ripple component: amplitude cos(order * motor angle + phase)."""

    order: PositiveFloat = item("cycles per motor turn")
    amplitude_nm: NonNegative = item("amplitude, N m")
    phase_rad: float = item("phase, rad", 0.0)


class MisalignmentParameters(Table):
    """Misalignment torque: amplitude cos(output angle + phase)."""

    amplitude_nm: NonNegative = item("amplitude, N m")
    phase_rad: float = item("phase, rad", 0.0)


class ModelParameters(Table):
    """Parameters of the bench model, that is of the simulation."""

    zero_nm: float = item("zero offset, N m", 0.0)
    ripple: tuple[HarmonicParameters, ...] = item("torque ripple components", ())
    baseline_orders: tuple[PositiveFloat, ...] | None = item(
        "orders that every fit of a moving record holds beside those of `ripple`; none: 2 and 4, "
        "those of a wave generator",
        None,
        min_length=1,
    )
    misalignment: MisalignmentParameters

    @field_validator("ripple")
    @classmethod
    def _each_order_once(
        cls, ripple: tuple[HarmonicParameters, ...]
    ) -> tuple[HarmonicParameters, ...]:
        orders = [part.order for part in ripple]
        refuse(
            Conflict(
                (index, "order"),
                f"order {order:g} stands twice; needed: each order once",
                "add the two components up in one",
            )
            for index, order in enumerate(orders)
            if order in orders[:index]
        )
        return ripple


def _above(
    key: tuple[str, ...], value: float, limits: Limits, name: str, unit: str
) -> Iterator[Conflict]:
    limit = getattr(limits, name)
    if not value <= limit:
        yield Conflict(
            key,
            f"reaches {value:g} {unit}; needed: at most limits.{name} = {limit:g} {unit}",
            f"lower it, or raise limits.{name} if the bench allows that",
        )


class ProfileData(Table):
    """One bench: drive, sensor, DAQ, limits, experiments, filter, model."""

    # the tables of [daq] are looked up when the first profile is checked
    model_config = ConfigDict(defer_build=True)

    name: Name
    description: str = item("one line for a person", "")
    drive: Drive
    sensor: Sensor
    tacho: Tacho
    encoder: Encoder
    servo: Servo
    daq: AnyAcquisition = item("the DAQ; which keys it has depends on `driver`")
    limits: Limits
    arm: Arm
    standards: Standards = Standards()
    identity: Identity = Identity()
    calibration: CalibrationPlan
    misalignment: MisalignmentPlan
    ripple: RipplePlan
    filter: FilterSettings
    model: ModelParameters

    @field_validator("misalignment")
    @classmethod
    def _speed(cls, plan: MisalignmentPlan, info: ValidationInfo) -> MisalignmentPlan:
        if limits := info.data.get("limits"):
            name = "velocity_rad_s"
            refuse(_above((name,), plan.velocity_rad_s, limits, name, "rad/s"))
        return plan

    @field_validator("ripple")
    @classmethod
    def _motion(cls, plan: RipplePlan, info: ValidationInfo) -> RipplePlan:
        if limits := info.data.get("limits"):
            key = ("reference", "amplitude_v")
            refuse(
                [
                    *_above(key, plan.reference.peak_v, limits, "reference_v", "V"),
                    *_above(("duration_s",), plan.duration_s, limits, "duration_s", "s"),
                ]
            )
        return plan

    def load_conflicts(self) -> Iterator[Conflict]:
        """Yield where weights exceed the torque limit: only a calibration needs them to fit."""
        arm_nm_per_kg = self.arm.gravity_m_s2 * self.arm.length_m
        for name in ("full_masses_kg", "low_masses_kg"):
            torque_nm = max(getattr(self.calibration, name)) * arm_nm_per_kg
            yield from _above(("calibration", name), torque_nm, self.limits, "torque_nm", "N m")
