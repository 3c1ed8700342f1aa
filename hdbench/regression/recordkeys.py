"""Keys of what a calibration result tells beside its evaluation: load, standards, readings."""

from __future__ import annotations

__all__ = ["RECORD_PARTS"]

RECORD_PARTS = """
hysteresis.ID | table | | of one experiment, by its name
hysteresis.ID.largest_nm | number | N m | largest difference of unloading and loading
hysteresis.ID.at_torque_nm | number | N m | load at which it is
hysteresis.ID.relative | number | | the same over the largest load
hysteresis.ID.largest_torque_nm | number | N m | largest load
hysteresis.ID.area_v_nm | number | V N m | area of the loop
hysteresis.ID.area_relative | number | | the same over largest load times largest deflection
hysteresis.ID.zero_return_nm | number or null | N m | zero after unloading less zero before
hysteresis.ID.zero_return_relative | number or null | | the same over the largest load
hysteresis.ID.constant_nm | number or null | N m | part of the difference that no load changes
hysteresis.ID.lens_nm | number or null | N m | part that is largest at half load
torque.source | text | | how the applied torque is known
torque.gravity_m_s2 | number or null | m/s^2 | local acceleration of gravity
torque.gravity_source | text | | where it is from
torque.gravity_over_standard | number or null | | over 9.80665 m/s^2
torque.largest_nm | number or null | N m | largest applied torque, corrected
torque.largest_nominal_nm | number or null | N m | the same by mass, standard gravity and length
torque.tilt_rad | number or null | rad | largest tilt of the arm under load
torque.corrections | list | | one entry per correction
torque.corrections[].name | text | | correction
torque.corrections[].relative | number or null | | its relative size at the largest load
torque.corrections[].made | true or false | | whether it was made
torque.corrections[].detail | text | | with which numbers, or what is not known
torque.corrections[].uncertainty_share | number or null | | its share of the torque's variance
torque.relative_std | number or null | | relative standard uncertainty of the applied torque
torque.budget | list | | contributions to it
torque.not_declared | list | | sources without a declared uncertainty
side_force.force_n | number or null | N | side force of a one-sided arm
side_force.bending_nm | number or null | N m | bending moment that it makes
side_force.half_direction_difference | number or null | | half the relative difference of cw and ccw
side_force.cancels | true or false | | whether the mean over directions is free of it
side_force.reason | text | | why
experiment_steps[].experiment | text | | experiment
experiment_steps[].torque_nm | number | N m | load
experiment_steps[].reading_up_v | number or null | V | mean reading of loading
experiment_steps[].reading_down_v | number or null | V | mean reading of unloading
experiment_steps[].hysteresis_v | number or null | V | unloading less loading
experiment_steps[].deviation_nm | number or null | N m | deviation from the experiment's line
monte_carlo.draws | integer | | random draws
monte_carlo.seed | integer | | seed of the random numbers
monte_carlo.mean_nm_per_v | number | N m/V | mean of the drawn gains
monte_carlo.std_nm_per_v | number | N m/V | their standard deviation
monte_carlo.interval_nm_per_v | list | N m/V | symmetric 95 % interval
monte_carlo.shortest_interval_nm_per_v | list | N m/V | shortest 95 % interval
monte_carlo.expanded_nm_per_v | number | N m/V | half of the symmetric interval
monte_carlo.agrees_with_formula | true or false | | whether both ends agree within the tolerance
monte_carlo.tolerance_nm_per_v | number | N m/V | within which the ends should agree
course.temperature_c | table or null | degC | first, last, least and largest temperature
course.humidity_percent | table or null | % | the same of the relative humidity
course.pressure_hpa | table or null | hPa | the same of the air pressure
course.time_s | table or null | s | the same of the time of the readings
course.time_s.first | number | s | time of the first reading
course.time_s.last | number | s | time of the last
course.time_s.least | number | s | smallest time
course.time_s.largest | number | s | largest time
course.n_preloads | integer | | preloads that were recorded
course.n_excluded_samples | integer | | samples left out of the readings
course.excluded_at_s | list | s | when they were
standards.mass | table | | weights
standards.mass.certificate | text | | their certificate
standards.mass.accuracy_class | text | | their class
standards.mass.relative_half_width | number or null | | relative half width of a mass
standards.mass.relative_correction | number or null | | certified less nominal, over nominal
standards.mass.density_kg_m3 | number or null | kg/m^3 | density of the weights
standards.mass.mass_kind | text | | whether the masses are conventional or true
standards.length | table | | length of the arm
standards.length.certificate | text | | certificate of the length
standards.length.half_width_m | number or null | m | half width of the length
standards.torque | table | | reference torque sensor
standards.torque.certificate | text | | its certificate
standards.torque.identity | text | | type and serial number
standards.torque.relative_expanded_uncertainty | number or null | | relative, k = 2
standards.instrument | table | | instrument that reads the bridge
standards.instrument.certificate | text | | its certificate
standards.instrument.identity | text | | type and serial number
standards.instrument.relative_expanded_uncertainty | number or null | | relative, k = 2
standards.instrument.resolution_v | number or null | V | smallest step of its indication
identity.laboratory | text | | who calibrated
identity.place | text | | where
identity.customer | text | | for whom
identity.operator | text | | by whom
identity.drive_serial | text | | serial number of the drive
identity.flexspline_serial | text | | serial number of the flexspline
identity.bridge_ohm | number or null | ohm | resistance of the bridge
identity.cable | text | | cable to the bridge
identity.amplifier_serial | text | | serial number of the amplifier
identity.excitation_v | number or null | V | excitation of the bridge
identity.amplifier_gain | number or null | | gain of the amplifier
identity.gauge_factor | number or null | | gauge factor
identity.gear_ratio | number | | gear ratio of the drive
identity.rated_torque_nm | number | N m | rated torque of the drive
arm.length_m | number | m | distance of the weights from the axis
arm.latitude_deg | number or null | deg | latitude, for the gravity
arm.altitude_m | number or null | m | altitude, for the gravity
arm.gravity_formula | text or null | | formula of the local gravity
arm.gravity_m_s2 | number or null | m/s^2 | gravity where it is given
arm.gravity_half_width_m_s2 | number or null | m/s^2 | its half width
arm.thermal_expansion_per_k | number or null | 1/K | thermal expansion of the arm
arm.reference_temperature_c | number | degC | temperature at which the length holds
arm.temperature_half_width_k | number or null | K | half width of the arm's temperature
arm.tilt_rad | number or null | rad | tilt of the arm without load
arm.tilt_half_width_rad | number or null | rad | its half width
arm.torsional_stiffness_nm_per_rad | number or null | N m/rad | of what the arm turns with
arm.lost_motion_rad | number or null | rad | play that the arm turns through
arm.hang_offset_m | number or null | m | hang point above the axis of the arm
arm.hang_offset_half_width_m | number or null | m | its half width
arm.cant_half_width_rad | number or null | rad | half width of the axis' slope
arm.tare_kg | number or null | kg | pan and hook
arm.side_force_distance_m | number or null | m | of the load from the sensor's plane
arm.air_density_kg_m3 | number or null | kg/m^3 | density of the air
arm.air_density_half_width_kg_m3 | number or null | kg/m^3 | its half width
arm.loading | text | | one-sided or a pair of forces
sequence[].kind | text | | zero, preload, load or other event
sequence[].experiment | text | | experiment
sequence[].superseded | text | | why it does not count; empty where it does
sequence[].time_s | number or null | s | when
sequence[].torque_nm | number or null | N m | load
sequence[].reading_v | number or null | V | reading
readings[].experiment | text | | experiment
readings[].series | text | | up or down
readings[].kind | text | | load, zero or preload
readings[].torque_nm | number | N m | load
readings[].mass_kg | number or null | kg | mass that made it
readings[].reading_v | number | V | mean reading
readings[].reading_std_v | number or null | V | scatter of its samples
readings[].n_samples | integer or null | | samples averaged
readings[].time_s | number or null | s | when
readings[].temperature_c | number or null | degC | temperature
readings[].settle_s | number or null | s | time until it stood still
readings[].slope_v_s | number or null | V/s | drift while it was read
readings[].flags | list | | what is doubtful about it
readings[].excluded_at_s | list | s | samples left out of it
"""
"""Lines of ``key | type | unit | meaning``."""
