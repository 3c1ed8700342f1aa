"""Channels of foreign files as one trace."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import numpy as np

from hdbench.errors import DataError, UsageError
from hdbench.importing.convert import Conversion, unlike_pace, zero_phase_velocity
from hdbench.importing.recipe import Recipe
from hdbench.importing.source import Column, Source, listed
from hdbench.records.trace import FloatArray, Trace
from hdbench.records.tracefile import write_trace

# a trace of more cells is read by no other command: some 1 GB of text
MOST_CELLS = 50_000_000
# samples of another clock further apart than this many of its steps are a gap
_GAP_STEPS = 3.5


@dataclass(frozen=True, slots=True)
class Part:
    """One file and what is taken from it."""

    source: Source
    # by our column; `time_s` is not there where the rate stands for it
    conversions: Mapping[str, Conversion]
    constants: Mapping[str, str]  # columns with one value


@dataclass(slots=True)
class _Read:
    """One file: times in s from its own start, and float channels."""

    source: Source
    start: Fraction
    time: FloatArray
    columns: dict[str, FloatArray]
    notes: list[str] = field(default_factory=list)


def _check_times(conversion: Conversion, time: FloatArray, row: int, last: float) -> None:
    """Refuse a missing time, one that repeats and one that goes back; `last` is the one before."""
    before = np.concatenate([[last], time[:-1]])
    wrong = np.flatnonzero(~(time > before))
    if not len(wrong):
        return
    k = int(wrong[0])
    where = conversion.source.place(row + k)
    fix = "take the row out, or use --rate if the time column is too coarse"
    if np.isnan(time[k]):
        what = "no time in this row; needed: one in every row"
        raise DataError(what, where=where, fix="give it a time")
    word = "repeats" if time[k] == before[k] else "goes back behind"
    what = (
        f"time {time[k]:.9g} s after the start {word} the one before, {before[k]:.9g} s; "
        "needed: strictly increasing"
    )
    raise DataError(what, where=where, fix=fix)


def _clock(
    source: Source, conversions: Sequence[Conversion], time: Conversion | None, keep_time: bool
) -> _Read:
    """Read the channels of one clock, with its times where they are in the file."""
    names = list(dict.fromkeys(c.column.channel.name for c in conversions))
    time_name = None if time is None else time.column.channel.name
    wanted = list(dict.fromkeys([*names, *([time_name] if time_name else [])]))
    start: Fraction | None = Fraction(0) if keep_time else None
    rows, last = next((c.rows for c in source.channels if c.name in wanted), None) or 0, -np.inf
    _check_size(source, rows, len(conversions))
    times = Column(rows if time else None)
    columns = {c.target: Column(rows) for c in conversions}
    exact = {c.column.channel.name for c in conversions if not c.as_it_is}
    source.rounded = frozenset(names) - exact - {time_name}
    rows = 0
    for piece in source.read(wanted):
        count = len(next(iter(piece.values())))
        if not count:
            continue
        if time is not None:
            found, start = time.seconds(piece[time.column.channel.name], rows, start)
            _check_times(time, found, rows, last)
            last = float(found[-1])
            times.add(found)
        for conversion in conversions:
            raw = piece[conversion.column.channel.name]
            columns[conversion.target].add(conversion.piece(raw, rows))
        rows += count
        _check_size(source, rows, len(conversions))
    if not rows:
        raise DataError("no data", where=str(source.path), fix="check the file, or record again")
    whole = {c.target: c.whole(columns[c.target].whole()) for c in conversions}
    for conversion in conversions:
        if not np.isfinite(whole[conversion.target]).any():
            raise DataError(
                f"channel {conversion.column.channel.name} holds no number in {rows} rows",
                where=str(source.path),
                fix=f"map another channel to {conversion.target}, or leave its --map out",
            )
    return _Read(source, start or Fraction(0), times.whole(), whole)


def _check_size(source: Source, rows: int, mapped: int) -> None:
    columns = mapped + 1
    if rows * columns > MOST_CELLS:
        raise DataError(
            f"more than {MOST_CELLS // columns} rows of {columns} columns",
            where=str(source.path),
            fix="map fewer columns, or split the file",
        )


def constant_value(name: str, text: str) -> float:
    """Return the number that a column is set to."""
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise UsageError(
            f"{name}={text!r:.40}; needed: a finite number", where="--set", fix="give a number"
        )
    return value


def no_time(source: Source) -> DataError:
    """Return the error of a log without a time."""
    return DataError(
        "no time column; needed: the time of every row, or the sample rate",
        where=str(source.path),
        fix="give the rate at which it was sampled by --rate HZ, or --time COLUMN",
    )


def _time_of(part: Part, clock: str) -> Conversion | None:
    """Return the time of a clock: the one that was named, else the file's own."""
    named = part.conversions.get("time_s")
    if named is not None and named.column.channel.clock == clock:
        return named
    return part.conversions.get(f"time_s of {clock}")


def _read(part: Part, recipe: Recipe) -> _Read:
    """Read one file: its clocks as one, and the columns with one value."""
    wanted = [c for name, c in part.conversions.items() if not name.startswith("time_s")]
    by_clock: dict[str, list[Conversion]] = {}
    for conversion in wanted:
        by_clock.setdefault(conversion.column.channel.clock, []).append(conversion)
    if recipe.rate_hz is not None:
        if len(by_clock) > 1:
            raise UsageError(
                f"channels of {len(by_clock)} clocks; needed for --rate: channels of one",
                where=f"{part.source.path}, --rate",
                fix="map channels of one length and group, or a time for each clock",
            )
        read = _clock(part.source, wanted, None, recipe.keep_time)
        rate = Fraction(recipe.rate_hz)
        rows = len(next(iter(read.columns.values())))
        read.time = np.array([float(Fraction(k) / rate) for k in range(rows)])
    else:
        times = {clock: _time_of(part, clock) for clock in by_clock}
        if any(time is None for time in times.values()):
            raise no_time(part.source)
        reads = {c: _clock(part.source, by_clock[c], times[c], recipe.keep_time) for c in by_clock}
        main = _main_clock(part, wanted)
        read = reads.pop(main)
        _put_on_clock(read, main, reads, keep_time=recipe.keep_time)
    for name, text in part.constants.items():
        read.columns[name] = np.full(len(read.time), constant_value(name, text))
    return read


def _put_on_clock(read: _Read, main: str, others: Mapping[str, _Read], *, keep_time: bool) -> None:
    """Put the channels of other clocks on the main one, as far as all of them overlap."""
    time = read.time
    kept = np.ones(len(time), dtype=bool)
    for clock, other in others.items():
        moved = other.time + float(other.start - read.start)
        kept &= (time >= moved[0]) & (time <= moved[-1])
        read.columns |= _on_clock(time, moved, other.columns)
        read.notes.append(
            f"{', '.join(other.columns)}: from clock {clock!r} ({_rate(other.time):.6g} Hz) put on "
            f"that of {main!r} ({_rate(time):.6g} Hz) by linear interpolation, not over its gaps "
            "or ends"
        )
    if not kept.any():
        what = "the clocks have no time in common; needed: an overlap"
        raise DataError(what, where=str(read.source.path), fix="map channels of one clock")
    if not kept.all():
        first = int(np.flatnonzero(kept)[0])
        read.notes.append(f"{int((~kept).sum())} rows outside the overlap of the clocks left out")
        moved_by = 0.0 if keep_time else float(time[first])
        read.start += Fraction(moved_by)
        read.time = time[kept] - moved_by
        read.columns = {name: values[kept] for name, values in read.columns.items()}


def _main_clock(part: Part, wanted: Sequence[Conversion]) -> str:
    """Return the clock that all others are put on: that of the time named, else of the torque."""
    clocks = {c.target: c.column.channel.clock for c in wanted}
    if not clocks:
        return ""
    named = part.conversions.get("time_s")
    if named is not None and named.column.channel.clock in clocks.values():
        return named.column.channel.clock
    order = ("torque_nm", "torque_v", "motor_current_a", *clocks)
    return next(clocks[name] for name in order if name in clocks)


def _check_torque(part: Part, recipe: Recipe) -> None:
    there = {*part.conversions, *part.constants}
    if recipe.torque_constant_nm_per_a is None and not {"torque_nm", "torque_v"} & there:
        raise DataError(
            f"no torque is mapped; found: {listed(c.name for c in part.source.channels)}",
            where=str(part.source.path),
            fix="give --map torque_nm=COLUMN, or --map motor_current_a=COLUMN "
            "with --torque-constant N_M_PER_A",
        )


def _rate(time: FloatArray) -> float:
    return float(1.0 / np.median(np.diff(time))) if len(time) > 1 else 0.0


def _on_clock(
    time: FloatArray, other: FloatArray, values: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    gap = _GAP_STEPS * float(np.median(np.diff(other))) if len(other) > 1 else 0.0
    result = {}
    for name, channel in values.items():
        there = np.isfinite(channel)
        at, known = other[there], channel[there]
        new = np.interp(time, at, known, left=np.nan, right=np.nan)
        after = np.clip(np.searchsorted(at, time), 1, max(len(at) - 1, 1))
        if len(at) > 1:
            on_sample = np.isin(time, at)
            new[(at[after] - at[after - 1] > gap) & ~on_sample] = np.nan
        result[name] = new
    return result


def _in_order(reads: Sequence[_Read], rate_hz: float | None) -> list[_Read]:
    """Return files as they follow one another; with a rate, count the time on in their order."""
    if rate_hz is not None:
        start = Fraction(0)
        for read in reads:
            read.start = start
            start += len(read.time) / Fraction(rate_hz)
        return list(reads)
    ordered = sorted(reads, key=lambda read: read.start + Fraction(float(read.time[0])))
    for before, after in itertools.pairwise(ordered):
        first = float(after.start + Fraction(float(after.time[0])))
        end = float(before.start + Fraction(float(before.time[-1])))
        if not first > end:
            raise DataError(
                f"starts at {first!r} s, before {before.source.path} ends at {end!r} s; "
                "needed: files that follow one another",
                where=after.source.place(0),
                fix="import them one by one, or shift one by --map N:time_s=COLUMN+OFFSET",
            )
    return ordered


def write_joined(
    path: Path, parts: Sequence[Part], recipe: Recipe
) -> tuple[Fraction | None, dict[str, list[str]], list[str]]:
    """Join channels of foreign files into one trace, and write it.

    Returns the time that became 0, s (None where the time was kept), what was done for each column
    step by step, and what a person should know.
    """
    for part in parts:
        _check_torque(part, recipe)
    reads = _in_order([_read(part, recipe) for part in parts], recipe.rate_hz)
    for read in reads:
        odd = sorted(set(read.columns) ^ set(reads[0].columns))
        if odd:
            what = f"column {odd[0]!r} is not in all files"
            raise UsageError(what, where="--map", fix="map it in each file")
    start, where = reads[0].start, str(reads[0].source.path)
    shifts = [float(read.start - start) for read in reads]
    times = [
        read.time + shift if shift else read.time for read, shift in zip(reads, shifts, strict=True)
    ]
    time = np.concatenate(times)
    if len(time) < 2:
        raise DataError(
            "1 row; needed: at least 2 to be a trace",
            where=where,
            fix="record again, or check that this is the right file",
        )
    if not (np.diff(time) > 0.0).all():
        raise DataError(
            "times fall together when rounded to doubles",
            where=where,
            fix="leave --keep-time out, so that the time starts at 0",
        )
    columns = {"time_s": time}
    for name in reads[0].columns:
        columns[name] = np.concatenate([read.columns[name] for read in reads])
    done = _done(parts[0], recipe)
    _derive(columns, done, recipe, where)
    notes = [note for read in reads for note in read.notes]
    notes += _doubts(columns)
    write_trace(path, Trace(columns, where))
    return None if recipe.keep_time else start, done, notes


def _done(part: Part, recipe: Recipe) -> dict[str, list[str]]:
    """Return what was done for each column, step by step."""
    named = part.conversions
    done = {name: c.told() for name, c in named.items() if not name.startswith("time_s of ")}
    own = _time_of(part, _main_clock(part, [named[n] for n in done if n != "time_s"]))
    if own is not None:
        done["time_s"] = own.told()
    done |= {name: [f"every row is {text}"] for name, text in part.constants.items()}
    if recipe.rate_hz is not None:
        done["time_s"] = [f"counted at {recipe.rate_hz!r} Hz, as given by --rate"]
    return done


def _derive(
    columns: dict[str, FloatArray], done: dict[str, list[str]], recipe: Recipe, where: str
) -> None:
    """Add the columns that follow from others, and what was done for each."""
    constant, cutoff = recipe.torque_constant_nm_per_a, recipe.velocity_from_angle_hz
    for given, needed, made, option in (
        (constant, "motor_current_a", "torque_nm", "--torque-constant"),
        (cutoff, "motor_angle_rad", "motor_velocity_rad_s", "--velocity-from-angle"),
    ):
        if given is not None and needed not in columns:
            fix = f"give --map {needed}=COLUMN"
            raise UsageError(f"no column {needed} to take {made} from", where=option, fix=fix)
        if given is not None and made in columns:
            fix = f"leave {option} or the --map of {made} out"
            raise UsageError(f"{made} is mapped and derived", where=option, fix=fix)
    if constant is not None:
        columns["torque_nm"] = columns["motor_current_a"] * constant
        done["torque_nm"] = [f"motor_current_a times {constant!r} N m/A"]
    if cutoff is not None:
        columns["motor_velocity_rad_s"], done["motor_velocity_rad_s"] = zero_phase_velocity(
            columns["time_s"], columns["motor_angle_rad"], cutoff, where
        )


def _doubts(columns: Mapping[str, FloatArray]) -> Iterator[str]:
    """Yield the rate that the times mean, and where angle and velocity tell of unlike motions."""
    time = columns["time_s"]
    yield f"{time[-1] - time[0]:.6g} s at {_rate(time):.5g} Hz"
    if not {"motor_angle_rad", "motor_velocity_rad_s"} <= columns.keys():
        return
    ratio = unlike_pace(time, columns["motor_angle_rad"], columns["motor_velocity_rad_s"])
    if ratio is not None:
        yield (
            f"doubtful: motor_velocity_rad_s is {ratio:.4g} times the rate of motor_angle_rad: "
            "one of them has another unit, side of the gear or sign"
        )
