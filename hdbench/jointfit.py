"""Joint fit of a run with motion: its record, and one regression of both torques."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.estimation.harmonics import Harmonic, harmonic_at, scaled
from hdbench.estimation.regression import LinearFit, coloured_fit
from hdbench.estimation.search import FALSE_ALARM_LEVEL, Line, LineFit, fit_with_lines
from hdbench.estimation.stretches import data_flags, stretch_starts
from hdbench.filter import FilterModel, filter_trace
from hdbench.model.motion import Motion, motion_from_trace
from hdbench.profile.scaling import torque_channel
from hdbench.profile.schema import ProfileData
from hdbench.records.quantity import Quantity, TorqueScale
from hdbench.records.trace import FloatArray, Trace
from hdbench.results.dynamic import FitNoise, OrderLine, Tone


@dataclass(frozen=True, slots=True)
class MotionRecord:
    """One trace made ready for the regression; arrays of shape (n,)."""

    trace: Trace
    profile: ProfileData
    scale: TorqueScale
    motion: Motion
    # measured torque, and J/N times the acceleration without lag, N m
    torque_nm: FloatArray
    expected_nm: FloatArray
    # samples that are evaluated, and where a stretch of them begins
    used: NDArray[np.bool_]
    starts: NDArray[np.bool_]

    @property
    def response_nm(self) -> FloatArray:
        """Torque that the regression explains, N m."""
        return self.torque_nm - self.expected_nm

    def scaled(self, torque_nm: Quantity) -> Quantity:
        """Return a torque with the uncertainty of the gain added."""
        return scaled(torque_nm, self.scale.relative_std, self.scale.gain_nm_per_v.dof)


@dataclass(frozen=True, slots=True)
class JointFit:
    """The regression of the measured torque, and of the filtered torque on the same columns."""

    record: MotionRecord
    found: LineFit
    filtered: LinearFit

    def component(self, column: int) -> Harmonic:
        """Return the component whose cosine stands at a column, with the gain's uncertainty."""
        here = harmonic_at(self.found.fit, column)
        return Harmonic(self.record.scaled(here.amplitude), here.phase, here.small)

    def shared_keys(self) -> dict[str, Any]:
        """Return what the results of all runs with motion say."""
        record, fit = self.record, self.found.fit
        noise, lines = fit.noise, self.found.lines
        return {
            "lines": tuple(
                OrderLine(order=x.location, frequency_hz=x.equivalent, **self._size(x))
                for x in lines
                if x.domain == "motor-order"
            ),
            "tones": tuple(
                Tone(frequency_hz=x.location, order=x.equivalent, **self._size(x))
                for x in lines
                if x.domain == "frequency"
            ),
            "false_alarm_level": FALSE_ALARM_LEVEL,
            "residual_rms_nm": fit.rms,
            "noise": None
            if noise is None
            else FitNoise(
                order=noise.order,
                coefficients=tuple(noise.coefficients.tolist()),
                innovation_std=noise.innovation_std,
                n_samples=noise.n_samples,
            ),
            "torque_scale": record.scale,
            "flags": data_flags(record.trace, record.torque_nm, record.profile),
            "n_samples": fit.n_samples,
        }

    def _size(self, line: Line) -> dict[str, Any]:
        if line.component is None:
            raise ValueError(f"the line at {line.location!r} was not fitted")
        return {
            "false_alarm_probability": line.false_alarm_probability,
            "amplitude_nm": self.record.scaled(line.component.amplitude),
            "phase_rad": line.component.phase,
        }


def read_motion(trace: Trace, profile: ProfileData, scale: TorqueScale) -> MotionRecord:
    """Return torque and motion of a trace; every sample that has both is used."""
    torque = torque_channel(trace, scale.gain_nm_per_v.value)
    motion = motion_from_trace(trace, profile)
    expected = profile.drive.load_inertia_kg_m2 / motion.gear_ratio * motion.acceleration_rad_s2
    return MotionRecord(
        trace,
        profile,
        scale,
        motion,
        torque,
        expected,
        motion.valid & np.isfinite(torque),
        stretch_starts(motion.time_s),
    )


def filtered_torque(record: MotionRecord, model: FilterModel) -> FloatArray:
    """Return the torque of a record behind a filter, N m."""
    return filter_trace(
        record.trace.with_columns(torque_nm=record.torque_nm),
        model,
        record.profile,
    ).torque_filtered_nm


def joint_fit(
    record: MotionRecord, design: FloatArray, orders: tuple[float, ...], filtered_nm: FloatArray
) -> JointFit:
    """Fit columns and the lines that the residual shows to the measured and the filtered torque.

    Raises
    ------
    ValueError
        If samples are too few or columns cannot be told apart.
    """
    motion = record.motion
    found = fit_with_lines(
        design,
        record.response_nm,
        record.used,
        motor_angle_rad=motion.angle_rad,
        time_s=motion.time_s,
        orders=orders,
        starts=record.starts,
    )
    filtered = coloured_fit(
        found.design, filtered_nm - record.expected_nm, record.used, starts=record.starts
    )
    return JointFit(record, found, filtered)
