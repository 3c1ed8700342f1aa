"""Tones whose frequency rises or falls evenly: found in short tiles, measured in long ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc

from hdbench.diagnosis.detect.transform import unit_wave
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.naming.left import Left
from hdbench.diagnosis.noise.whitened import Space
from hdbench.records.trace import FloatArray

__all__ = ["gliding_tones"]

# a gliding tone is followed over tiles of half a second: at 3 Hz/s it stays within one bin
_TILE_S = 0.5
_SHORTEST_TILE = 64
_LEAST_TILES = 12
# bins per resolution cell: a tone between two bins keeps 90 %
_PAD = 2
# lines of the short tiles that are followed with the glide taken out, over this many times as long
_KEPT = 100
_LONGER = 8
# blocks of a short tile once a line stands still: 32 Hz, ten times what it may be off by
_BLOCKS = 16
# blocks of a long tile
_SUMMED = _LONGER * _BLOCKS


def gliding_tones(space: Space, record: Record, noise_nm: float) -> Left | None:
    r"""Return the strongest tone whose frequency rises or falls evenly over the record.

    Parameters
    ----------
    space : Space
        Whitened residual with what is explained projected out.
    record : Record
        Record.
    noise_nm : float
        Standard deviation of the noise's innovation, N m.

    Returns
    -------
    Left or None
        Its middle frequency and those at both ends, Hz; None for a record shorter than 6 s.

    Notes
    -----
    Powers of tiles of half a second are summed along every straight line through time and
    frequency; the sum over m tiles of white noise is chi^2 with 2 m degrees of freedom. Along the
    best lines the glide :math:`\dot f` is taken out, :math:`x(t) e^{-i \pi \dot f t^2}`, and tiles
    of four seconds are summed over the same frequency: an eighth of the degrees of freedom. Every
    glide and frequency that could have been looked at counts as tried, not only those that were.
    """
    length = max(round(_TILE_S / record.period_s), _SHORTEST_TILE)
    whole = len(space.residual) // length
    if whole < _LEAST_TILES:
        return None
    table = space.residual[: whole * length].reshape(whole, length)
    powers = 2.0 * np.abs(np.fft.rfft(table, _PAD * length, axis=1)[:, _PAD:-_PAD]) ** 2 / length
    lines, tried = _best_lines(powers)
    value, start, end = lines[0]
    cell = 1.0 / (_PAD * length * record.period_s)
    ends = np.array([start + _PAD, end + _PAD]) * cell
    chance = min(1.0, tried * float(gammaincc(whole, 0.5 * value)))
    tiles, samples = whole, length
    if whole >= 2 * _LONGER:
        rows = [(np.array(line[1:]) + _PAD) * cell for line in lines]
        used, period = space.residual[: whole * length], record.period_s
        long = _long_tiles(len(used), period, length)
        best = max((_followed(used, period, row, long) for row in rows), key=lambda one: one[0])
        samples = _SUMMED * long.block
        tiles = whole * length // samples
        finer = tried * float(_LONGER) ** 3
        now = min(1.0, finer * float(gammaincc(tiles, 0.5 * best[0])))
        if now < chance:
            value, ends, chance = best[0], best[1], now
        else:
            tiles, samples = whole, length
    # an unbiased amplitude: two of each tile are the noise's own
    excess = max(value - 2.0 * tiles, 0.0)
    amplitude = noise_nm * float(np.sqrt(excess * 2.0 / (tiles * samples)))
    return Left(
        "frequency",
        "Hz",
        float(ends.mean()),
        (float(ends.min()), float(ends.max())),
        amplitude,
        min(1.0, 2.0 * chance),
        0.5 * amplitude**2,
    )


@dataclass(frozen=True, slots=True)
class _Tiles:
    """Long tiles, and the glides that are tried beside that of a line.

    Parameters
    ----------
    block : int
        Samples that are summed once a line stands still: a sixteenth of a short tile.
    count : int
        Long tiles.
    cell_hz : float
        Resolution of the short tiles, Hz.
    glides_hz_s : ndarray, shape (n_glides,)
        Glides, Hz/s.
    waves : ndarray of complex64, shape (n_glides, n_blocks)
        What takes each of them out.
    """

    block: int
    count: int
    cell_hz: float
    glides_hz_s: FloatArray
    waves: NDArray[np.complex64]


def _long_tiles(n_samples: int, period_s: float, length: int) -> _Tiles:
    """Return the long tiles of a record whose short ones have `length` samples."""
    block = length // _BLOCKS
    seconds = block * period_s
    count = n_samples // block // _SUMMED
    # a line of the short tiles knows its glide to a cell over the record; long tiles tell a quarter
    # of their own cell over their own length
    cell, step = 1.0 / (length * period_s), 0.5 / (_SUMMED * seconds)
    most = int(np.ceil(cell / step))
    glides = np.linspace(-most * step, most * step, 2 * most + 1) / (period_s * n_samples)
    slow = seconds * np.arange(count * _SUMMED)
    waves = unit_wave(0.5 * glides[:, None] * slow**2).conj()
    return _Tiles(block, count, cell, glides, waves)


def _followed(
    residual: FloatArray, period_s: float, ends_hz: FloatArray, tiles: _Tiles
) -> tuple[float, FloatArray]:
    """Return the largest sum over long tiles near a line, and its frequencies at both ends, Hz.

    The line is shifted to 0 Hz and summed over blocks.
    """
    from scipy.fft import fft

    used = tiles.count * _SUMMED * tiles.block
    time = period_s * np.arange(used)
    span = period_s * len(residual)
    rate = float(ends_hz[1] - ends_hz[0]) / span
    wave = unit_wave((ends_hz[0] + 0.5 * rate * time) * time).conj()
    still = (residual[:used].astype(np.float32) * wave).reshape(-1, tiles.block).sum(axis=1)
    width = 1.0 / (_PAD * _SUMMED * tiles.block * period_s)
    reach = round(1.5 * tiles.cell_hz / width)
    places = np.arange(-reach, reach + 1)
    turned = (still * tiles.waves).reshape(-1, tiles.count, _SUMMED)
    spectrum = fft(turned, _PAD * _SUMMED)[..., places]
    powers = spectrum.real**2 + spectrum.imag**2
    total: FloatArray = powers.sum(axis=1, dtype=np.float64) * (2.0 / (_SUMMED * tiles.block))
    first = float(ends_hz[0]) + places * width
    total[:, first <= tiles.cell_hz] = -np.inf
    turn, at = np.unravel_index(int(np.argmax(total)), total.shape)
    last = first[at] + (rate + tiles.glides_hz_s[turn]) * span
    return float(total[turn, at]), np.array([first[at], last])


def _best_lines(powers: FloatArray) -> tuple[list[tuple[float, int, int]], int]:
    """Return the largest sums along lines with their bins at both ends, and the lines tried."""
    tiles, bins = powers.shape
    share = np.linspace(0.0, 1.0, tiles)
    found: list[tuple[float, int, int]] = []
    tried = 0
    flat = powers.ravel()
    rows = np.arange(tiles) * bins
    # ends two bins apart differ by half a resolution cell in the mean
    for drift in range(-(bins - 1), bins, _PAD):
        offsets = rows + np.round(share * drift).astype(np.int64)
        first, last = max(0, -drift), min(bins, bins - drift)
        total = np.zeros(last - first)
        for offset in offsets.tolist():
            total += flat[offset + first : offset + last]
        tried += len(total)
        at = int(np.argmax(total))
        found.append((float(total[at]), first + at, first + at + drift))
    return sorted(found, reverse=True)[:_KEPT], tried
