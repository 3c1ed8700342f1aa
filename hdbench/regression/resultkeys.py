"""Keys of every kind of result, with type, unit and meaning: what the reference page is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["KINDS", "RESULT_KEYS", "ResultKey", "keys_of", "type_of"]

KINDS = ("calibration", "misalignment", "ripple", "diagnosis", "filter")


@dataclass(frozen=True, slots=True)
class ResultKey:
    """One key of a result.

    Parameters
    ----------
    kinds : tuple of str
        Kinds of result that hold it.
    key : str
        Its name at the top, or ``name[].inner`` of a list's entries, or ``name.inner``.
    type : str
        ``text``, ``number``, ``integer``, ``true or false``, ``list``, ``table``, or ``uncertain``
        (an object with value, std and dof); ``or null`` behind it where there may be none.
    unit : str
        Unit of a number; empty for anything else and for ratios.
    meaning : str
        One line.
    """

    kinds: tuple[str, ...]
    key: str
    type: str
    unit: str
    meaning: str


def type_of(value: Any) -> str:
    """Return the type of a JSON value in the words of the table.

    Parameters
    ----------
    value : object
        What JSON can hold.

    Returns
    -------
    str
    """
    if value is None:
        return "null"
    if isinstance(value, Mapping):
        return "uncertain" if {"value", "std"} <= set(value) else "table"
    names = {bool: "true or false", int: "integer", float: "number", str: "text", list: "list"}
    return names[type(value)]


def _rows(kinds: str, table: str) -> tuple[ResultKey, ...]:
    """Read lines of ``key | type | unit | meaning``."""
    rows = (tuple(cell.strip() for cell in line.split("|")) for line in table.strip().splitlines())
    names = KINDS if kinds == "all" else tuple(kinds.split())
    return tuple(ResultKey(names, key, kind, unit, text) for key, kind, unit, text in rows)


_CALIBRATION = """
title | text | | name of the result for a person
gain_nm_per_v | uncertain | N m/V | plain mean of the experiments' gains
gain_basis | text | | which scatter the standard uncertainty of the gain comes from
gain_basis_reason | text | | why that one
consistency | number | | standard deviation over mean of the experiments' gains
consistency_interval | list | | its 95 % interval, lower and upper end
consistency_interval_positions | list | | the same where positions, not experiments, are independent
consistency_interval_vangel | list | | the same by Vangel's method
max_consistency | number | | limit of the profile for the consistency
n_experiments | integer | | experiments, that is fitted lines
accepted | true or false | | whether every test of the acceptance passed
acceptance | table | | decision rule, statement and tests with value and limit
experiments | list | | one entry per fitted line
experiments[].id | text | | name of the experiment in the loads file
experiments[].position_rad | number | rad | flexspline position
experiments[].direction | text | | cw or ccw
experiments[].range | text | | low or full
experiments[].gain_nm_per_v | number | N m/V | slope of torque on voltage
experiments[].intercept_nm | number | N m | torque at 0 V
experiments[].residual_rms_nm | number | N m | scatter about the line
experiments[].n | integer | | readings
method | text | | method of the metrological evaluation
steps | list | | load steps of the metrological evaluation, with the parts of their uncertainty
steps[].torque_nm | number | N m | applied torque
steps[].deflection_v | number | V | mean reading less the zero
class | number or null | | class of the sensor, per cent; none where a criterion is not met
class_reason | text | | what decides the class
groups | list | | series of one direction, range and loading taken together
uncertainty | table | | of the gain: mean of positions, any one position, and naive
positions | table | | analysis of variance between and within positions
mixed_model | table | | gain with positions as a random effect
direction | table | | difference between cw and ccw
direction_effects | table | | the same for every effect
ranges | table | | difference between low and full range
consensus | table | | mean weighted by the experiments' own uncertainties
hysteresis | table | | of loading against unloading
outliers | list | | readings that lie far off their line
torque | table | | what the applied torque's uncertainty is made of
side_force | table or null | | effect of the side force of an arm
budget | list | | contributions to the uncertainty of the gain
experiment_steps | list | | steps of every experiment
monte_carlo | table | | the budget by random draws
course | table | | the readings over time
shunt | table or null | | shunt calibration before and after
deviations | list | | how this calibration differs from the standard procedure
standards | table | | weights and length standards used
identity | table | | drive, sensor and amplifier
arm | table or null | | arm of the profile
validity_days | number | d | how long the calibration may be used
average_s | number | s | how long a reading was averaged
sequence | list | | order of the steps
readings | list | | every reading
"""
_MISALIGNMENT = """
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
_RIPPLE = """
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
_DYNAMIC = """
ripple | list | | orders of the motor, amplitude each
lines | list | | further orders that stand out
tones | list | | frequencies that stand out
false_alarm_level | number | | false-alarm probability of lines and tones
residual_rms_nm | number | N m | what is left after the fit
noise | table | | noise model of the residual
torque_scale | table | | gain that scaled the torque, and where it is from
"""
_DIAGNOSIS = """
verdict | text | | nothing-found, named, unexplained, named-and-unexplained, data-bad or cannot-tell
reason | text | | why no more can be said; may be empty
causes | list | | causes that matter
causes[].name | text | | name in the catalogue
causes[].group | list | | names that these data cannot tell from it
causes[].rivals | list | | names within 3 nats
causes[].parameters | table | | value, std and unit of each parameter
causes[].evidence_nats | number | nat | log of the evidence for the name against no effect
causes[].probability | number or null | | share of the group in the evidence of all names
causes[].false_alarm_probability | number | | chance of this evidence where there is no such cause
causes[].gain | table | | held-out rms before and after, explained fraction with its interval
causes[].separating_experiment | text | | run that tells it from its rivals
minor | list | | significant causes below the materiality
unexplained | list | | structure that no cause explains: domain, location, extent, size_nm
minor_unexplained | list | | the same below the materiality
data_flags | list | | faults of the data: name, from_s, to_s, samples
minimum_detectable | list | | amplitude_nm that would have been found with 90 % probability
simulated | table | | terms and held-out rms of the model
extended | table | | terms and held-out rms of the extended model
model_file | text or null | | the extended model
settings | table | | what the diagnosis ran with
input | text | | file that was diagnosed
input_sha256 | text | | its SHA-256
torque_scale | table or null | | gain that scaled the torque, and where it is from
filter_gain | table or null | | what the extended model spares the filter
separating_run | table or null | | plan file of the run that settles what is open
"""
_FILTER = """
filter_name | text | | model that filtered
n_samples | integer | | samples
n_present | integer | | samples with a torque
torque_filtered_rms_nm | number | N m | rms of the filtered torque
torque_filtered_min_nm | number | N m | its smallest value
torque_filtered_max_nm | number | N m | its largest value
samples_nm | list | N m | filtered torque at evenly spread samples
sha256 | text | | digest of all filtered samples
"""
_ALL = """
schema | text | | hdbench/KIND/1
"""
_RUNS = """
hdbench_version | text | | version that wrote it
profile | table | | name and SHA-256 of the profile
"""
_EVALUATED = """
flags | list | | what the data show: name, samples, detail
notes | list | | what a person should know
n_samples | integer | | samples or readings used
run | text | | run that it belongs to
doubts | list | | reasons to doubt the data
"""

RESULT_KEYS: tuple[ResultKey, ...] = (
    *_rows("all", _ALL),
    *_rows("calibration misalignment ripple diagnosis", _RUNS),
    *_rows("calibration", _CALIBRATION),
    *_rows("misalignment", _MISALIGNMENT),
    *_rows("ripple", _RIPPLE),
    *_rows("misalignment ripple", _DYNAMIC),
    *_rows("calibration misalignment ripple", _EVALUATED),
    *_rows("diagnosis", _DIAGNOSIS),
    *_rows("filter", _FILTER),
)
"""Every key at the top of a result, and of lists those that scripts rely on."""


def keys_of(kind: str) -> dict[str, ResultKey]:
    """Return the keys of one kind of result, by name.

    Parameters
    ----------
    kind : str
        One of `KINDS`.

    Returns
    -------
    dict
    """
    found: dict[str, ResultKey] = {}
    for row in RESULT_KEYS:
        if kind in row.kinds:
            found.setdefault(row.key, row)
    return found
