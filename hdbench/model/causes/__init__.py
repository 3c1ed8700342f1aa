"""The catalogue of causes: one record each, grouped as in the contract."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from hdbench.model.causes import (
    acquisition,
    arm,
    clock,
    creep,
    dynamics,
    friction,
    hysteresis,
    kinematic,
    loadfriction,
    motor,
    noise,
    output,
    ripple,
    sensor,
    slow,
    stiffness,
)
from hdbench.model.definition import Cause

__all__ = ["ALL_CAUSES", "CAUSE_GROUPS"]

CAUSE_GROUPS: Mapping[str, tuple[Cause, ...]] = MappingProxyType(
    {
        "locked to the motor": (
            motor.RIPPLE_HARMONIC,
            motor.ECCENTRICITY,
            motor.UNBALANCE,
            ripple.LOAD_RIPPLE,
            kinematic.TORSIONAL_RESONANCE,
            motor.BEAT,
            kinematic.KINEMATIC_ERROR,
            motor.TOOTH_MESH,
            motor.BEARING,
            ripple.GAIN_RIPPLE,
            motor.COGGING,
            kinematic.TRANSMISSION_ERROR,
        ),
        "locked to the output": (
            output.MISALIGNMENT,
            output.ANGULAR_MISALIGNMENT,
            output.LOAD_GRAVITY,
            output.POSITION_GAIN,
        ),
        "locked to the clock": (clock.MAINS_HUM, clock.STRUCTURAL_TONE),
        "friction": (
            friction.COULOMB,
            friction.VISCOUS,
            friction.STRIBECK,
            loadfriction.LOAD_FRICTION,
            loadfriction.PRESLIDING,
            friction.ASYMMETRIC,
        ),
        "static sensor and arm": (
            sensor.GAIN_ERROR,
            sensor.CUBIC_NONLINEARITY,
            hysteresis.HYSTERESIS,
            sensor.BACKLASH,
            sensor.SATURATION,
            arm.ARM_SAG,
            arm.SIDE_FORCE,
            arm.DIRECTION_ASYMMETRY,
        ),
        "dynamics": (
            dynamics.INERTIA_ERROR,
            dynamics.TIME_SKEW,
            stiffness.CUBIC_STIFFNESS,
            stiffness.PIECEWISE_STIFFNESS,
        ),
        "slow": (
            slow.ZERO_STEP,
            slow.ZERO_DRIFT,
            slow.WARM_UP,
            creep.CREEP,
            slow.ZERO_RANDOM_WALK,
        ),
        "acquisition": (
            noise.QUANTISATION,
            acquisition.MISSED_SAMPLES,
            acquisition.ENCODER_SLIP,
            acquisition.TACHO_RIPPLE,
            noise.SPIKES,
            noise.SPEED_NOISE,
            acquisition.CROSSTALK,
        ),
    }
)
ALL_CAUSES: tuple[Cause, ...] = tuple(c for group in CAUSE_GROUPS.values() for c in group)
