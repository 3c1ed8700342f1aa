"""A trace of raw readings under changing weights, brought in as loads."""

from __future__ import annotations

import bisect
import math
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hdbench.calibration.staircase.plateaus import Plateau, Staircase, find_plateaus
from hdbench.errors import DataError, UsageError
from hdbench.importing.convert import conversion, find_source
from hdbench.importing.recipe import Entry, Recipe
from hdbench.importing.registry import open_source
from hdbench.importing.source import Source
from hdbench.importing.trace import constant_value
from hdbench.profile.calibrating import Arm
from hdbench.records.loads import LoadReading, Loads, read_loads, write_loads
from hdbench.records.storage import publish, staged_path
from hdbench.records.trace import FloatArray

# what a staircase belongs to where nobody says otherwise, and the words that two keys take
_PLACE = {"experiment": "staircase", "position_rad": "0", "range": "full", "direction": "cw"}
_WORDS = {"range": ("low", "full"), "direction": ("cw", "ccw")}
# kg of each unit of load that is a mass; the avoirdupois pound is exact by definition (1959)
_KILOGRAM = {"kg": 1.0, "lb": 0.45359237}
# of a plateau, as they stand in its JSON
_SHOWN = ("start_s", "end_s", "mean", "std", "n", "slope_per_s", "autocorrelation")
# experiment, position in rad, range and direction
_Place = tuple[str, float, str, str]


@dataclass(frozen=True, slots=True)
class StaircasePlan:
    """What comes from where."""

    # where `time_s` and `reading_v` are, or the rate; `experiment`, `position_rad`, `range` and
    # `direction` have defaults
    recipe: Recipe
    # loads in the order in which they were hung
    loads: tuple[float, ...]
    # `nm`, `kg` or `lb`
    unit: str = "nm"
    # shortest plateau, s
    least_s: float = 3.0


@dataclass(frozen=True, slots=True)
class StaircaseReport:
    """What was found and written; it was read back before this was made."""

    # the new loads file
    out: Path
    # plateaus and excluded samples
    stairs: Staircase
    # load of each plateau, in `unit`
    loads: tuple[float, ...]
    # unit of the loads
    unit: str
    # samples of the trace
    n_samples: int

    def slope(self) -> float:
        """Return the slope of the readings on the loads, reading per unit of load."""
        means = np.array([p.mean for p in self.stairs.plateaus])
        offset = np.array(self.loads) - float(np.mean(self.loads))
        square = float(offset @ offset)
        return float(offset @ means) / square if square > 0.0 else 0.0

    def to_dict(self) -> dict[str, Any]:
        """Return the report as ``--json`` prints it."""
        return {
            "out": str(self.out),
            "kind": "staircase",
            "rows": len(self.stairs.plateaus),
            "n_samples": self.n_samples,
            "load_unit": self.unit,
            "reading_per_load": self.slope(),
            "noise_std": self.stairs.noise_std,
            "glitches_at_s": list(self.stairs.glitches_at_s),
            "stuck_at_s": list(self.stairs.stuck_at_s),
            "plateaus": [
                _plateau_dict(plateau, load)
                for plateau, load in zip(self.stairs.plateaus, self.loads, strict=True)
            ],
        }


def _plateau_dict(plateau: Plateau, load: float) -> dict[str, Any]:
    stuck = 0 if plateau.stuck_kept else len(plateau.stuck_at_s)
    return {
        "load": load,
        **{name: getattr(plateau, name) for name in _SHOWN},
        "n_excluded": len(plateau.glitches_at_s) + stuck,
        "stood_still": plateau.stuck_kept,
    }


def import_staircase(plan: StaircasePlan, file: Path, out: Path, arm: Arm) -> StaircaseReport:
    """Find the plateaus of a trace and write them as a loads file.

    Parameters
    ----------
    plan : StaircasePlan
        Columns, loads, place.
    file : Path
        Text file of raw readings.
    out : Path
        ``.csv`` file to write or replace; replaced only when the new content was read back.
    arm : Arm
        Arm of the bench, for loads that are masses.

    Returns
    -------
    StaircaseReport

    Raises
    ------
    UsageError
        If the plan does not fit the file.
    DataError
        If the file is damaged, or there are not as many plateaus as loads.
    StorageError
        If the disk is full or failed; an old file at `out` is then untouched.
    """
    file, out = Path(file), Path(out)
    if out.resolve() == file.resolve():
        raise UsageError(f"{out} is the input", where="--out", fix="name a new file")
    recipe, place = plan.recipe, _place(plan.recipe.entries("set"))
    maps = {m.target: m.text for m in recipe.entries("map")}
    with closing(open_source(file, recipe)) as source:
        reading = _reading(source, maps)
        time_s = _time(source, maps, len(reading), recipe.rate_hz)
    stairs = find_plateaus(time_s, reading, plan.least_s)
    loads = _staircase_loads(stairs, plan, place, arm, str(file))
    staged = staged_path(out)
    try:
        write_loads(staged, loads)
        read_loads(staged, arm)
        publish(staged, out)
    finally:
        staged.unlink(missing_ok=True)
    return StaircaseReport(out, stairs, plan.loads, plan.unit, len(reading))


def _place(constants: Sequence[Entry]) -> _Place:
    given = dict(_PLACE)
    for entry in constants:
        if entry.target not in _PLACE:
            raise UsageError(
                f"--set {entry.target} has no meaning for a staircase",
                where="--set",
                fix=f"set one of {', '.join(_PLACE)}",
            )
        allowed = _WORDS.get(entry.target, (entry.text,))
        if entry.text not in allowed:
            raise UsageError(
                f"{entry.target} is {entry.text!r:.40}",
                where="--set",
                fix=f"needed: {' or '.join(allowed)}",
            )
        given[entry.target] = entry.text
    angle_rad = constant_value("position_rad", given["position_rad"])
    return given["experiment"], angle_rad, given["range"], given["direction"]


def _time(source: Source, maps: Mapping[str, str], rows: int, rate_hz: float | None) -> FloatArray:
    if rate_hz is not None:
        return np.asarray(np.arange(rows) / rate_hz)
    if "time_s" not in maps:
        raise UsageError(
            "no time for the readings", where="--time", fix="give --time COLUMN or --rate HZ"
        )
    values = _column(source, "time_s", maps["time_s"], "--time")
    missing = np.flatnonzero(~np.isfinite(values))
    back = np.flatnonzero(~(np.diff(values) > 0.0)) + 1 if not len(missing) else missing
    if len(back):
        raise DataError(
            "the time does not rise; needed: a time in every row, strictly increasing",
            where=source.place(int(back[0])),
            fix="take the row out, or use --rate",
        )
    return np.asarray(values - values[0])


def _reading(source: Source, maps: Mapping[str, str]) -> FloatArray:
    if "reading_v" not in maps:
        raise UsageError(
            "no readings", where="--map", fix="give --map reading_v=COLUMN, by name or number"
        )
    return _column(source, "reading_v", maps["reading_v"], "--map")


def _column(source: Source, target: str, text: str, option: str) -> FloatArray:
    """Return a column as numbers, NaN where a cell is empty."""
    column = find_source(source, text, option)
    done = conversion(target, source, column, turn=True, given=text)
    parts: list[FloatArray] = []
    for piece in source.read([column.channel.name]):
        parts.append(done.piece(piece[column.channel.name], sum(map(len, parts))))
    return done.whole(np.concatenate(parts)) if parts else np.empty(0)


def _staircase_loads(
    stairs: Staircase, plan: StaircasePlan, place: _Place, arm: Arm, source: str
) -> Loads:
    """Give every plateau its load."""
    found, loads = stairs.plateaus, plan.loads
    _check(found, loads, source)
    top = max(range(len(loads)), key=lambda k: loads[k])
    sign = 1.0 if place[3] == "cw" else -1.0
    readings = []
    for k, (plateau, load) in enumerate(zip(found, loads, strict=True)):
        mass = None if plan.unit == "nm" else load * _KILOGRAM[plan.unit]
        torque = load if mass is None else mass * arm.gravity_m_s2 * arm.length_m
        readings.append(
            LoadReading(
                *place,
                "up" if k <= top else "down",
                sign * torque,
                plateau.mean,
                mass_kg=mass,
                reading_std_v=plateau.std,
                n_samples=plateau.n,
                time_s=(plateau.start_s + plateau.end_s) / 2.0,
            )
        )
    return Loads(tuple(readings), source, {}, _optional_columns(stairs))


def _check(found: Sequence[Plateau], loads: Sequence[float], source: str) -> None:
    for k, load in enumerate(loads):
        if not (math.isfinite(load) and load >= 0.0):
            raise DataError(
                f"load {k + 1} is {load!r}; needed: a finite number of at least 0",
                where="--loads",
                fix="give loads without sign; the direction gives it",
            )
    if len(found) != len(loads):
        listed = "; ".join(f"{p.start_s:.1f} to {p.end_s:.1f} s at {p.mean:g}" for p in found[:20])
        raise DataError(
            f"found {len(found)} plateaus for {len(loads)} loads ({listed or 'none'})",
            where=source,
            fix="give one load for each plateau with --loads, or another --least-s",
        )


def _optional_columns(stairs: Staircase) -> dict[str, tuple[str, ...]]:
    """Return the optional columns; an excluded sample belongs to the plateau that it ends in."""
    found = stairs.plateaus
    glitches, stuck = _shared(stairs.glitches_at_s, found), _shared(stairs.stuck_at_s, found)
    excluded = [
        sorted(a) if plateau.stuck_kept else sorted((*a, *b))
        for a, b, plateau in zip(glitches, stuck, found, strict=True)
    ]
    flags = [
        ";".join(name for name, times in (("glitches", a), ("stuck", b)) if times)
        for a, b in zip(glitches, stuck, strict=True)
    ]
    return {
        "slope_v_s": tuple(repr(p.slope_per_s) for p in found),
        "autocorrelation": tuple(repr(p.autocorrelation) for p in found),
        "flags": tuple(flags),
        "n_excluded": tuple(str(len(times)) for times in excluded),
        "excluded_at_s": tuple(";".join(f"{t:.9g}" for t in times) for times in excluded),
    }


def _shared(times: Sequence[float], found: Sequence[Plateau]) -> list[list[float]]:
    """Share times out among plateaus: one on the way to a plateau is that plateau's."""
    ends = [p.end_s for p in found[:-1]]
    out: list[list[float]] = [[] for _ in found]
    for time in times:
        out[bisect.bisect_left(ends, time)].append(time)
    return out
