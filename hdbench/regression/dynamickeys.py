"""Keys of the results of runs with motion, as lines of ``key | type | unit | meaning``."""

from __future__ import annotations

__all__ = [
    "DYNAMIC",
    "DYNAMIC_PARTS",
    "MISALIGNMENT",
    "MISALIGNMENT_PARTS",
    "RIPPLE",
    "RIPPLE_PARTS",
]

MISALIGNMENT = """
amplitude_nm | uncertain | N m | amplitude of the torque once per output turn
peak_to_peak_nm | uncertain | N m | twice the amplitude
phase_rad | uncertain | rad | phase of the cosine over the output angle
small_amplitude | true or false | | whether the phase is hardly determined
before | table | | peak_to_peak_nm before the filter
after | table | | peak_to_peak_nm after the filter, and which filter
output_turns | number | | turns of the output in the record
mean_torque_nm | number | N m | mean torque
motor_velocity_rad_s | number | rad/s | mean velocity
stretches | list | | stretches of constant velocity, with their zero
output_order_2 | table | | torque twice per output turn
filter | table | | block that this result adds to a filter
"""
MISALIGNMENT_PARTS = """
before.peak_to_peak_nm | uncertain | N m | before the filter
after.peak_to_peak_nm | uncertain | N m | after it
after.filter | text | | which filter
stretches[].from_s | number | s | start of a stretch of constant velocity
stretches[].to_s | number | s | its end
stretches[].motor_velocity_rad_s | number | rad/s | its velocity
stretches[].offset_nm | uncertain | N m | its zero
ripple[].order | number | | cycles per motor turn
ripple[].amplitude_nm | uncertain | N m | amplitude
output_order_2.amplitude_nm | uncertain | N m | amplitude
filter.order | number | | output order over the motor's turns
filter.role | text | | misalignment
filter.process_noise | number | (N m)^2 | Q of the block per sample
filter.measurement_noise | number | (N m)^2 | R that it was chosen with
filter.amplitude_nm | uncertain | N m | amplitude that it starts from
filter.phase_rad | uncertain | rad | phase that it starts from
filter.origin | text | | where Q and R come from
"""
RIPPLE = """
ripple | list | | one entry per order of the filter
ripple[].order | number | | cycles per motor turn
ripple[].amplitude_nm | uncertain | N m | amplitude
ripple[].phase_rad | uncertain | rad | phase of the cosine over the motor angle
ripple[].suppression_db | number or null | dB | what the filter takes
motor_velocity_rad_s | table | rad/s | mean, std, min and max
torque_rms_nm | table | N m | measured and filtered
suppression_db | list | | suppression per order
spectrum | table or null | | peaks of the steady stretch
output_order_1 | table or null | | torque once per output turn
output_order_2 | table or null | | torque twice per output turn
trend | table | | slow terms that were fitted beside the orders
noise_std_nm | number | N m | noise of one sample
evaluated | table | s | from_s and to_s of what was evaluated
angle_source | text | | where the motor angle comes from
angle_scale | uncertain or null | | factor on an integrated angle
filter | table | | filter that was used, and where its numbers come from
"""
RIPPLE_PARTS = """
ripple[].order_estimate | uncertain or null | | order as the record itself tells it
ripple[].small_amplitude | true or false | | whether the phase is hardly determined
ripple[].suppression_is_bound | true or false | | whether the suppression is a lower bound
motor_velocity_rad_s.mean | number | rad/s | mean velocity
motor_velocity_rad_s.std | number | rad/s | its standard deviation over the record
motor_velocity_rad_s.min | number | rad/s | smallest velocity
motor_velocity_rad_s.max | number | rad/s | largest velocity
torque_rms_nm.measured | number or null | N m | of the measured torque
torque_rms_nm.filtered | number or null | N m | of the filtered torque
suppression_db[].order | number | | cycles per motor turn
suppression_db[].suppression_db | number or null | dB | what the filter takes
suppression_db[].is_bound | true or false | | whether that is a lower bound
spectrum.from_s | number | s | start of the steady stretch
spectrum.to_s | number | s | its end
spectrum.motor_velocity_rad_s | number | rad/s | its velocity
spectrum.resolution_hz | number | Hz | distance of two lines that can be told apart
spectrum.peaks | list | | largest first
spectrum.peaks[].name | text or null | | order that it is of, where known
spectrum.peaks[].frequency_hz | number | Hz | frequency
spectrum.peaks[].angular_frequency_rad_s | number | rad/s | angular frequency
spectrum.peaks[].order | number | | frequency over that of the motor
spectrum.peaks[].amplitude_nm | number | N m | amplitude
output_order_1.amplitude_nm | uncertain | N m | amplitude
output_order_1.phase_rad | uncertain | rad | phase over the output angle
output_order_2.amplitude_nm | uncertain | N m | amplitude
output_order_2.phase_rad | uncertain | rad | phase over the output angle
trend.degree | integer | | degree of the polynomial in time
trend.direction_offset | true or false | | whether each direction has a zero of its own
trend.output_sinusoid | true or false | | whether a sinusoid over the output angle was fitted
trend.rule | text | | why these terms
evaluated.from_s | number | s | start of what was evaluated
evaluated.to_s | number | s | its end
filter.name | text | | filter model
filter.role | text | | ripple
filter.orders | list | | its motor orders
filter.measurement_noise | number | (N m)^2 | R per sample
filter.measurement_noise_origin | text | | where R comes from
filter.process_noise | number | (N m)^2 | Q per sample
filter.process_noise_origin | text | | where Q comes from
"""
DYNAMIC = """
ripple | list | | orders of the motor, amplitude each
lines | list | | further orders that stand out
tones | list | | frequencies that stand out
false_alarm_level | number | | false-alarm probability of lines and tones
residual_rms_nm | number | N m | what is left after the fit
noise | table | | noise model of the residual
torque_scale | table | | gain that scaled the torque, and where it is from
"""
DYNAMIC_PARTS = """
lines[].order | number | | cycles per motor turn
lines[].frequency_hz | null | | none: a line stands at an order
lines[].false_alarm_probability | number | | chance of such a line in noise
lines[].amplitude_nm | uncertain | N m | amplitude
lines[].phase_rad | uncertain | rad | phase over the motor angle
tones[].frequency_hz | number | Hz | frequency
tones[].order | null | | none: a tone stands at a frequency
tones[].false_alarm_probability | number | | chance of such a tone in noise
tones[].amplitude_nm | uncertain | N m | amplitude
tones[].phase_rad | uncertain | rad | phase over time
noise.order | integer | | order of the autoregressive noise model
noise.coefficients | list | | its coefficients
noise.innovation_std | number | N m | standard deviation of what drives it
noise.n_samples | integer | | samples that it was estimated from
torque_scale.gain_nm_per_v | uncertain or null | N m/V | gain
torque_scale.source | text | | where it is from
torque_scale.sha256 | text or null | | SHA-256 of the calibration
torque_scale.calibrated_utc | text or null | | when that was made
torque_scale.age_days | number or null | d | its age at the run
torque_scale.expired | true or false | | whether it was too old
torque_scale.age_words | text | | the same in words
"""
