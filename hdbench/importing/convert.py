"""Declared conversions of foreign channels, and columns that follow from others."""

from __future__ import annotations

import difflib
import math
import re
from dataclasses import dataclass, replace
from decimal import Decimal, InvalidOperation
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.errors import DataError, HdbenchError, UsageError
from hdbench.importing.layout import MISSING, stamp_seconds
from hdbench.importing.source import Channel, Source, find_channel, listed
from hdbench.importing.units import known_unit, target_unit, unit_scale
from hdbench.records.csvtext import plain_matrix
from hdbench.records.trace import FloatArray

# what may be declared behind a channel beside its unit
WORDS = ("int8", "int16", "int32", "wrapped", "output", "motor", "zero")
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?"
_LINEAR = re.compile(
    rf"(?P<name>.+?)(?:(?P<sign>[*/])(?P<scale>-?{_NUMBER}))?(?P<offset>[+-]{_NUMBER})?"
)
_WIDTHS = {"int8": 8, "int16": 16, "int32": 32}
# what turns with the shaft: on the joint side these are smaller by the gear ratio
TURNING = ("motor_angle_rad", "motor_velocity_rad_s")
TURN_RAD = 2.0 * np.pi
UNSTATED = "the file states no unit"
_ORDER = 4
# the derivative is filtered on an even grid; times that differ less from it are even enough
_EVEN_SHARE = 0.01
# ratios of a velocity to the rate of an angle: of fewer, or where the middle half scatters more,
# nothing can be told; of one shaft in one unit the median is nearer to 1, for other units and
# gears are off by far more
_LEAST_PAIRS, _MOST_SCATTER, _ALIKE = 20, 0.2, 0.1


@dataclass(frozen=True, slots=True)
class SourceColumn:
    """A channel of a foreign file and what turns its numbers into ours."""

    channel: Channel
    # value = number * scale + offset
    scale: Decimal = Decimal(1)
    offset: Decimal = Decimal(0)
    # whether neither scale nor offset was given; a scale of 1 that was given is one
    plain: bool = True
    words: tuple[str, ...] = ()  # declared conversions, in the order of the text


def find_source(source: Source, text: str, option: str) -> SourceColumn:
    """Return the channel that `text` means; a channel's own name goes before arithmetic."""
    column = _linear(source, text, option)
    if column is not None:
        return column
    rest, *words = text.split("@")
    column = _linear(source, rest, option) if words else None
    if column is None:
        raise _no_channel(source, rest, option)
    for word in words:
        if word not in WORDS and not known_unit(word):
            raise UsageError(
                f"{word!r:.40} behind {rest!r:.60} is neither a unit nor a conversion",
                where=option,
                fix=f"give a unit such as deg, rpm, ms, mV, or one of {', '.join(WORDS)}",
            )
    return replace(column, words=tuple(words))


def _linear(source: Source, text: str, option: str) -> SourceColumn | None:
    exact = find_channel(source, text)
    if exact is not None:
        return SourceColumn(exact)
    match = _LINEAR.fullmatch(text)
    channel = None if match is None else find_channel(source, match["name"])
    if match is None or channel is None:
        return None
    scale = Decimal(match["scale"] or 1)
    if scale == 0:
        raise UsageError(f"scale 0 in {text!r:.80}", where=option, fix="give another scale")
    if match["sign"] == "/":
        scale = 1 / scale
    return SourceColumn(channel, scale, Decimal(match["offset"] or 0), plain=False)


def _no_channel(source: Source, text: str, option: str) -> HdbenchError:
    if any(note.startswith(f"{text} = ") for note in source.notes):
        return DataError(
            f"{text!r:.80} is a single number, 1 row; needed: at least 2",
            where=str(source.path),
            fix="record again, or check that this is the right file",
        )
    names = [channel.name for channel in source.channels]
    near = difflib.get_close_matches(text, names, n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    return UsageError(
        f"no column {text!r:.80} in {source.path}",
        where=option,
        fix=f"{hint}columns: {listed(names)}",
    )


@dataclass(frozen=True, slots=True)
class Conversion:
    """What is done to the numbers of one channel."""

    target: str
    source: Source
    column: SourceColumn  # the channel with its arithmetic
    unit: str = ""  # unit that the numbers were declared in; empty for ours
    factor: Decimal = Decimal(1)  # ours per declared unit
    bits: int = 0  # width of a two's complement that was stored without sign; 0 for none
    # whether whole turns are put back, and whether the first sample becomes 0
    wrapped: bool = False
    from_zero: bool = False
    ratio: float = 1.0  # gear ratio from the joint to the motor; 1 on the motor side

    @property
    def scale(self) -> Decimal:
        """Factor on the numbers of the file."""
        return self.column.scale * self.factor

    @property
    def offset(self) -> Decimal:
        """What is added after that."""
        return self.column.offset * self.factor

    def told(self) -> list[str]:
        """Return what is done, step by step, in the order in which it is done."""
        steps = [f"channel {self.column.channel.name!r}"]
        if self.bits:
            steps.append(f"unsigned {self.bits}-bit number read as two's complement")
        if not self.column.plain:
            steps.append(f"times {self.column.scale:.17g}, plus {self.column.offset:.17g}")
        ours = target_unit(self.target)
        if not self.unit and ours and not self.column.channel.name.endswith(self.target):
            steps.append(f"taken as {ours}: {UNSTATED}")
        if self.factor != 1:
            steps.append(f"{self.unit} to {ours}, times {self.factor:.17g}")
        if self.wrapped:
            steps.append("whole turns put back at jumps of more than half a turn")
        if self.ratio != 1.0:
            steps.append(f"joint side to motor side, times the gear ratio {self.ratio:.17g}")
        if self.from_zero:
            steps.append("starts at 0")
        return steps

    def piece(self, raw: NDArray[Any], row: int) -> FloatArray:
        """Convert a piece that begins at `row`; what needs the whole channel is left for later."""
        if raw.dtype == object:
            return self._cells(raw, row)
        if self.bits:
            raw = self._signed(raw, row)
        values = np.array(raw, dtype=np.float64)
        if self.scale != 1:
            values *= float(self.scale)
        if self.offset:
            values += float(self.offset)
        infinite = np.flatnonzero(np.isinf(values))
        if len(infinite):
            raise self._bad(row + int(infinite[0]), "an infinite number", "a finite number")
        return values

    def whole(self, values: FloatArray) -> FloatArray:
        """Finish the whole channel."""
        if self.wrapped:
            there = np.isfinite(values)
            values[there] = np.unwrap(values[there], period=TURN_RAD)
        if self.ratio != 1.0:
            values *= self.ratio
        if self.from_zero:
            first = values[np.isfinite(values)][:1]
            values -= first if len(first) else 0.0
        return values

    def _cells(self, raw: NDArray[Any], row: int) -> FloatArray:
        if not self.bits and not self.as_it_is:
            exact = _scaled(raw, Fraction(self.scale), Fraction(self.offset))
            if exact is not None:
                return exact
        values = np.empty(len(raw))
        for k, cell in enumerate(raw):
            number = decimal_cell(self.source, self.column.channel.name, cell, row + k)
            if number is None:
                values[k] = np.nan
                continue
            if self.bits:
                number = Decimal(int(self._signed(np.array([float(number)]), row + k)[0]))
            values[k] = float(number if self.as_it_is else number * self.scale + self.offset)
        return values

    @property
    def as_it_is(self) -> bool:
        """Whether a number of the file is one of ours."""
        return self.scale == 1 and self.offset == 0 and not self.bits

    def _signed(self, raw: NDArray[Any], row: int) -> NDArray[Any]:
        top = 1 << self.bits
        there = raw[np.isfinite(raw)] if raw.dtype.kind == "f" else raw
        if len(there) and not (there.min() >= -(top // 2) and there.max() < top):
            odd = float(there.max() if there.max() >= top else there.min())
            raise self._bad(row, f"{odd:.17g}", f"a number of {self.bits} bits")
        values = raw.astype(np.float64)
        return np.where(values >= top // 2, values - top, values)

    def _bad(self, row: int, found: str, needed: str) -> DataError:
        return DataError(
            f"channel {self.column.channel.name} holds {found}; needed: {needed}",
            where=self.source.place(row),
            fix=f"map another channel to {self.target}, or correct the file",
        )

    def seconds(self, raw: NDArray[Any], row: int, start: Fraction | None) -> tuple[Any, Fraction]:
        """Return the times of a piece from `start` on, s, and that start; NaN where there is none.

        The start is the time of the first row where None is given, or 0 where it has none;
        differences are rounded once.
        """
        scale, offset = Fraction(self.scale), Fraction(self.offset)
        if raw.dtype == object:

            def exact(k: int) -> Fraction | None:
                name = self.column.channel.name
                cell = decimal_cell(self.source, name, raw[k], row + k, stamp=True)
                return None if cell is None else Fraction(cell) * scale + offset

            if start is None:
                start = exact(0) or Fraction(0)
            rounded = _scaled(raw, scale, offset - start)
            if rounded is None:
                times = map(exact, range(len(raw)))
                rounded = np.array([np.nan if t is None else float(t - start) for t in times])
            return rounded, start
        if start is None:
            start = Fraction(raw[0].item()) * scale + offset if np.isfinite(raw[0]) else Fraction(0)
        # the start as a number of the file: differences of whole numbers are exact
        zero = (start - offset) / scale
        apart: Any
        if raw.dtype.kind in "iu" and zero.denominator == 1:
            apart = raw.astype(np.int64) - np.int64(int(zero))
        else:
            apart = np.asarray(raw, dtype=np.float64) - float(zero)
        if abs(scale.numerator) == 1:
            return apart / float(scale.denominator * scale.numerator), start
        return apart * float(scale), start


def _scaled(cells: NDArray[Any], scale: Fraction, offset: Fraction) -> FloatArray | None:
    """Return decimal numbers times `scale` plus `offset`, rounded once.

    None where the computation leaves the whole numbers that a float64 holds exactly.
    """
    # 15 digits and a point: no other number of as many digits is the same float64
    if max(map(len, cells)) > 16:
        return None
    found = plain_matrix("\n".join(cells).encode(), 1)
    if found is None or not np.isfinite(found).all():
        return None
    for digits in range(10):
        whole = np.rint(found[:, 0] * 10**digits)
        if (whole / 10**digits == found[:, 0]).all():
            break
    else:
        return None
    step = scale / 10**digits
    denominator = math.lcm(step.denominator, offset.denominator)
    factor, more = int(step * denominator), int(offset * denominator)
    largest = int(np.abs(whole).max())
    if max(largest * abs(factor) + abs(more), denominator) >= 1 << 53 or largest >= 10**15:
        return None
    return np.asarray((whole * factor + more) / denominator)


def decimal_cell(
    source: Source, name: str, cell: str, row: int, *, stamp: bool = False
) -> Decimal | None:
    """Return a cell of text as an exact number; None for one that says that there is none.

    A stamp is taken, in s, where a time is wanted.
    """
    word = str(cell).strip()
    if word.lower() in MISSING:
        return None
    seconds = stamp_seconds(word) if stamp and ":" in word else None
    if seconds is not None:
        return seconds
    if source.decimal_comma:
        word = word.replace(",", ".")
    try:
        value = Decimal(word) if word.isascii() and "_" not in word else Decimal("inf")
    except InvalidOperation:
        value = Decimal("inf")
    # beyond these a double overflows
    if not (value.is_finite() and value.adjusted() < 308):
        raise DataError(
            f"column {name} holds {str(cell)[:40]!r}; needed: a finite number"
            + (" or a stamp such as 2024-03-12 10:11:12.5" if stamp else ""),
            where=source.place(row),
            fix="correct the cell, empty it, or pass lines before the data over with --skip"
            + ("; or give the rate by --rate" if stamp else ""),
        )
    return value


def conversion(
    target: str,
    source: Source,
    column: SourceColumn,
    *,
    turn: bool = False,
    side: str = "motor",
    ratio: float | None = None,
    given: str = "",
) -> Conversion:
    """Return what turns a channel into our column, or refuse what would be another quantity."""
    words = column.words
    units = [word for word in words if word not in WORDS]
    wanted, stated = target_unit(target), column.channel.unit
    unit = units[-1] if units else stated
    scale = unit_scale(unit, wanted) if wanted and unit else None
    declared = bool(units) or (turn and column.plain)
    if scale is None and wanted and unit and column.plain:
        raise _refused(target, source, given, unit, f"give the factor: {target}={given}*FACTOR")
    if scale is not None and scale.is_nan() and (declared or column.plain):
        raise _refused(target, source, given, unit, "map another column")
    if scale is not None and scale != 1 and column.plain and not declared:
        raise _refused(target, source, given, unit, f"{target}={given}*{scale:.17g}")
    factor = scale if scale is not None and declared else Decimal(1)
    output = "output" in words or (side == "output" and "motor" not in words)
    joint = output and target in TURNING
    if joint and ratio is None:
        raise UsageError(
            f"{target} is of the joint, and no gear ratio is known",
            where="--side",
            fix="name the bench by --profile",
        )
    zero = "zero" in words or (joint and target == "motor_angle_rad")
    bits = next((_WIDTHS[word] for word in words if word in _WIDTHS), 0)
    gear = float(ratio or 1.0) if joint else 1.0
    wrapped = "wrapped" in words
    return Conversion(target, source, column, unit, factor, bits, wrapped, zero, gear)


def _refused(target: str, source: Source, given: str, unit: str, other: str) -> UsageError:
    return UsageError(
        f"column {given!r} states {unit}; needed for {target}: {target_unit(target)}",
        where=f"{source.path}, --map",
        fix=f"{other}; or '{target}={given}*1' to take it as it is",
    )


def zero_phase_velocity(
    time: FloatArray, angle: FloatArray, cutoff_hz: float, where: str
) -> tuple[FloatArray, list[str]]:
    """Return the velocity of an angle without lag, and how it was made.

    Second-order central differences over the times as they are, then a Butterworth low-pass forward
    and backward. Uneven times are filtered on an even grid of the median step, by linear
    interpolation there and back. A lost angle gives a lost velocity.
    """
    from scipy.signal import butter, sosfiltfilt

    there = np.isfinite(angle)
    at, known = time[there], angle[there]
    # sosfiltfilt pads with three times the length of its sections on either side
    least = 3 * (_ORDER + 1) + 1
    if len(at) < least:
        what = f"{len(at)} samples of the angle; needed: {least} to take a velocity from"
        raise DataError(what, where=where, fix="record longer, or map a velocity")
    step = float(np.median(np.diff(at)))
    if not cutoff_hz < 0.5 / step:
        raise DataError(
            f"cutoff {cutoff_hz:g} Hz; needed: below half the sample rate, {0.5 / step:.6g} Hz",
            where=f"{where}, --velocity-from-angle",
            fix="give a lower cutoff",
        )
    raw = np.gradient(known, at)
    sections = butter(_ORDER, cutoff_hz, fs=1.0 / step, output="sos")
    even = float(np.max(np.abs(np.diff(at) / step - 1.0))) < _EVEN_SHARE
    told = [
        "derivative of motor_angle_rad: central differences over the times of the samples, then "
        f"Butterworth low-pass of order {_ORDER} at {cutoff_hz:g} Hz forward and backward "
        "(zero phase)"
    ]
    if even:
        smooth = sosfiltfilt(sections, raw)
    else:
        count = int(np.ceil((at[-1] - at[0]) / step)) + 1
        if count > 4 * len(at):
            what = f"gaps of the angle are {count / len(at):.0f} times as long as its samples"
            raise DataError(what, where=where, fix="import a part without gaps, or map a velocity")
        grid = at[0] + step * np.arange(count)
        smooth = np.interp(at, grid, sosfiltfilt(sections, np.interp(grid, at, raw)))
        told.append(f"filtered on an even grid of {step:.6g} s, for the times are uneven")
    velocity = np.full(len(time), np.nan)
    velocity[there] = smooth
    return velocity, told


def unlike_pace(time: FloatArray, angle: FloatArray, velocity: FloatArray) -> float | None:
    """Return how many times the rate of an angle a velocity is; None where it may be that rate.

    It is another unit, another side of a gear or, below 0, another direction. None also where
    nothing can be told. Only the faster half is looked at, and its middle: jumps of a wrapped
    angle do not count.
    """
    steps = time[2:] - time[:-2]
    pace = np.divide(angle[2:] - angle[:-2], steps, out=np.zeros_like(steps), where=steps > 0.0)
    middle = velocity[1:-1]
    there = np.isfinite(pace) & np.isfinite(middle) & (pace != 0.0)
    if np.count_nonzero(there) < _LEAST_PAIRS:
        return None
    pace, middle = pace[there], middle[there]
    fast = np.abs(middle) >= np.median(np.abs(middle))
    low, ratio, high = np.quantile(middle[fast] / pace[fast], (0.25, 0.5, 0.75))
    is_told = high - low < _MOST_SCATTER * abs(ratio)
    return float(ratio) if is_told and not abs(ratio - 1.0) < _ALIKE else None
