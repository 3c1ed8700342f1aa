"""Results of runs with motion: misalignment, ripple, and a filtered trace."""

from __future__ import annotations

from hdbench.results.parts import Part, Result, Scale, Uncertain, key, listed, optional


class OrderLine(Part):
    """A line that stands at an order of the motor."""

    order: float = key("cycles per motor turn")
    frequency_hz: float | None = optional(
        "the frequency where the record cannot tell the two apart", "Hz"
    )
    false_alarm_probability: float = key("chance of such a line in noise")
    amplitude_nm: Uncertain = key("amplitude", "N m")
    phase_rad: Uncertain = key("phase over the motor angle", "rad")


class Tone(Part):
    """A line that stands at a frequency."""

    frequency_hz: float = key("frequency", "Hz")
    order: float | None = optional(
        "cycles per motor turn where the record cannot tell the two apart"
    )
    false_alarm_probability: float = key("chance of such a tone in noise")
    amplitude_nm: Uncertain = key("amplitude", "N m")
    phase_rad: Uncertain = key("phase over time", "rad")


class FitNoise(Part):
    """Noise of a residual as an autoregression."""

    order: int = key("order of the autoregressive noise model")
    coefficients: tuple[float, ...] = key("its coefficients")
    innovation_std: float = key("standard deviation of what drives it", "N m")
    n_samples: int = key("samples that it was estimated from")


class PeakToPeak(Part):
    """Torque once per output turn before the filter."""

    peak_to_peak_nm: Uncertain = key("before the filter", "N m")


class FilteredPeak(Part):
    """Torque once per output turn after the filter."""

    peak_to_peak_nm: Uncertain = key("after it", "N m")
    filter: str = key("which filter", default="")


class MisalignmentStretch(Part):
    """A stretch of constant velocity."""

    from_s: float = key("start of a stretch of constant velocity", "s")
    to_s: float = key("its end", "s")
    motor_velocity_rad_s: float = key("its velocity", "rad/s")
    offset_nm: Uncertain = key("its zero", "N m")


class MisalignmentOrder(Part):
    """A ripple order that was fitted beside the misalignment, or output order 2."""

    order: float | None = optional("cycles per motor turn", absent=True)
    amplitude_nm: Uncertain = key("amplitude", "N m")


class MisalignmentBlock(Part):
    """Block that a misalignment adds to a filter."""

    order: float = key("output order over the motor's turns")
    role: str = key("misalignment", default="misalignment")
    process_noise: float | None = optional("Q of the block per sample", "(N m)^2")
    measurement_noise: float | None = optional("R that it was chosen with", "(N m)^2")
    amplitude_nm: Uncertain | None = optional("amplitude that it starts from", "N m")
    phase_rad: Uncertain | None = optional("phase that it starts from", "rad")
    origin: str = key("where Q and R come from", default="")


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
    stretches: tuple[MisalignmentStretch, ...] = listed(
        "stretches of constant velocity, with their zero"
    )
    ripple: tuple[MisalignmentOrder, ...] = listed("orders of the motor, amplitude each")
    output_order_2: MisalignmentOrder | None = optional("torque twice per output turn")
    lines: tuple[OrderLine, ...] = listed("further orders that stand out")
    tones: tuple[Tone, ...] = listed("frequencies that stand out")
    false_alarm_level: float | None = optional("false-alarm probability of lines and tones")
    residual_rms_nm: float | None = optional("what is left after the fit", "N m")
    noise: FitNoise | None = optional("noise model of the residual")
    torque_scale: Scale | None = optional("gain that scaled the torque, and where it is from")
    filter: MisalignmentBlock = key("block that this result adds to a filter")


class RippleOrder(Part):
    """One ripple component ``amplitude * cos(order * motor_angle + phase)``."""

    order: float = key("cycles per motor turn")
    order_estimate: Uncertain | None = optional("order as the record itself tells it")
    amplitude_nm: Uncertain = key("amplitude", "N m")
    phase_rad: Uncertain = key("phase of the cosine over the motor angle", "rad")
    small_amplitude: bool = key("whether the phase is hardly determined", default=False)
    suppression_db: float | None = optional("what the filter takes", "dB")
    suppression_is_bound: bool = key("whether the suppression is a lower bound", default=False)


class VelocityRange(Part):
    """Motor velocity over the evaluated samples, with its sign."""

    mean: float = key("mean velocity", "rad/s")
    std: float = key("its standard deviation over the record", "rad/s")
    min: float = key("smallest velocity", "rad/s")
    max: float = key("largest velocity", "rad/s")


class TorqueRms(Part):
    """Root mean square of the torque over the same samples."""

    measured: float | None = optional("of the measured torque", "N m")
    filtered: float | None = optional("of the filtered torque", "N m")


class Suppression(Part):
    """What the filter takes of one order."""

    order: float = key("cycles per motor turn")
    suppression_db: float | None = optional("what the filter takes", "dB")
    is_bound: bool = key("whether that is a lower bound", default=False)


class SpectrumLine(Part):
    """A peak of the spectrum."""

    name: str | None = optional("order that it is of, where known")
    frequency_hz: float = key("frequency", "Hz")
    angular_frequency_rad_s: float = key("angular frequency", "rad/s")
    order: float = key("frequency over that of the motor")
    amplitude_nm: float = key("amplitude", "N m")


class SteadySpectrum(Part):
    """Spectrum of the torque, less its slow terms, over the steadiest stretch."""

    from_s: float = key("start of the steady stretch", "s")
    to_s: float = key("its end", "s")
    motor_velocity_rad_s: float = key("its velocity", "rad/s")
    resolution_hz: float = key("distance of two lines that can be told apart", "Hz")
    peaks: tuple[SpectrumLine, ...] = listed("largest first")


class OutputOrder(Part):
    """An order of the output that was fitted jointly."""

    amplitude_nm: Uncertain = key("amplitude", "N m")
    phase_rad: Uncertain = key("phase over the output angle", "rad")


class SlowTerms(Part):
    """Slow terms that were fitted beside the orders."""

    degree: int = key("degree of the polynomial in time")
    direction_offset: bool = key("whether each direction has a zero of its own")
    output_sinusoid: bool = key("whether a sinusoid over the output angle was fitted")
    rule: str = key("why these terms", default="")


class EvaluatedTime(Part):
    """Part of the record that was evaluated."""

    from_s: float = key("start of what was evaluated", "s")
    to_s: float = key("its end", "s")


class RippleBlocks(Part):
    """What a ripple run says of a filter."""

    name: str = key("filter model", default="")
    role: str = key("ripple", default="ripple")
    orders: tuple[float, ...] = listed("its motor orders")
    measurement_noise: float | None = optional("R per sample", "(N m)^2")
    measurement_noise_origin: str = key("where R comes from", default="")
    process_noise: float | None = optional("Q per sample", "(N m)^2")
    process_noise_origin: str = key("where Q comes from", default="")


class RippleResult(Result):
    """Torque ripple of a free-motion run."""

    schema: str = key("hdbench/KIND/1", default="hdbench/ripple/1")
    ripple: tuple[RippleOrder, ...] = key("one entry per order of the filter")
    lines: tuple[OrderLine, ...] = listed("further orders that stand out")
    tones: tuple[Tone, ...] = listed("frequencies that stand out")
    false_alarm_level: float | None = optional("false-alarm probability of lines and tones")
    motor_velocity_rad_s: VelocityRange = key("mean, std, min and max", "rad/s")
    torque_rms_nm: TorqueRms = key("measured and filtered", "N m")
    suppression_db: tuple[Suppression, ...] = listed("suppression per order")
    spectrum: SteadySpectrum | None = optional("peaks of the steady stretch")
    output_order_1: OutputOrder | None = optional("torque once per output turn")
    output_order_2: OutputOrder | None = optional("torque twice per output turn")
    trend: SlowTerms | None = optional("slow terms that were fitted beside the orders")
    noise: FitNoise | None = optional("noise model of the residual")
    noise_std_nm: float | None = optional("noise of one sample", "N m")
    residual_rms_nm: float | None = optional("what is left after the fit", "N m")
    evaluated: EvaluatedTime | None = optional("from_s and to_s of what was evaluated", "s")
    angle_source: str = key("where the motor angle comes from", default="")
    angle_scale: Uncertain | None = optional("factor on an integrated angle")
    torque_scale: Scale | None = optional("gain that scaled the torque, and where it is from")
    filter: RippleBlocks = key("filter that was used, and where its numbers come from")


class FilteredTrace(Part):
    """A stored trace behind a filter, as a regression case keeps it."""

    schema: str = key("hdbench/KIND/1", default="hdbench/filter/1")
    filter_name: str = key("model that filtered")
    n_samples: int = key("samples")
    n_present: int = key("samples with a torque")
    torque_filtered_rms_nm: float = key("rms of the filtered torque", "N m")
    torque_filtered_min_nm: float = key("its smallest value", "N m")
    torque_filtered_max_nm: float = key("its largest value", "N m")
    samples_nm: tuple[float, ...] = key("filtered torque at evenly spread samples", "N m")
    sha256: str = key("digest of all filtered samples")
