"""Results of runs with motion: misalignment and ripple."""

from __future__ import annotations

from hdbench.results.parts import Part, Result, Scale, Uncertain, key, result_part

__all__ = [
    "EvaluatedTime",
    "FilteredPeak",
    "FitNoise",
    "MisalignmentBlock",
    "MisalignmentOrder",
    "MisalignmentResult",
    "MisalignmentStretch",
    "OrderLine",
    "OutputOrder",
    "PeakToPeak",
    "RippleBlocks",
    "RippleOrder",
    "RippleResult",
    "SlowTerms",
    "SpectrumLine",
    "SteadySpectrum",
    "Suppression",
    "Tone",
    "TorqueRms",
    "VelocityRange",
]


@result_part()
class OrderLine(Part):
    """A line that stands at an order of the motor."""

    order: float = key("cycles per motor turn")
    frequency_hz: float | None = key(
        "the frequency where the record cannot tell the two apart", "Hz", default=None
    )
    false_alarm_probability: float = key("chance of such a line in noise")
    amplitude_nm: Uncertain = key("amplitude", "N m")
    phase_rad: Uncertain = key("phase over the motor angle", "rad")


@result_part()
class Tone(Part):
    """A line that stands at a frequency."""

    frequency_hz: float = key("frequency", "Hz")
    order: float | None = key(
        "cycles per motor turn where the record cannot tell the two apart", default=None
    )
    false_alarm_probability: float = key("chance of such a tone in noise")
    amplitude_nm: Uncertain = key("amplitude", "N m")
    phase_rad: Uncertain = key("phase over time", "rad")


@result_part()
class FitNoise(Part):
    """Noise of a residual as an autoregression."""

    order: int = key("order of the autoregressive noise model")
    coefficients: tuple[float, ...] = key("its coefficients")
    innovation_std: float = key("standard deviation of what drives it", "N m")
    n_samples: int = key("samples that it was estimated from")


@result_part()
class PeakToPeak(Part):
    """Torque once per output turn before the filter."""

    peak_to_peak_nm: Uncertain = key("before the filter", "N m")


@result_part()
class FilteredPeak(Part):
    """Torque once per output turn after the filter."""

    peak_to_peak_nm: Uncertain = key("after it", "N m")
    filter: str = key("which filter", default="")


@result_part()
class MisalignmentStretch(Part):
    """A stretch of constant velocity."""

    from_s: float = key("start of a stretch of constant velocity", "s")
    to_s: float = key("its end", "s")
    motor_velocity_rad_s: float = key("its velocity", "rad/s")
    offset_nm: Uncertain = key("its zero", "N m")


@result_part()
class MisalignmentOrder(Part):
    """A ripple order that was fitted beside the misalignment, or output order 2."""

    order: float | None = key("cycles per motor turn", default=None, absent=True)
    amplitude_nm: Uncertain = key("amplitude", "N m")


@result_part()
class MisalignmentBlock(Part):
    """Block that a misalignment adds to a filter."""

    order: float = key("output order over the motor's turns")
    role: str = key("misalignment", default="misalignment")
    process_noise: float | None = key("Q of the block per sample", "(N m)^2", default=None)
    measurement_noise: float | None = key("R that it was chosen with", "(N m)^2", default=None)
    amplitude_nm: Uncertain | None = key("amplitude that it starts from", "N m", default=None)
    phase_rad: Uncertain | None = key("phase that it starts from", "rad", default=None)
    origin: str = key("where Q and R come from", default="")


@result_part()
class MisalignmentResult(Result):
    """Misalignment torque ``amplitude * cos(output_angle + phase)`` of a constant-velocity run."""

    schema: str = key("hdbench/KIND/1", default="hdbench/misalignment/1")
    amplitude_nm: Uncertain = key("amplitude of the torque once per output turn", "N m")
    peak_to_peak_nm: Uncertain = key("twice the amplitude", "N m")
    phase_rad: Uncertain = key("phase of the cosine over the output angle", "rad")
    small_amplitude: bool = key(
        "whether the amplitude is below three standard uncertainties: biased upwards, its phase "
        "hardly known",
        default=False,
    )
    before: PeakToPeak = key("peak_to_peak_nm before the filter")
    after: FilteredPeak = key("peak_to_peak_nm after the filter, and which filter")
    output_turns: float = key("turns of the output in the record")
    mean_torque_nm: float = key("mean torque", "N m")
    motor_velocity_rad_s: float = key("mean velocity", "rad/s")
    stretches: tuple[MisalignmentStretch, ...] = key(
        "stretches of constant velocity, with their zero", default=()
    )
    ripple: tuple[MisalignmentOrder, ...] = key("orders of the motor, amplitude each", default=())
    output_order_2: MisalignmentOrder | None = key("torque twice per output turn", default=None)
    lines: tuple[OrderLine, ...] = key("further orders that stand out", default=())
    tones: tuple[Tone, ...] = key("frequencies that stand out", default=())
    false_alarm_level: float | None = key(
        "false-alarm probability of lines and tones", default=None
    )
    residual_rms_nm: float | None = key("what is left after the fit", "N m", default=None)
    noise: FitNoise | None = key("noise model of the residual", default=None)
    torque_scale: Scale | None = key(
        "gain that scaled the torque, and where it is from", default=None
    )
    filter: MisalignmentBlock = key("block that this result adds to a filter")


@result_part()
class RippleOrder(Part):
    """One ripple component ``amplitude * cos(order * motor_angle + phase)``."""

    order: float = key("cycles per motor turn")
    order_estimate: Uncertain | None = key("order as the record itself tells it", default=None)
    amplitude_nm: Uncertain = key("amplitude", "N m")
    phase_rad: Uncertain = key("phase of the cosine over the motor angle", "rad")
    small_amplitude: bool = key("whether the phase is hardly determined", default=False)
    suppression_db: float | None = key("what the filter takes", "dB", default=None)
    suppression_is_bound: bool = key("whether the suppression is a lower bound", default=False)


@result_part()
class VelocityRange(Part):
    """Motor velocity over the evaluated samples, with its sign."""

    mean: float = key("mean velocity", "rad/s")
    std: float = key("its standard deviation over the record", "rad/s")
    min: float = key("smallest velocity", "rad/s")
    max: float = key("largest velocity", "rad/s")


@result_part()
class TorqueRms(Part):
    """Root mean square of the torque over the same samples."""

    measured: float | None = key("of the measured torque", "N m", default=None)
    filtered: float | None = key("of the filtered torque", "N m", default=None)


@result_part()
class Suppression(Part):
    """What the filter takes of one order."""

    order: float = key("cycles per motor turn")
    suppression_db: float | None = key("what the filter takes", "dB", default=None)
    is_bound: bool = key("whether that is a lower bound", default=False)


@result_part()
class SpectrumLine(Part):
    """A peak of the spectrum."""

    name: str | None = key("order that it is of, where known", default=None)
    frequency_hz: float = key("frequency", "Hz")
    angular_frequency_rad_s: float = key("angular frequency", "rad/s")
    order: float = key("frequency over that of the motor")
    amplitude_nm: float = key("amplitude", "N m")


@result_part()
class SteadySpectrum(Part):
    """Spectrum of the torque, less its slow terms, over the steadiest stretch."""

    from_s: float = key("start of the steady stretch", "s")
    to_s: float = key("its end", "s")
    motor_velocity_rad_s: float = key("its velocity", "rad/s")
    resolution_hz: float = key("distance of two lines that can be told apart", "Hz")
    peaks: tuple[SpectrumLine, ...] = key("largest first", default=())


@result_part()
class OutputOrder(Part):
    """An order of the output that was fitted jointly."""

    amplitude_nm: Uncertain = key("amplitude", "N m")
    phase_rad: Uncertain = key("phase over the output angle", "rad")


@result_part()
class SlowTerms(Part):
    """Slow terms that were fitted beside the orders."""

    degree: int = key("degree of the polynomial in time")
    direction_offset: bool = key("whether each direction has a zero of its own")
    output_sinusoid: bool = key("whether a sinusoid over the output angle was fitted")
    rule: str = key("why these terms", default="")


@result_part()
class EvaluatedTime(Part):
    """Part of the record that was evaluated."""

    from_s: float = key("start of what was evaluated", "s")
    to_s: float = key("its end", "s")


@result_part()
class RippleBlocks(Part):
    """What a ripple run says of a filter."""

    name: str = key("filter model", default="")
    role: str = key("ripple", default="ripple")
    orders: tuple[float, ...] = key("its motor orders", default=())
    measurement_noise: float | None = key("R per sample", "(N m)^2", default=None)
    measurement_noise_origin: str = key("where R comes from", default="")
    process_noise: float | None = key("Q per sample", "(N m)^2", default=None)
    process_noise_origin: str = key("where Q comes from", default="")


@result_part()
class RippleResult(Result):
    """Torque ripple of a free-motion run."""

    schema: str = key("hdbench/KIND/1", default="hdbench/ripple/1")
    ripple: tuple[RippleOrder, ...] = key("one entry per order of the filter")
    lines: tuple[OrderLine, ...] = key("further orders that stand out", default=())
    tones: tuple[Tone, ...] = key("frequencies that stand out", default=())
    false_alarm_level: float | None = key(
        "false-alarm probability of lines and tones", default=None
    )
    motor_velocity_rad_s: VelocityRange = key("mean, std, min and max", "rad/s")
    torque_rms_nm: TorqueRms = key("measured and filtered", "N m")
    suppression_db: tuple[Suppression, ...] = key("suppression per order", default=())
    spectrum: SteadySpectrum | None = key("peaks of the steady stretch", default=None)
    output_order_1: OutputOrder | None = key("torque once per output turn", default=None)
    output_order_2: OutputOrder | None = key("torque twice per output turn", default=None)
    trend: SlowTerms | None = key("slow terms that were fitted beside the orders", default=None)
    noise: FitNoise | None = key("noise model of the residual", default=None)
    noise_std_nm: float | None = key("noise of one sample", "N m", default=None)
    residual_rms_nm: float | None = key("what is left after the fit", "N m", default=None)
    evaluated: EvaluatedTime | None = key(
        "from_s and to_s of what was evaluated", "s", default=None
    )
    angle_source: str = key("where the motor angle comes from", default="")
    angle_scale: Uncertain | None = key("factor on an integrated angle", default=None)
    torque_scale: Scale | None = key(
        "gain that scaled the torque, and where it is from", default=None
    )
    filter: RippleBlocks = key("filter that was used, and where its numbers come from")
