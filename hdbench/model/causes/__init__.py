"""The catalogue of causes: one record each, grouped by what they follow."""

from __future__ import annotations

from hdbench.model.causes.clock import CLOCK_CAUSES
from hdbench.model.causes.friction import FRICTION_CAUSES
from hdbench.model.causes.motor import MOTOR_CAUSES
from hdbench.model.causes.output import OUTPUT_CAUSES
from hdbench.model.causes.sensor import SENSOR_CAUSES
from hdbench.model.causes.slow import SLOW_CAUSES
from hdbench.model.definition import Cause

__all__ = ["ALL_CAUSES"]

ALL_CAUSES: tuple[Cause, ...] = (
    *MOTOR_CAUSES,
    *OUTPUT_CAUSES,
    *CLOCK_CAUSES,
    *FRICTION_CAUSES,
    *SENSOR_CAUSES,
    *SLOW_CAUSES,
)
