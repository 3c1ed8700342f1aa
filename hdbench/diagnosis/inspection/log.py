"""Log under inspection: a trace, or a file of another program as it is."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from hdbench.errors import DataError
from hdbench.importing.convert import UNSTATED
from hdbench.importing.listing import list_channels, read_numbers
from hdbench.importing.proposal import is_measured, is_unit, proposed_mapping, time_candidate
from hdbench.importing.recipe import Recipe
from hdbench.importing.registry import open_source
from hdbench.importing.source import Channel
from hdbench.importing.units import target_unit, unit_scale
from hdbench.records import Trace, read_trace
from hdbench.records.provenance import input_identity
from hdbench.records.trace import FloatArray
from hdbench.records.tracefile import TRACE_COLUMNS

# what a channel measures: columns of a trace, and units
KINDS = {
    "given": (("reference_v", "load_torque_nm", "torque_filtered_online_nm"), ()),
    "angle": (("motor_angle_rad", "encoder_count", "output_angle_rad"), ("rad",)),
    "velocity": (("motor_velocity_rad_s", "tacho_v"), ("rad/s",)),
    "effort": (("torque_nm", "torque_v", "motor_current_a"), ("N m", "A")),
    "slow": (("temperature_c",), ("degC",)),
}

# endings of a trace: a file of one of them may be one
_TRACES = (".csv", ".gz", ".parquet")


@dataclass(frozen=True, slots=True)
class Log:
    """Channels of one clock."""

    channels: Mapping[str, FloatArray]  # by the name that the file gives them; NaN where lost
    units: Mapping[str, str]  # empty where none is stated
    time_s: FloatArray | None  # stamps as they are; None where the file has none
    roles: Mapping[str, str]  # channel that plays the part of a column of a trace
    source: str  # where it came from
    stage: FloatArray | None = None  # of a plan at each row: between two no sample was due
    # channels that held signed numbers without their sign, and their bits; here with it
    signed: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()  # what is not looked at

    def __len__(self) -> int:
        return len(next(iter(self.channels.values()), ()))

    @classmethod
    def of_trace(cls, trace: Trace) -> Log:
        """Return the log that a trace is."""
        told = {n: v for n, v in trace.columns.items() if n not in ("time_s", "stage")}
        units = {name: target_unit(name) for name in told}
        roles = {name: name for name in told if name in TRACE_COLUMNS}
        stage = trace.columns.get("stage")
        return cls(told, units, trace.time_s, roles, trace.source, stage)

    def kind(self, name: str) -> str:
        """Return what a channel measures, by its part and its unit: a word of `KINDS`, or none."""
        if name not in self.roles.values() and not is_measured(name):
            return "given"
        for kind, (columns, wanted) in KINDS.items():
            if any(self.roles.get(column) == name for column in columns):
                return kind
            if any(is_unit(Channel(name, self.units.get(name, "")), unit) for unit in wanted):
                return kind
        return ""

    def role(self, name: str) -> FloatArray | None:
        """Return the channel that plays a part; None where none does."""
        return self.channels[self.roles[name]] if name in self.roles else None


def _with_origin(log: Log, path: Path) -> Log:
    """Return a trace without the unit of a torque that the imported file does not state."""
    imported = input_identity(path).get("imported", {}).get("columns", {})
    units = dict(log.units)
    for name in ("torque_nm", "torque_v"):
        if any(step.endswith(UNSTATED) for step in imported.get(name, ())):
            units[name] = ""
    return replace(log, units=units)


def read_log(path: Path, *, topic: str | None = None, joint: str | None = None) -> Log:
    """Read a trace, or a log of another program: the channels of the clock that has most of them.

    `topic` and `joint` choose channels. `DataError` for a damaged file or one without a number,
    `UsageError` where its reader is not installed or there is no such topic or joint.
    """
    path = Path(path)
    if path.suffix in _TRACES and path.is_file() and topic is None and joint is None:
        try:
            log = Log.of_trace(read_trace(path, require=()))
            if log.roles:
                return _with_origin(log, path)
        except DataError:
            pass  # a log of another program, or one whose stamps no trace may have
    recipe = Recipe(topic=topic, joint=joint)
    with closing(open_source(path, recipe)) as source:
        time = time_candidate(source.channels)
        facts = list_channels(source, None if time is None else time.name)
        numbers = [f.channel for f in facts if f.least is not None]
        signed = {f.channel.name: f.bits for f in facts if f.bits}
        if not numbers:
            raise DataError(
                "no channel holds a number; needed: at least one",
                where=str(path),
                fix="check that this is the right file",
            )
        roles = proposed_mapping(facts, recipe, source.channels).channels
        clocks = [c.clock for c in numbers if c.name in roles.values()] or [numbers[0].clock]
        clock = max(dict.fromkeys(clocks), key=clocks.count)
        own = [c for c in numbers if c.clock == clock]
        time = time_candidate(own)
        # values of one file, 160 MB: what they say of it, the rest says too
        most = 20_000_000 // len(own)
        values, _ = read_numbers(source, [c.name for c in own], most)
    time_s = None
    if time is not None:
        scale = unit_scale(time.unit, "s")
        # counted from the first: seconds since 1970 leave few digits for the steps
        stamps = values.pop(time.name)
        time_s = (stamps - stamps[0]) * float(scale if scale and not scale.is_nan() else 1)
    # a second stamp is no measurement
    values = {c.name: values[c.name] for c in own if c.name in values and not is_unit(c, "s")}
    for name, bits in signed.items():
        if name in values:
            high = values[name] >= 2.0 ** (bits - 1)
            values[name] = np.where(high, values[name] - 2.0**bits, values[name])
    others = sorted({c.clock for c in numbers} - {clock})
    notes = [f"channels of clock {name!r} are not looked at" for name in others[:20]]
    rows = len(next(iter(values.values()), ()))
    if rows >= most:
        notes.append(f"only the first {rows} rows are looked at")
    return Log(
        values,
        {c.name: c.unit for c in own if c.name in values},
        time_s,
        {target: name for target, name in roles.items() if name in values},
        str(path),
        signed={name: bits for name, bits in signed.items() if name in values},
        notes=tuple(notes),
    )
