"""Tones whose frequency rises or falls evenly: found in short tiles, measured in long ones."""

from __future__ import annotations

import numpy as np
from scipy.special import gammaincc

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
        near = [_followed(space.residual[: whole * length], record, row, length) for row in rows]
        best = max(near, key=lambda one: one[0])
        samples = _LONGER * _BLOCKS * (length // _BLOCKS)
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


def _followed(
    residual: FloatArray, record: Record, ends_hz: FloatArray, length: int
) -> tuple[float, FloatArray]:
    """Return the largest sum over long tiles near a line, and its frequencies at both ends, Hz.

    The line is shifted to 0 Hz and summed over blocks of a sixteenth of a short tile.
    """
    block = length // _BLOCKS
    count = len(residual) // block
    time = record.period_s * np.arange(count * block)
    span = record.period_s * len(residual)
    rate = float(ends_hz[1] - ends_hz[0]) / span
    phase = 2.0 * np.pi * (ends_hz[0] * time + 0.5 * rate * time**2)
    still = (residual[: count * block] * np.exp(-1j * phase)).reshape(count, block).sum(axis=1)
    samples = _LONGER * _BLOCKS
    tiles = count // samples
    still = still[: tiles * samples]
    seconds = block * record.period_s
    slow = seconds * np.arange(len(still))
    # a line of the short tiles knows its glide to a cell over the record; long tiles tell a quarter
    # of their own cell over their own length
    cell, step = 1.0 / (length * record.period_s), 0.5 / (samples * seconds)
    width = 1.0 / (_PAD * samples * seconds)
    reach = round(1.5 * cell / width)
    places = np.arange(-reach, reach + 1)
    best = (-np.inf, ends_hz)
    most = int(np.ceil(cell / step))
    for turn in range(-most, most + 1):
        more = turn * step / span
        table = (still * np.exp(-1j * np.pi * more * slow**2)).reshape(tiles, samples)
        spectrum = np.fft.fft(table, _PAD * samples, axis=1)[:, places]
        total = np.sum(2.0 * np.abs(spectrum) ** 2 / (samples * block), axis=0)
        at = int(np.argmax(total))
        first = float(ends_hz[0]) + float(places[at]) * width
        if total[at] > best[0] and first > cell:
            best = (float(total[at]), np.array([first, first + (rate + more) * span]))
    return best


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
