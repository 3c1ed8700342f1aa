"""What a ripple run hands out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hdbench.estimation.channel import DataFlag
from hdbench.estimation.harmonics import Harmonic
from hdbench.estimation.noise import NoiseModel
from hdbench.estimation.scan import Line
from hdbench.estimation.search import FALSE_ALARM_LEVEL
from hdbench.estimation.spectrum import Spectrum, SpectrumPeak
from hdbench.estimation.stretches import SteadyStretch
from hdbench.estimation.trend import Trend
from hdbench.records.quantity import Quantity, TorqueScale

__all__ = ["RippleOrder", "RippleResult", "SteadySpectrum", "VelocityRange"]


@dataclass(frozen=True, slots=True)
class RippleOrder:
    """One ripple component ``amplitude * cos(order * motor_angle + phase)``.

    Parameters
    ----------
    order : float
        Nominal order, cycles per motor turn.
    order_estimate : Quantity or None
        Order measured in the angle of the record, before any correction of its scale; None where
        the component is too weak for it.
    component : Harmonic
        Amplitude, N m, and phase, rad.
    suppression_db : float or None
        ``20 log10`` of the amplitude in measured over filtered torque; None where the measured
        one is below three of its standard uncertainties.
    suppression_is_bound : bool
        True where the amplitude in the filtered torque is below twice its uncertainty: then that
        uncertainty stands for it, and the suppression is at least what is given.
    """

    order: float
    order_estimate: Quantity | None
    component: Harmonic
    suppression_db: float | None
    suppression_is_bound: bool

    def to_dict(self) -> dict[str, object]:
        """Return the component as results store it."""
        estimate = self.order_estimate
        return {
            "order": self.order,
            "order_estimate": None if estimate is None else estimate.to_dict(),
            "amplitude_nm": self.component.amplitude.to_dict(),
            "phase_rad": self.component.phase.to_dict(),
            "small_amplitude": self.component.small,
            "suppression_db": self.suppression_db,
            "suppression_is_bound": self.suppression_is_bound,
        }


@dataclass(frozen=True, slots=True)
class SteadySpectrum:
    """Spectrum of the torque, less its slow terms, over the steadiest stretch.

    Parameters
    ----------
    stretch : SteadyStretch
        Where.
    spectrum : Spectrum
        Amplitude in N m, power density in (N m)^2 / Hz.
    peaks : tuple of SpectrumPeak
        Strongest first; those at the ripple orders are named.
    """

    stretch: SteadyStretch
    spectrum: Spectrum
    peaks: tuple[SpectrumPeak, ...]

    def to_dict(self) -> dict[str, object]:
        """Return stretch, resolution and peaks as results store them."""
        return {
            **self.stretch.to_dict(),
            "resolution_hz": self.spectrum.resolution_hz,
            "peaks": [peak.to_dict() for peak in self.peaks],
        }


@dataclass(frozen=True, slots=True)
class VelocityRange:
    """Motor velocity over the evaluated samples, rad/s.

    Parameters
    ----------
    mean, std, min, max : float
        Mean, standard deviation, smallest and largest, with sign.
    """

    mean: float
    std: float
    min: float
    max: float

    def to_dict(self) -> dict[str, float]:
        """Return the four numbers as results store them."""
        return {"mean": self.mean, "std": self.std, "min": self.min, "max": self.max}


@dataclass(frozen=True, slots=True)
class RippleResult:
    """Torque ripple of a run.

    Parameters
    ----------
    ripple : tuple of RippleOrder
        One entry per order asked for.
    lines : tuple of Line
        Further lines in the residual, fitted jointly.
    motor_velocity_rad_s : VelocityRange
        Motor velocity over the evaluated samples.
    torque_rms_measured_nm, torque_rms_filtered_nm : float
        Root mean square of measured and of filtered torque over the same samples.
    spectrum : SteadySpectrum or None
        Spectrum of the steadiest stretch; None where nothing is steady.
    misalignment : Harmonic or None
        Output order 1 of the joint fit; None where the output spans less than a turn.
    output_order_2 : Harmonic or None
        Output order 2 of the joint fit; None where the output spans less than 1.5 turns.
    trend : Trend
        Slow terms of the joint fit.
    noise : NoiseModel or None
        Noise of the residual.
    residual_rms_nm : float
        Root mean square of the residual, N m.
    process_noise : float
        Suggested Q of a ripple block, (N m)^2 per sample.
    process_noise_origin : str
        How it was found.
    from_s, to_s : float
        First and last time evaluated, s.
    angle_source : str
        Where the motor angle came from.
    angle_scale : Quantity or None
        Factor by which an integrated angle was corrected, found from the strongest order; None
        where the angle was taken as it is.
    scale : TorqueScale
        Gain used.
    filter_name : str
        Filter of the filtered torque.
    flags : tuple of DataFlag
        What makes the data doubtful.
    notes : tuple of DataFlag
        What limits the evaluation of sound data.
    n_samples : int
        Samples used.
    """

    ripple: tuple[RippleOrder, ...]
    lines: tuple[Line, ...]
    motor_velocity_rad_s: VelocityRange
    torque_rms_measured_nm: float
    torque_rms_filtered_nm: float
    spectrum: SteadySpectrum | None
    misalignment: Harmonic | None
    output_order_2: Harmonic | None
    trend: Trend
    noise: NoiseModel | None
    residual_rms_nm: float
    process_noise: float
    process_noise_origin: str
    from_s: float
    to_s: float
    angle_source: str
    angle_scale: Quantity | None
    scale: TorqueScale
    filter_name: str
    flags: tuple[DataFlag, ...]
    notes: tuple[DataFlag, ...]
    n_samples: int

    @property
    def noise_std_nm(self) -> float:
        """Innovation of the noise, N m per sample: what the filter's R stands for."""
        return self.residual_rms_nm if self.noise is None else self.noise.innovation_std

    def to_dict(self, header: Mapping[str, Any]) -> dict[str, Any]:
        """Return the result as it is stored.

        Parameters
        ----------
        header : mapping
            ``hdbench_version``, ``profile`` and what else the caller knows of the run.

        Returns
        -------
        dict
            The keys of the contract's section 5 and those of `RippleResult`.
        """
        return {
            "schema": "hdbench/ripple/1",
            **header,
            "ripple": [entry.to_dict() for entry in self.ripple],
            "lines": [x.to_dict() for x in self.lines if x.domain == "motor-order"],
            "tones": [x.to_dict() for x in self.lines if x.domain == "frequency"],
            "false_alarm_level": FALSE_ALARM_LEVEL,
            "motor_velocity_rad_s": self.motor_velocity_rad_s.to_dict(),
            "torque_rms_nm": {
                "measured": self.torque_rms_measured_nm,
                "filtered": self.torque_rms_filtered_nm,
            },
            "suppression_db": [
                {
                    "order": entry.order,
                    "suppression_db": entry.suppression_db,
                    "is_bound": entry.suppression_is_bound,
                }
                for entry in self.ripple
            ],
            "spectrum": None if self.spectrum is None else self.spectrum.to_dict(),
            "output_order_1": _stored(self.misalignment),
            "output_order_2": _stored(self.output_order_2),
            "trend": self.trend.to_dict(),
            "noise": None if self.noise is None else self.noise.to_dict(),
            "noise_std_nm": self.noise_std_nm,
            "residual_rms_nm": self.residual_rms_nm,
            "evaluated": {"from_s": self.from_s, "to_s": self.to_s},
            "angle_source": self.angle_source,
            "angle_scale": None if self.angle_scale is None else self.angle_scale.to_dict(),
            "torque_scale": self.scale.to_dict(),
            "filter": self._filter(),
            "flags": [flag.to_dict() for flag in self.flags],
            "notes": [note.to_dict() for note in self.notes],
            "n_samples": self.n_samples,
        }

    def _filter(self) -> dict[str, Any]:
        return {
            "name": self.filter_name,
            "role": "ripple",
            "orders": [entry.order for entry in self.ripple],
            "measurement_noise": self.noise_std_nm**2,
            "measurement_noise_origin": "innovation variance of the residual, (N m)^2",
            "process_noise": self.process_noise,
            "process_noise_origin": self.process_noise_origin,
        }


def _stored(component: Harmonic | None) -> dict[str, object] | None:
    if component is None:
        return None
    return {
        "amplitude_nm": component.amplitude.to_dict(),
        "phase_rad": component.phase.to_dict(),
    }
