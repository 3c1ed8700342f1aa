"""Records of one drive, stacked: causes shared by all, all else of each record alone.

A fit of several records is a fit of one long one. Its transform is the transforms of the records,
one behind the other, and so are its bands and its noise. The row of a shared cause runs through
all of them; the row of what differs is zero outside its own record. So the moments of shared rows
add, each record in the units of its own noise, and the search needs to know no more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.discovery.bands import Bands, LowPass
from hdbench.diagnosis.discovery.fit import Fit, Part, scaled_rows
from hdbench.diagnosis.discovery.moments import inverse
from hdbench.diagnosis.discovery.record import Record
from hdbench.diagnosis.discovery.spectrum import Shapes, Spectrum
from hdbench.diagnosis.discovery.term import Term
from hdbench.model import Cause, Motion
from hdbench.records.trace import FloatArray

SHARED, EACH, ONE = "shared", "each", "one"
# records stand so many sampling periods apart on the clock of the stack
_APART = 100.0
# ripple of the baseline that tells where an angle begins, in standard deviations, and how far its
# phase may change from record to record with speed and load, rad
_SEEN, _PHASE_RAD = 5.0, 0.15
# names of lines that keep their phase where the angle has one reference, if their order is whole
_WHOLE = ("ripple-harmonic", "cogging")


# --- motion and record
@dataclass(frozen=True, slots=True)
class StackedMotion(Motion):
    """Motions one behind the other, on a clock that goes on.

    Parameters
    ----------
    piece : ndarray of int, shape (n_samples,)
        Record of each sample.
    own_time_s : ndarray, shape (n_samples,)
        Time on the record's own clock, s.
    noises_rad_s2 : tuple of float
        `acceleration_noise_rad_s2` of each record.
    """

    piece: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    own_time_s: FloatArray = field(default_factory=lambda: np.zeros(0))
    noises_rad_s2: tuple[float, ...] = ()

    def pieces(self) -> Iterator[Motion]:
        """Return the motion of each record."""
        ends = np.searchsorted(self.piece, np.arange(len(self.noises_rad_s2) + 1))
        for noise, (a, b) in zip(self.noises_rad_s2, pairwise(ends), strict=True):
            own: dict[str, Any] = {}
            for one in fields(Motion):
                value = getattr(self, one.name)
                own[one.name] = value[a:b] if isinstance(value, np.ndarray) else value
            own["time_s"], own["acceleration_noise_rad_s2"] = self.own_time_s[a:b], noise
            yield Motion(**own)


def _stack(motion: Motion) -> StackedMotion:
    """Return a motion that is known to be a stack."""
    if not isinstance(motion, StackedMotion):
        raise TypeError("a cause of a stack needs the motion of a stack")
    return motion


def records_of(record: Record) -> tuple[Record, ...]:
    """Return the records of a stack with the torque that is simulated; a plain one alone."""
    motion = record.motion
    if not isinstance(motion, StackedMotion):
        return (record,)
    return tuple(
        replace(one, motion=own) for one, own in zip(record.records, motion.pieces(), strict=True)
    )


def _stacked_motion(motions: Sequence[Motion]) -> StackedMotion:
    own: dict[str, Any] = {}
    for one in fields(Motion):
        values = [getattr(motion, one.name) for motion in motions]
        arrays = all(isinstance(value, np.ndarray) for value in values)
        own[one.name] = np.concatenate(values) if arrays else None
        if not arrays and not any(isinstance(value, np.ndarray) for value in values):
            own[one.name] = values[0]
    clock, starts, now = [], [], 0.0
    for motion in motions:
        clock.append(motion.time_s - motion.time_s[0] + now)
        now = float(clock[-1][-1]) + _APART * float(np.median(np.diff(motion.time_s)))
        begun = np.zeros(len(motion), dtype=bool) if motion.starts is None else motion.starts.copy()
        begun[0] = True
        starts.append(begun)
    noises = tuple(motion.acceleration_noise_rad_s2 for motion in motions)
    own |= {
        "time_s": np.concatenate(clock),
        "starts": np.concatenate(starts),
        "acceleration_noise_rad_s2": max(noises),
        # of one record alone
        "shown_by_angle": None,
    }
    piece = np.repeat(np.arange(len(motions)), [len(motion) for motion in motions])
    times = np.concatenate([motion.time_s for motion in motions])
    return StackedMotion(**own, piece=piece, own_time_s=times, noises_rad_s2=noises)


# --- bands and noise
@dataclass(frozen=True, slots=True)
class StackedBands(Bands):
    """Bands of the records one behind the other.

    Parameters
    ----------
    parts : tuple of Bands
        Bands of each record.
    """

    parts: tuple[Bands, ...] = ()

    def transform(self, columns: FloatArray, *, measured: bool = False) -> FloatArray:
        """Return the transforms of the pieces of columns."""
        ends = np.cumsum([0, *(len(part.fade) for part in self.parts)])
        pieces = zip(self.parts, pairwise(ends), strict=True)
        done = [part.transform(columns[a:b], measured=measured) for part, (a, b) in pieces]
        return np.concatenate(done, axis=1)

    def inverse(self, row: FloatArray) -> FloatArray:
        """Return what each record's transform makes of its coefficients: its transpose."""
        pieces = zip(self.parts, self.slices(), strict=True)
        return np.concatenate([part.inverse(row[a]) for part, (a, _) in pieces])

    def waves(self, rows: FloatArray) -> FloatArray:
        """Return what coefficients of all records are in time, one record behind the other."""
        pieces = zip(self.parts, self.slices(), strict=True)
        return np.hstack([part.waves(rows[:, at]) for part, (at, _) in pieces])

    def behind(self, change: Callable[[LowPass], LowPass]) -> StackedBands:
        """Return the bands of records whose low-passes, where they have one, are others."""
        return replace(self, parts=tuple(part.behind(change) for part in self.parts))

    def slices(self) -> list[tuple[slice, slice]]:
        """Return the coefficients and the bands of each record."""
        sizes = np.cumsum([0, *(part.size for part in self.parts)]).tolist()
        counts = np.cumsum([0, *(len(part) for part in self.parts)]).tolist()
        return [
            (slice(a, b), slice(c, d))
            for (a, b), (c, d) in zip(pairwise(sizes), pairwise(counts), strict=True)
        ]


def _stacked_bands(parts: Sequence[Bands]) -> StackedBands:
    ends = np.cumsum([0, *(part.size for part in parts)])
    edges = [part.edges[:-1] + at for part, at in zip(parts, ends, strict=False)]
    none = np.zeros(0, dtype=np.int64)
    return StackedBands(
        np.concatenate([*edges, ends[-1:]]),
        np.concatenate([part.counts for part in parts]),
        np.concatenate([part.frequency_hz for part in parts]),
        np.concatenate([part.fade for part in parts]),
        sum(part.length for part in parts),
        np.concatenate([part.passed for part in parts]),
        none,
        none,
        none,
        np.zeros(0),
        parts=tuple(parts),
    )


@dataclass(frozen=True, slots=True)
class StackedShapes(Shapes):
    """Shapes of the noise of each record.

    Parameters
    ----------
    parts : tuple of Shapes
        Shapes of each record.
    ends : tuple of int
        First band of each record, and the end.
    """

    parts: tuple[Shapes, ...] = ()
    ends: tuple[int, ...] = ()

    def rising(self) -> StackedShapes:
        """Return the same with the shapes that rise towards 0 Hz."""
        return replace(self, with_slow=True, parts=tuple(part.rising() for part in self.parts))

    def even(self, power: FloatArray) -> FloatArray:
        """Return powers that do not rise towards 0 Hz in any record."""
        pieces = zip(self.parts, pairwise(self.ends), strict=True)
        return np.concatenate([part.even(power[a:b]) for part, (a, b) in pieces])

    def fit(
        self,
        power: FloatArray,
        dof: FloatArray,
        start: FloatArray | None = None,
        model: FloatArray | None = None,
        moving: FloatArray | None = None,
    ) -> Spectrum:
        """Return the most likely noise of each record."""
        first = np.cumsum([0, *(len(part.table) for part in self.parts)])
        found = []
        for part, (a, b), (c, d) in zip(
            self.parts, pairwise(self.ends), pairwise(first), strict=True
        ):
            own = [None if x is None else x[a:b] for x in (model, moving)]
            begin = None if start is None else start[c:d]
            found.append(part.fit(power[a:b], dof[a:b], begin, *own))
        return Spectrum(
            np.concatenate([one.power for one in found]),
            np.concatenate([one.amounts for one in found]),
        )


# --- causes
@dataclass(frozen=True, slots=True)
class StackedCause(Cause):
    """A cause of the catalogue on a stack of records.

    Parameters
    ----------
    plain : Cause or None
        The cause of the catalogue.
    kind : str
        ``shared``: one amplitude for all records; ``each``: one for each, as of a line whose phase
        begins anew; ``one``: it is in one record alone, as a step in time.
    whole : Cause or None
        The same shared, where a line of a whole order keeps its phase; None for all others.
    """

    plain: Cause | None = None
    kind: str = SHARED
    whole: Cause | None = None


def _of(cause: Cause, kind: str, count: int, whole: Cause | None = None) -> StackedCause:
    def columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        stack = _stack(motion)
        if kind == ONE:
            return _in_one(cause.columns(stack, shape), stack, shape["step_time_s"])
        pieces = [cause.columns(one, shape) for one in stack.pieces()]
        if kind == SHARED:
            return np.concatenate(pieces)
        k = pieces[0].shape[1]
        out = np.zeros((len(stack), count * k))
        for at, one in enumerate(pieces):
            out[stack.piece == at, at * k : (at + 1) * k] = one
        return out

    def applicable(motion: Motion) -> str | None:
        pieces = _stack(motion).pieces()
        return next((why for one in pieces if (why := cause.applicable(one))), None)

    own = {one.name: getattr(cause, one.name) for one in fields(Cause)}
    own |= {"columns": columns, "applicable": applicable}
    if kind == EACH:
        own["linear"] = tuple(
            replace(p, name=f"{p.name}@{at}") for at in range(count) for p in cause.linear
        )
    return StackedCause(**own, plain=cause, kind=kind, whole=whole)


def _in_one(columns: FloatArray, motion: StackedMotion, time_s: float) -> FloatArray:
    """Return columns in the record in which a time lies alone."""
    at = motion.piece[min(int(np.searchsorted(motion.time_s, time_s)), len(motion) - 1)]
    return np.where((motion.piece == at)[:, None], columns, 0.0)


def stacked_causes(causes: Iterable[Cause], count: int, *, referenced: bool) -> dict[str, Cause]:
    """Return causes for a stack of records."""
    out: dict[str, Cause] = {}
    for cause in causes:
        kind = SHARED
        if cause.locked_to == "clock" or (cause.locked_to == "time" and not cause.whole_signal):
            kind = ONE if cause.name == "zero-step" else EACH
        rolls = [p.name for p in cause.shape] in (["order"], ["output_order"])
        if cause.locked_to in ("motor", "output") and (rolls or not referenced):
            kind = EACH
        keeps = kind == EACH and referenced and cause.name in _WHOLE
        whole = _of(cause, SHARED, count) if keeps else None
        out[cause.name] = _of(cause, kind, count, whole) if cause.additive else cause
    return out


def _one_reference(fits: Sequence[Fit]) -> bool:
    """Return whether the motor angles of all records have one zero, by their ripple.

    An angle that was integrated begins at 0 wherever the motor stood; a measured one may, too. The
    ripple that the baseline expects tells: with one zero it has one phase.
    """
    if any(fit.record.motion.angle_source == "velocity" for fit in fits):
        return False
    told = False
    orders = {p.name for fit in fits for p in fit.parts if p.name.startswith("ripple:")}
    for name in orders:
        waves = [_wave(fit, name) for fit in fits]
        seen = [wave for wave in waves if wave is not None]
        if len(seen) < len(fits):
            continue
        told = True
        first, first_std = seen[0]
        for value, std in seen[1:]:
            apart = abs(float(np.angle(value * np.conj(first))))
            if apart > float(np.hypot(_PHASE_RAD, 3.0 * np.hypot(std, first_std))):
                return False
    return told


def _wave(fit: Fit, name: str) -> tuple[complex, float] | None:
    """Return a ripple of the baseline and the deviation of its phase; None where it is not seen."""
    part = next((at for at, one in enumerate(fit.parts) if one.name == name), None)
    if part is None:
        return None
    flat = fit.flat(part)
    cosine, sine = fit.linear(part)
    scale = float(fit.parts[part].scale.mean())
    variance = float(np.trace(inverse(fit.information)[np.ix_(flat, flat)])) / 2.0
    size, std = float(np.hypot(cosine, sine)), float(np.sqrt(variance)) / scale
    return (complex(cosine, -sine), std / size) if size > _SEEN * std else None


# --- the fit
def stack_fits(fits: Sequence[Fit]) -> Fit:
    """Return the fit of the baseline of all records."""
    records = [fit.record for fit in fits]
    count = sum(len(record) for record in records)
    names: list[str] = []
    columns, priors, at = [], [], 0
    for number, fit in enumerate(fits):
        held = {part.name for part in fit.parts if part.term is None}
        for place, name in enumerate(fit.record.names):
            stem, _, last = name.rpartition(":")
            if (stem or name) in held:
                names.append(f"{stem or name}:{last if stem else 'value'}@{number}")
                column = np.zeros(count)
                column[at : at + len(fit.record)] = fit.record.columns[:, place]
                columns.append(column)
                priors.append(fit.record.prior_nm[place])
        at += len(fit.record)
    record = Record(
        _stacked_motion([one.motion for one in records]),
        np.concatenate([one.torque_nm for one in records]),
        np.concatenate([one.valid for one in records]),
        np.concatenate([one.fixed_nm for one in records]),
        tuple(names),
        np.column_stack(columns),
        np.array(priors),
        float(np.median([one.period_s for one in records])),
        records[0].load,
        motion_passed=min(one.motion_passed for one in records),
        clock_jitter=max(one.clock_jitter for one in records),
        velocity_late_s=max((one.velocity_late_s for one in records), key=abs),
        channel_known=True,
        records=tuple(records),
        referenced=_one_reference(fits),
    )
    bands = _stacked_bands([fit.bands for fit in fits])
    first = fits[0].shapes
    shapes = StackedShapes(
        **{one.name: getattr(first, one.name) for one in fields(Shapes)},
        parts=tuple(fit.shapes for fit in fits),
        ends=tuple(np.cumsum([0, *(len(fit.bands) for fit in fits)]).tolist()),
    )
    measured = np.concatenate([fit.measured for fit in fits])
    spectrum = Spectrum(
        np.concatenate([fit.spectrum.power for fit in fits]),
        np.concatenate([fit.spectrum.amounts for fit in fits]),
    )
    fixed = np.concatenate([fit.fixed for fit in fits])
    stack = Fit.empty(record, bands, shapes, measured, spectrum, fixed)
    rows, scale = scaled_rows(bands, record.columns)
    stems = [name.rpartition(":")[0] for name in names]
    for stem in dict.fromkeys(stems):
        places = [i for i, one in enumerate(stems) if one == stem]
        variance = record.prior_nm[places] ** 2
        stack.add_rows(stem, None, rows[places], scale[places], variance)
    stack.settle(4)
    return stack


@dataclass(frozen=True, slots=True)
class Glance:
    """What a fit leaves of one record, in its own noise."""

    record: Record
    bands: Bands
    residual: FloatArray
    noise: FloatArray


def glances(fit: Fit, residual: FloatArray | None = None) -> list[Glance]:
    """Return the residual of each record in its own noise, without what is explained."""
    left = fit.residual if residual is None else residual
    bands, noise = fit.bands, fit.spectrum.power
    if not isinstance(bands, StackedBands):
        return [Glance(fit.record, bands, left, noise)]
    return [
        Glance(record, own, left[at], noise[band])
        for record, own, (at, band) in zip(
            records_of(fit.record), bands.parts, bands.slices(), strict=True
        )
    ]


def coefficients_of(fit: Fit) -> list[slice]:
    """Return the coefficients of each record."""
    bands = fit.bands
    whole = [slice(0, bands.size)]
    return [at for at, _ in bands.slices()] if isinstance(bands, StackedBands) else whole


def piece_fit(fit: Fit, number: int) -> tuple[Fit, list[int]]:
    """Return the fit of one record of a stack, as all records together have it."""
    bands, shapes = fit.bands, fit.shapes
    if not isinstance(bands, StackedBands) or not isinstance(shapes, StackedShapes):
        raise TypeError("a fit of one record has no pieces")
    at, band = bands.slices()[number]
    record = records_of(fit.record)[number]
    seen = np.any(fit.rows[:, at] != 0.0, axis=1) | fit.form
    parts: list[Part] = []
    origin: list[int] = []
    kept: list[NDArray[np.int64]] = []
    for index, part in enumerate(fit.parts):
        flat = fit.flat(index)
        cause = None if part.term is None else part.term.cause
        shared = part.term is not None and getattr(cause, "kind", SHARED) == SHARED
        own = np.ones(len(flat), dtype=bool) if shared else seen[flat]
        if len(flat) and not own.any():
            continue
        term = None if part.term is None else piece_term(part.term, fit.record, number)
        parts.append(replace(part, term=term, scale=part.scale[own]))
        kept.append(np.concatenate([flat[own], np.flatnonzero((fit.owner == index) & fit.form)]))
        origin.append(index)
    rows = np.concatenate(kept) if kept else np.zeros(0, dtype=np.int64)
    owner = np.repeat(np.arange(len(parts)), [len(one) for one in kept])
    covariance = inverse(fit.information)[np.ix_(rows, rows)]
    first = shapes.parts[:number]
    amount = sum(len(one.table) for one in first)
    spectrum = Spectrum(
        fit.spectrum.power[band],
        fit.spectrum.amounts[amount : amount + len(shapes.parts[number].table)],
    )
    return (
        Fit(
            record,
            bands.parts[number],
            shapes.parts[number],
            fit.measured[at],
            parts,
            np.ascontiguousarray(fit.rows[rows, at]),
            owner,
            fit.form[rows],
            fit.variance[rows],
            np.ascontiguousarray(fit.gram[band][:, rows][:, :, rows]),
            fit.against[band][:, rows],
            fit.power[band],
            fit.coefficients[rows],
            spectrum,
            fit.fixed[band],
            fit.likelihood,
            inverse(covariance),
        ),
        origin,
    )


def piece_term(term: Term, record: Record, number: int) -> Term:
    """Return a term of a stack as one of its records has it."""
    motion = _stack(record.motion)
    inside = motion.piece == number
    cause = term.cause
    if not isinstance(cause, StackedCause) or cause.plain is None:
        # a table over an axis of the stack

        def columns(motion_of_piece: Motion, shape: Mapping[str, float]) -> FloatArray:
            del motion_of_piece
            return np.asarray(cause.columns(motion, shape)[inside])

        return replace(term, cause=replace(cause, columns=columns))
    shape = dict(term.shape)
    if cause.kind == ONE:
        shift = float((motion.time_s - motion.own_time_s)[inside][0])
        shape["step_time_s"] -= shift
    return Term(cause.plain, shape, term.known)
