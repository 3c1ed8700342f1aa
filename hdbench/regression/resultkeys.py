"""Keys of every kind of result, with type, unit and meaning: what the reference page is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hdbench.regression.calibrationkeys import CALIBRATION_PARTS
from hdbench.regression.dynamickeys import (
    DYNAMIC,
    DYNAMIC_PARTS,
    MISALIGNMENT,
    MISALIGNMENT_PARTS,
    RIPPLE,
    RIPPLE_PARTS,
)
from hdbench.regression.recordkeys import RECORD_PARTS

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
        (an object with value, std and dof); ``or null`` behind it where there may be none, ``or
        absent`` where the key may be left out.
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
    """Return the type of a JSON value in the words of the table."""
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
causes[].records | list or absent | | of records together: what each says of the cause
causes[].disagreement | table or absent | | records that differ about it, and the chance of that
minor | list | | significant causes below the materiality
unexplained | list | | structure that no cause explains
unexplained[].domain | text | | axis on which it stands
unexplained[].second_domain | text or null | | other axis where it depends on two
unexplained[].location | number | | its centre
unexplained[].extent | list | | its ends
unexplained[].unit | text | | unit of place and ends
unexplained[].size_nm | number | N m | its size
unexplained[].share_of_variance | number | | share of the baseline's residual variance
minor_unexplained | list | | the same below the materiality
data_flags | list | | faults of the data: name, from_s, to_s, samples
left_out | list | | samples that took no part
left_out[].reason | text | | why, in a few words
left_out[].samples | integer | | how many
left_out[].share | number | | of all samples
rest | table or null | | what the extended model leaves above the noise
rest.heldout_rms_nm | number | N m | what the extended model leaves on held-out blocks
rest.noise_rms_nm | number | N m | what the noise alone would leave
rest.told | list | | entries of unexplained that account for the difference
testable | list | | each name of the catalogue: can this record show it
testable[].name | text | | name in the catalogue
testable[].testable | true or false | | whether an effect of this name would be seen
testable[].because | text | | why not, or what of it not; may be empty
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
part | table or null | | what was diagnosed of a longer record: from_s, to_s, samples, cut
records | list | | records that were diagnosed together; empty for one alone
records[].record | text | | its name
records[].left_out | text or null | | why it took no part
records[].samples | integer | | samples used
records[].rate_hz | number | Hz | sampling rate
records[].simulated | table | | heldout_rms_nm of its baseline alone
records[].extended | table | | heldout_rms_nm of the extended model
records[].noise_rms_nm | number or null | N m | its noise
records[].disagrees | list | | causes about which it differs from the other records
records[].settings | table | | its noise, torque channel and form errors
records[].input | text | | file
records[].input_sha256 | text | | its SHA-256
records[].torque_scale | table | | gain that scaled its torque, and where it is from
records[].part | table or null | | what was diagnosed of a longer record
records[].inspection | table | | what its log can tell, as `hdbench inspect` gives it
inspection | table or null | | what the log can tell, as `hdbench inspect` gives it
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
profile.name | text | | name of the profile
profile.sha256 | text | | SHA-256 of its text
"""
_EVALUATED = """
flags | list | | what the data show
flags[].name | text | | what was found
flags[].samples | integer | | samples that it concerns
flags[].detail | text | | the same in words
notes | list | | what a person should know
notes[].name | text | | what was found
notes[].samples | integer | | samples that it concerns
notes[].detail | text | | the same in words
n_samples | integer | | samples or readings used
run | text | | run that it belongs to
doubts | list | | reasons to doubt the data
"""

RESULT_KEYS: tuple[ResultKey, ...] = (
    *_rows("all", _ALL),
    *_rows("calibration misalignment ripple diagnosis", _RUNS),
    *_rows("calibration", _CALIBRATION),
    *_rows("misalignment", MISALIGNMENT),
    *_rows("ripple", RIPPLE),
    *_rows("misalignment ripple", DYNAMIC),
    *_rows("calibration", f"{CALIBRATION_PARTS}\n{RECORD_PARTS.strip()}"),
    *_rows("misalignment", MISALIGNMENT_PARTS),
    *_rows("ripple", RIPPLE_PARTS),
    *_rows("misalignment ripple", DYNAMIC_PARTS),
    *_rows("calibration misalignment ripple", _EVALUATED),
    *_rows("diagnosis", _DIAGNOSIS),
    *_rows("filter", _FILTER),
)
"""Every key of a calibration, misalignment or ripple result; of the others those of the top."""


def keys_of(kind: str) -> dict[str, ResultKey]:
    """Return the keys of one kind of result, by name."""
    found: dict[str, ResultKey] = {}
    for row in RESULT_KEYS:
        if kind in row.kinds:
            found.setdefault(row.key, row)
    return found
