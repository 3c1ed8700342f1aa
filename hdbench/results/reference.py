"""Keys of results for the reference page and the JSON schemas, made of the result types."""

from __future__ import annotations

import types
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Union, get_args, get_origin, get_type_hints

from pydantic import TypeAdapter

from hdbench.records.loads import SequenceEntry
from hdbench.records.quantity import Quantity, TorqueScale
from hdbench.results.calibration import CalibrationResult
from hdbench.results.dynamic import FilteredTrace, MisalignmentResult, RippleResult
from hdbench.results.parts import Part

_TYPES: Mapping[str, type[Part]] = {
    "calibration": CalibrationResult,
    "misalignment": MisalignmentResult,
    "ripple": RippleResult,
    "filter": FilteredTrace,
}
KINDS = ("calibration", "misalignment", "ripple", "diagnosis", "filter")
_WORDS = {str: "text", float: "number", int: "integer", bool: "true or false"}
# parts of records that results hold as they are, and the result that is not a type yet:
# key, type, unit, meaning
_TABLES: Mapping[object, str] = {
    TorqueScale: """
gain_nm_per_v | uncertain | N m/V | gain
source | text | | where it is from
sha256 | text or null | | SHA-256 of the calibration
calibrated_utc | text or null | | when that was made
age_days | number or null | d | its age at the run
expired | true or false | | whether it was too old
age_words | text | | the same in words
""",
    SequenceEntry: """
kind | text | | zero, preload, load or other event
experiment | text | | experiment
superseded | text | | why it does not count; empty where it does
time_s | number or null | s | when
torque_nm | number or null | N m | load
reading_v | number or null | V | reading
""",
    "diagnosis": """
schema | text | | hdbench/KIND/1
hdbench_version | text | | version that wrote it
profile | table | | name and SHA-256 of the profile
profile.name | text | | name of the profile
profile.sha256 | text | | SHA-256 of its text
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
""",
}


@dataclass(frozen=True, slots=True)
class ResultKey:
    """One key of a result.

    Parameters
    ----------
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

    key: str
    type: str
    unit: str
    meaning: str


def keys_of(kind: str) -> dict[str, ResultKey]:
    """Return the keys of one kind of result, by name."""
    found = _of_type(_TYPES[kind], "") if kind in _TYPES else _of_table(_TABLES[kind], "")
    return {row.key: row for row in found}


def json_schema(kind: str) -> dict[str, Any]:
    """Return the JSON schema of ``hdbench/<kind>/1``."""
    return TypeAdapter(_TYPES[kind]).json_schema()


def _of_table(table: str, prefix: str) -> Iterator[ResultKey]:
    for line in table.strip().splitlines():
        name, kind, unit, meaning = (cell.strip() for cell in line.split("|"))
        yield ResultKey(f"{prefix}{name}", kind, unit, meaning)


def _of_type(part: type[Any], prefix: str) -> Iterator[ResultKey]:
    hints = get_type_hints(part)
    for name, field in part.__pydantic_fields__.items():
        place = f"{prefix}{field.alias or name}"
        words, inside, inner = _described(hints[name])
        if field.exclude_if is not None:
            words = words.replace("null", "absent")
        unit = (field.json_schema_extra or {}).get("unit", "")
        yield ResultKey(place, words, unit, field.description or "")
        if inner in _TABLES:
            yield from _of_table(_TABLES[inner], f"{place}{inside}")
        elif isinstance(inner, type) and issubclass(inner, Part):
            yield from _of_type(inner, f"{place}{inside}")


def _described(hint: Any) -> tuple[str, str, Any]:
    """Return a type in words, what its path goes on with, and what stands inside."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        words, inside, part = _described(next(x for x in inner if x is not type(None)))
        return f"{words} or null", inside, part
    if origin is tuple:
        return "list", "[].", inner[0]
    if origin is dict:
        # entries stand under names of their own, such as that of the experiment
        return "table", ".ID.", inner[1]
    if hint is Quantity:
        return "uncertain", "", None
    return _WORDS.get(hint, "table"), ".", hint
