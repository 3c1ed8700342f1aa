"""What a misalignment run hands out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hdbench.estimation.channel import DataFlag
from hdbench.estimation.scan import Line
from hdbench.estimation.search import FALSE_ALARM_LEVEL
from hdbench.estimation.stretches import SteadyStretch
from hdbench.records.quantity import Quantity, TorqueScale

__all__ = ["MisalignmentResult"]


@dataclass(frozen=True, slots=True)
class MisalignmentResult:
    """Misalignment torque ``amplitude * cos(output_angle + phase)``.

    Parameters
    ----------
    amplitude_nm, peak_to_peak_nm, phase_rad : Quantity
        Amplitude and twice it, N m; phase at output angle 0, rad.
    before, after : Quantity
        Peak to peak of the output-order component in measured and in filtered torque, N m.
    small_amplitude : bool
        True where the amplitude is below three standard uncertainties (biased upwards).
    output_turns : float
        Output turns travelled in the evaluated stretches, all directions together.
    mean_torque_nm : float
        Mean measured torque over the evaluated samples, N m.
    motor_velocity_rad_s : float
        Mean speed of the motor over the stretches, without sign, rad/s.
    stretches : tuple of SteadyStretch
        What was evaluated.
    offsets_nm : tuple of Quantity
        Zero of each stretch, N m.
    ripple : tuple of (float, Quantity)
        Order and amplitude, N m, of the ripple fitted jointly.
    output_order_2 : Quantity or None
        Amplitude of output order 2 fitted jointly, N m; None below 1.5 output turns.
    lines : tuple of Line
        Further lines found in the residual, fitted jointly.
    residual_rms_nm : float
        Root mean square of the residual, N m.
    noise : mapping or None
        Noise model of the residual; None where the residual is zero.
    scale : TorqueScale
        Gain used.
    filter_name : str
        Filter of `after`.
    process_noise : float
        Q of the output-order block, (N m)^2 per sample, beside the profile's R.
    measurement_noise : float
        That R, (N m)^2.
    gear_ratio : float
        Motor turns per output turn.
    flags : tuple of DataFlag
        What makes the data doubtful.
    notes : tuple of DataFlag
        What limits the evaluation of sound data.
    n_samples : int
        Samples used.
    """

    amplitude_nm: Quantity
    peak_to_peak_nm: Quantity
    phase_rad: Quantity
    before: Quantity
    after: Quantity
    small_amplitude: bool
    output_turns: float
    mean_torque_nm: float
    motor_velocity_rad_s: float
    stretches: tuple[SteadyStretch, ...]
    offsets_nm: tuple[Quantity, ...]
    ripple: tuple[tuple[float, Quantity], ...]
    output_order_2: Quantity | None
    lines: tuple[Line, ...]
    residual_rms_nm: float
    noise: Mapping[str, object] | None
    scale: TorqueScale
    filter_name: str
    process_noise: float
    measurement_noise: float
    gear_ratio: float
    flags: tuple[DataFlag, ...]
    notes: tuple[DataFlag, ...]
    n_samples: int

    def to_dict(self, header: Mapping[str, Any]) -> dict[str, Any]:
        """Return the result as it is stored.

        Parameters
        ----------
        header : mapping
            ``hdbench_version``, ``profile`` and what else the caller knows of the run.

        Returns
        -------
        dict
            The keys of the contract's section 5 and those of `MisalignmentResult`.
        """
        return {
            "schema": "hdbench/misalignment/1",
            **header,
            "amplitude_nm": self.amplitude_nm.to_dict(),
            "peak_to_peak_nm": self.peak_to_peak_nm.to_dict(),
            "phase_rad": self.phase_rad.to_dict(),
            "small_amplitude": self.small_amplitude,
            "before": {"peak_to_peak_nm": self.before.to_dict()},
            "after": {"peak_to_peak_nm": self.after.to_dict(), "filter": self.filter_name},
            "output_turns": self.output_turns,
            "mean_torque_nm": self.mean_torque_nm,
            "motor_velocity_rad_s": self.motor_velocity_rad_s,
            "stretches": [
                {**stretch.to_dict(), "offset_nm": offset.to_dict()}
                for stretch, offset in zip(self.stretches, self.offsets_nm, strict=True)
            ],
            "ripple": [
                {"order": order, "amplitude_nm": size.to_dict()} for order, size in self.ripple
            ],
            "output_order_2": None
            if self.output_order_2 is None
            else {"amplitude_nm": self.output_order_2.to_dict()},
            "lines": [x.to_dict() for x in self.lines if x.domain == "motor-order"],
            "tones": [x.to_dict() for x in self.lines if x.domain == "frequency"],
            "false_alarm_level": FALSE_ALARM_LEVEL,
            "residual_rms_nm": self.residual_rms_nm,
            "noise": self.noise,
            "torque_scale": self.scale.to_dict(),
            "filter": {
                "order": 1.0 / self.gear_ratio,
                "role": "misalignment",
                "process_noise": self.process_noise,
                "measurement_noise": self.measurement_noise,
                "amplitude_nm": self.amplitude_nm.to_dict(),
                "phase_rad": self.phase_rad.to_dict(),
                "origin": f"amplitude and phase: joint regression over {self.output_turns:.2f} "
                "output turns; process noise: profile",
            },
            "flags": [flag.to_dict() for flag in self.flags],
            "notes": [note.to_dict() for note in self.notes],
            "n_samples": self.n_samples,
        }
