"""Bands of frequency: cosine transforms of columns, and what a spectrum makes of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.records.trace import FloatArray

# narrow bands at the slow end, where a spectrum bends, and even ones above
_SLOW_BANDS, _EVEN_BANDS = 16, 41
SLOW_SHARE = 0.03
# share of the record that fades in and out: a transform takes a jump between both ends for noise
_FADE = 0.01
# columns that are transformed together: more would only take more memory
_AT_ONCE = 8
# a wave that is moved is faded anew; where the window is next to nothing this has no meaning
_STRETCH = 2.0
# samples between which uneven ones are interpolated: a tone at .4 of the Nyquist frequency to a
# thousandth, where steps scatter by a fifth
_NEAREST = 12
# a filter is undone to some thirty times, so that noise behind it does not take over
_UNDONE = 1e-3


@dataclass(frozen=True, slots=True)
class LowPass:
    """Butterworth low-pass of a torque channel.

    Parameters
    ----------
    corner : float
        Corner relative to the Nyquist frequency, in (0, 1).
    order : int
        Order.
    causal : bool
        Whether it has the delay of a filter that runs once; without one it runs both ways.
    load : bool
        Whether the measured load was logged behind the same filter.
    analog : bool
        Whether it ran ahead of the sampling: it bends no frequencies, as one of samples does.
    damping : float
        Damping of its poles relative to Butterworth's; 1.41 makes two equal first orders of two.
    over_time : bool
        Whether it ran over the times of uneven samples; else over the samples as if they were even.
    """

    corner: float
    order: int = 2
    causal: bool = False
    load: bool = False
    analog: bool = False
    damping: float = 1.0
    over_time: bool = False

    def poles(self, corner: float) -> NDArray[np.complex128]:
        """Return the poles of the filter at a corner in rad/s, 1/s."""
        ratio = self.damping * np.sin(np.pi * (np.arange(self.order) + 0.5) / self.order)
        # the upper half of the poles, and the lower half
        way = np.where(np.arange(self.order) < self.order // 2, 1.0, -1.0)
        return np.asarray(corner * (-ratio + way * np.emath.sqrt(ratio**2 - 1.0)))

    def sections(self) -> FloatArray:
        """Return the filter in sections of second order, shape (sections, 6)."""
        from scipy.signal import bilinear_zpk, zpk2sos

        poles = self.poles(2.0 * np.tan(0.5 * np.pi * self.corner))
        gain = float(np.prod(-poles).real)
        zeros, poles, gain = bilinear_zpk(np.zeros(0), poles, gain, fs=1.0)
        return np.asarray(zpk2sos(zeros, poles, gain))  # type: ignore[arg-type]

    def gain(self, count: int, whole: int) -> NDArray[np.complex128]:
        """Return the gain at the first frequencies, of which `whole` reach up to Nyquist's."""
        return _gain(self, count, whole)

    def applied(self, values: FloatArray) -> FloatArray:
        """Return what the filter makes of `values`; one with a delay begins at rest; NaN stays."""
        known, held = _bridged(values)
        if self.causal:
            made = held[0] + _once(self, (held - held[0])[None, :])[0]
        else:
            made = self._shaped(held, lambda gain: gain)
        return np.where(known, made, np.nan)

    def undone(self, values: FloatArray) -> FloatArray:
        """Return what the filter made `values` of, as far as its noise allows; NaN stays."""

        def back(gain: NDArray[np.complex128]) -> NDArray[np.complex128]:
            power = np.abs(gain) ** 2 + _UNDONE
            return np.asarray(np.conj(gain) * (1.0 + _UNDONE) / power, dtype=np.complex128)

        known, held = _bridged(values)
        return np.where(known, self._shaped(held, back), np.nan)

    def _shaped(
        self,
        held: FloatArray,
        shape: Callable[[NDArray[np.complex128]], NDArray[np.complex128]],
    ) -> FloatArray:
        lines = mirrored_lines(held)
        lines *= shape(self.gain(len(lines), len(lines) - 1))
        return np.fft.irfft(lines)[: len(held)]


# many columns of one record go through the same filter
@lru_cache(maxsize=4)
def _gain(low_pass: LowPass, count: int, whole: int) -> NDArray[np.complex128]:
    from scipy.signal import sosfreqz

    share = np.arange(count) / whole
    if low_pass.analog:
        poles = low_pass.poles(low_pass.corner)
        top = np.prod(-poles)
        once = np.asarray(top / np.prod(1j * share[:, None] - poles, axis=1))
    else:
        once = np.asarray(sosfreqz(low_pass.sections(), np.pi * share)[1])
    return once if low_pass.causal else np.abs(once) ** 2 + 0j


def shifted(values: FloatArray, samples: float) -> FloatArray:
    """Return a signal as it was some samples ago, all frequencies alike."""
    if samples == 0.0:
        return values
    lines = mirrored_lines(values)
    lines *= np.exp(-1j * np.pi * samples * np.arange(len(lines)) / (len(lines) - 1))
    return np.fft.irfft(lines)[: len(values)]


def smoothed(columns: FloatArray, share: float) -> FloatArray:
    """Return columns without what is faster than `share` of the Nyquist frequency; NaN stays.

    The octave below fades.
    """
    place = np.linspace(0.5, 1.0, 65) * share
    fade = np.clip(2.0 * (share - place) / share, 0.0, 1.0)
    return shaped(columns, (place, 0.5 - 0.5 * np.cos(np.pi * fade)))


def shaped(columns: FloatArray, gain: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Return columns times a gain at frequencies relative to the Nyquist frequency; NaN stays."""
    from scipy.fft import dct, idct, next_fast_len

    known = np.isfinite(columns)
    count = len(columns)
    size = int(next_fast_len(count, real=True))
    rows = dct(np.where(known, columns, 0.0), n=size, axis=0, norm="ortho")
    rows *= np.interp(np.arange(size) / size, *gain)[:, None]
    return np.where(known, idct(rows, axis=0, norm="ortho")[:count], np.nan)


def mirrored_lines(values: FloatArray) -> NDArray[np.complex128]:
    """Return the lines of a signal that is mirrored, so that both ends meet."""
    long = _lengthened(values[None, :])[0]
    return np.fft.rfft(np.concatenate([long, long[::-1]]))


def _lengthened(rows: FloatArray) -> FloatArray:
    """Return rows that go on at their last values to a length of quick transforms."""
    from scipy.fft import next_fast_len

    n = rows.shape[1]
    return np.pad(rows, ((0, 0), (0, int(next_fast_len(n, real=True)) - n)), mode="edge")


def _bridged(values: FloatArray) -> tuple[NDArray[np.bool_], FloatArray]:
    """Return which values are known, and all of them with lost ones on straight lines."""
    known = np.isfinite(values)
    return known, np.interp(np.arange(len(values)), np.flatnonzero(known), values[known])


@dataclass(frozen=True)
class Clock:
    """When uneven samples were taken: a channel that filters over time does not filter over them.

    Parameters
    ----------
    ticks : ndarray, shape (n_samples,)
        Times of the samples from the first one on, in periods.
    """

    ticks: FloatArray

    @property
    def _even(self) -> FloatArray:
        return np.arange(int(np.ceil(self.ticks[-1])) + 1.0)

    # most records have no filter over time: what they do not need is not made
    @cached_property
    def to_even(self) -> Any:
        """Sparse matrix that makes signals at even times of signals at the samples."""
        return _between(self.ticks, self._even)

    @cached_property
    def from_even(self) -> Any:
        """Sparse matrix that makes signals at the samples of signals at even times."""
        return _between(self._even, self.ticks)


def _between(times: FloatArray, at: FloatArray) -> Any:
    """Return what interpolates signals from times to others, a polynomial through the nearest."""
    from scipy.sparse import csr_array

    count = min(_NEAREST, len(times))
    places = np.clip(np.searchsorted(times, at) - count // 2, 0, len(times) - count)
    places = places[:, None] + np.arange(count)
    # beyond the ends a signal stays
    here, nodes = np.clip(at, times[0], times[-1])[:, None], times[places]
    weights = np.ones_like(nodes)
    for k in range(count):
        others = np.delete(nodes, k, axis=1)
        weights[:, k] = np.prod((here - others) / (nodes[:, k : k + 1] - others), axis=1)
    rows = np.repeat(np.arange(len(at)), count)
    shape = (len(at), len(times))
    return csr_array((weights.ravel(), (rows, places.ravel())), shape=shape)


def _once(low_pass: LowPass, rows: FloatArray) -> FloatArray:
    """Return rows behind a filter that runs once, from rest."""
    from scipy.fft import irfft, next_fast_len, rfft
    from scipy.signal import sosfilt

    if not low_pass.analog:
        return np.asarray(sosfilt(low_pass.sections(), rows, axis=1))
    # as long again, so that the end does not run into the beginning
    half = int(next_fast_len(rows.shape[1], real=True))
    lines = rfft(rows, n=2 * half, axis=1)
    lines *= low_pass.gain(half + 1, half)
    return np.asarray(irfft(lines, n=2 * half, axis=1)[:, : rows.shape[1]])


def _both_ways(low_pass: LowPass, rows: FloatArray) -> FloatArray:
    """Return rows behind a filter that runs once in each direction."""
    from scipy.fft import dct, idct

    lines = dct(rows, norm="ortho", axis=1)
    lines *= np.abs(low_pass.gain(rows.shape[1], rows.shape[1]))
    return np.asarray(idct(lines, norm="ortho", axis=1, overwrite_x=True))


@dataclass(frozen=True, slots=True)
class Bands:
    """Bands of the cosine transform of a record.

    Parameters
    ----------
    edges : ndarray of int, shape (n_bands + 1,)
        First coefficient of each band, and the end.
    counts : ndarray, shape (n_bands,)
        Independent coefficients of each band: fewer where samples were lost or faded.
    frequency_hz : ndarray, shape (n_bands,)
        Centre of each band, Hz.
    fade : ndarray, shape (n_samples,)
        Window of the record.
    length : int
        Length of the transform.
    passed : ndarray, shape (size,)
        What the torque channel passes of each coefficient that is kept, 0 to 1: 1 throughout unless
        the torque was low-passed before it was stored.
    low_pass : LowPass or None
        What holds the rest back; None where nothing does.
    lost, before, after : ndarray of int
        Lost samples, and the last present sample before and after each.
    weight : ndarray
        Weight of the one before.
    clock : Clock or None
        When the samples were taken; None where they are even.
    """

    edges: NDArray[np.int64]
    counts: FloatArray
    frequency_hz: FloatArray
    fade: FloatArray
    length: int
    passed: FloatArray
    lost: NDArray[np.int64]
    before: NDArray[np.int64]
    after: NDArray[np.int64]
    weight: FloatArray
    low_pass: LowPass | None = None
    clock: Clock | None = None

    def __len__(self) -> int:
        return len(self.counts)

    @property
    def size(self) -> int:
        """Coefficients that are kept: up to the bandwidth of the torque."""
        return int(self.edges[-1])

    def transform(self, columns: FloatArray, *, measured: bool = False) -> FloatArray:
        """Return the cosine transform of columns as the torque channel passes them.

        Lost samples are bridged by straight lines, in the data and in every column alike.
        `measured` is for what went through the channel already.
        """
        from scipy.fft import dct

        out = np.empty((columns.shape[1], self.size))
        for first in range(0, len(out), _AT_ONCE):
            rows = np.array(columns.T[first : first + _AT_ONCE], dtype=np.float64, order="C")
            if not measured:
                rows = self._passed(rows)
            rows = self._bridged(rows)
            rows *= self.fade
            whole = dct(rows, n=self.length, norm="ortho", axis=1, overwrite_x=True)
            out[first : first + _AT_ONCE] = whole[:, : self.size]
        return out

    def inverse(self, row: FloatArray) -> FloatArray:
        """Return what the transform of a column makes of coefficients: its transpose."""
        from scipy.fft import idct

        whole = np.zeros(self.length)
        whole[: self.size] = row
        column = np.asarray(idct(whole, norm="ortho"))[: len(self.fade)] * self.fade
        column = self._unbridged(column)
        clock = self._clock_of_filter
        if self.low_pass is None:
            return column
        if clock is not None:
            column = clock.from_even.T @ column
        if not self.low_pass.causal:
            long = np.zeros(len(_lengthened(column[None, :])[0]))
            long[: len(column)] = column
            long = _both_ways(self.low_pass, long[None, :])[0]
            # the last value went on
            long[len(column) - 1] += long[len(column) :].sum()
            column = long[: len(column)]
        else:
            total = float(column.sum())
            column = _once(self.low_pass, column[None, ::-1])[0, ::-1].copy()
            # the filter begins at rest at the first sample
            column[0] += total - float(column.sum())
        return np.asarray(column if clock is None else clock.to_even.T @ column)

    def waves(self, rows: FloatArray) -> FloatArray:
        """Return what coefficients are in time, shape (k, n_samples)."""
        from scipy.fft import idct

        whole = np.zeros((len(rows), self.length))
        whole[:, : self.size] = rows
        return np.asarray(idct(whole, norm="ortho", axis=1, overwrite_x=True))[:, : len(self.fade)]

    def moved(self, row: FloatArray, samples: float) -> FloatArray:
        """Return the transform of a signal as it was some samples ago."""
        from scipy.fft import dct

        if samples == 0.0:
            return row
        wave = shifted(self.waves(row[None, :])[0], samples)
        # the window of the record stays where it is
        wave *= np.clip(self.fade / np.maximum(shifted(self.fade, samples), 1e-6), 0.0, _STRETCH)
        wave = self._bridged(wave[None, :])[0]
        return np.asarray(dct(wave, n=self.length, norm="ortho"))[: self.size]

    @property
    def _clock_of_filter(self) -> Clock | None:
        return self.clock if self.low_pass is not None and self.low_pass.over_time else None

    def _passed(self, rows: FloatArray) -> FloatArray:
        """Return rows as the channel passes them; a filter with a delay begins at rest."""
        low_pass, clock = self.low_pass, self._clock_of_filter
        if low_pass is None:
            return rows
        if clock is not None:
            rows = np.ascontiguousarray((clock.to_even @ rows.T).T)
        if low_pass.causal:
            first = rows[:, :1]
            rows = first + _once(low_pass, rows - first)
        else:
            rows = _both_ways(low_pass, _lengthened(rows))[:, : rows.shape[1]].copy()
        return rows if clock is None else np.ascontiguousarray((clock.from_even @ rows.T).T)

    def _bridged(self, rows: FloatArray) -> FloatArray:
        """Return rows with lost samples on straight lines."""
        if len(self.lost):
            bridged = self.weight * rows[:, self.before]
            rows[:, self.lost] = bridged + (1.0 - self.weight) * rows[:, self.after]
        return rows

    def _unbridged(self, column: FloatArray) -> FloatArray:
        """Return what lost samples hold at those between which they lie: the transpose."""
        if len(self.lost):
            held = column[self.lost]
            column[self.lost] = 0.0
            np.add.at(column, self.before, self.weight * held)
            np.add.at(column, self.after, (1.0 - self.weight) * held)
        return column

    def low_passed(self, low_pass: LowPass | None) -> Bands:
        """Return the bands of a channel with a low-pass."""
        if low_pass is None:
            return self
        return replace(
            self,
            passed=np.abs(low_pass.gain(self.size, self.length)),
            low_pass=low_pass,
        )

    def behind(self, change: Callable[[LowPass], LowPass]) -> Bands:
        """Return the bands of a channel whose low-pass, where it has one, is another."""
        return self if self.low_pass is None else self.low_passed(change(self.low_pass))

    def spread(self, per_band: FloatArray) -> FloatArray:
        """Return a value of each band at each of its coefficients."""
        return np.repeat(per_band, np.diff(self.edges))

    def gram(self, one: FloatArray, other: FloatArray) -> FloatArray:
        """Return the products of rows in each band, shape (n_bands, n_one, n_other)."""
        out = np.empty((len(self), len(one), len(other)))
        for own, (a, b) in zip(out, pairwise(self.edges.tolist()), strict=True):
            np.matmul(one[:, a:b], other[:, a:b].T, out=own)
        return out

    def along(self, rows: FloatArray, row: FloatArray) -> FloatArray:
        """Return the products of rows with another one in each band, shape (n_bands, n_rows)."""
        return self.gram(rows, row[None, :])[:, :, 0]

    def power(self, row: FloatArray) -> FloatArray:
        """Return the sum of squares of a row in each band."""
        return np.asarray(np.add.reduceat(row * row, self.edges[:-1]))


def make_bands(
    valid: NDArray[np.bool_],
    period_s: float,
    share: float = 1.0,
    taken_s: FloatArray | None = None,
) -> Bands:
    """Return the bands of a record; `taken_s` is when uneven samples were taken."""
    from scipy.fft import next_fast_len

    n = len(valid)
    size = int(next_fast_len(n, real=True))
    top = max(share * size, 4.0)
    slow = np.geomspace(3, max(4.0, top * SLOW_SHARE), _SLOW_BANDS).astype(int)
    even = np.linspace(top * SLOW_SHARE, top, _EVEN_BANDS + 1).astype(int)
    edges = np.unique(np.concatenate([[0], slow, even[1:]]))
    ramp = max(2, int(n * _FADE))
    fade = np.ones(n)
    fade[:ramp] = 0.5 - 0.5 * np.cos(np.pi * (np.arange(ramp) + 0.5) / ramp)
    fade[-ramp:] = fade[:ramp][::-1]
    present = np.flatnonzero(valid)
    lost = np.flatnonzero(~valid)
    place = np.searchsorted(present, lost)
    before = present[np.maximum(place - 1, 0)]
    after = present[np.minimum(place, len(present) - 1)]
    span = np.maximum(after - before, 1)
    weight = np.where(after > before, (after - lost) / span, 1.0)
    counts = np.diff(edges) * float(np.sum(fade[valid] ** 2)) / size
    frequency = np.sqrt(np.maximum(edges[:-1], 0.5) * edges[1:]) / (2.0 * size * period_s)
    passed = np.ones(int(edges[-1]))
    clock = None if taken_s is None else Clock((taken_s - taken_s[0]) / period_s)
    held = (edges, counts, frequency, fade, size, passed, lost, before, after, weight)
    return Bands(*held, clock=clock)
