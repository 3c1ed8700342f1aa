"""What comes and goes or glides: short bursts of any height, tones whose frequency moves."""

from __future__ import annotations

import numpy as np
from scipy.special import gammaincc, ndtr

from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.naming.left import Left
from hdbench.diagnosis.noise.whitened import Space
from hdbench.records.trace import FloatArray

__all__ = ["bursts", "gliding_tones"]

# lengths of a burst, samples, a factor of two apart: between two of them it keeps 84 % of its
# signal to noise
_WIDTHS = (4, 8, 16, 32, 64, 128)
# a window of which less than this share is left beside what is explained shows no burst
_MIN_SHARE = 0.5
# a gliding tone is followed over tiles of half a second: at 3 Hz/s it stays within one bin
_TILE_S = 0.5
_SHORTEST_TILE = 64
_LEAST_TILES = 12
# bins per resolution cell: a tone between two bins keeps 90 %
_PAD = 2


def bursts(space: Space, record: Record, noise_nm: float) -> Left | None:
    r"""Return the strongest burst: a torque that is there for 4 to 128 samples and gone again.

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
        Its middle and its ends, s; None for a record shorter than ten of the longest bursts.

    Notes
    -----
    The numerator is a difference of sums of the residual pulled back through the whitening; its
    square over the whitened window is chi^2 with one degree of freedom. The largest of n windows of
    w samples has

    .. math:: P(\max z > c) \le 2 n \min(1, c^2 / w) Q(c)

    for windows that slide (Siegmund 1985, section 8), bounded over the widths by their sum.
    """
    count = len(space.pull)
    if count < 10 * _WIDTHS[-1]:
        return None
    sums = np.concatenate([[0.0], np.cumsum(space.pull)])
    basis = np.vstack(
        [np.zeros((1, space.pull_basis.shape[1])), np.cumsum(space.pull_basis, axis=0)]
    )
    known = np.concatenate([[0], np.cumsum(space.whitener.used)])
    best: tuple[float, int, int, float] | None = None
    chance = 0.0
    for width in _WIDTHS:
        whole = _window_size(space, width)
        explained = basis[width:] - basis[:-width]
        left = whole - np.einsum("nk,nk->n", explained, explained)
        usable = (left > _MIN_SHARE * whole) & (known[width:] - known[:-width] == width)
        if not usable.any():
            continue
        z = np.where(
            usable, (sums[width:] - sums[:-width]) / np.sqrt(np.maximum(left, 1e-300)), 0.0
        )
        at = int(np.argmax(np.abs(z)))
        if best is None or abs(z[at]) > abs(best[0]):
            best = (float(z[at]), at, width, whole)
    if best is None:
        return None
    value, at, width, whole = best
    chance = sum(2.0 * count * min(1.0, value**2 / w) * float(ndtr(-abs(value))) for w in _WIDTHS)
    times = record.motion.time_s[at : at + width]
    height = abs(value) / np.sqrt(whole)
    return Left(
        "time",
        "s",
        float(np.median(times)),
        (float(times[0]), float(times[-1])),
        float(height),
        min(1.0, chance),
        float(height**2 * width / count),
    )


def _window_size(space: Space, width: int) -> float:
    """Return the whitened size squared of a torque of 1 N m that lasts `width` samples."""
    whitener = space.whitener
    white = np.convolve(whitener.kernel[: 64 * width], np.ones(width))
    return float(white @ white) / whitener.std**2


def gliding_tones(space: Space, record: Record, noise_nm: float) -> Left | None:
    """Return the strongest tone whose frequency rises or falls evenly over the record.

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
    frequency; the sum over m tiles of white noise is chi^2 with 2 m degrees of freedom.
    """
    length = max(round(_TILE_S / record.period_s), _SHORTEST_TILE)
    whole = len(space.residual) // length
    if whole < _LEAST_TILES:
        return None
    table = space.residual[: whole * length].reshape(whole, length)
    powers = 2.0 * np.abs(np.fft.rfft(table, _PAD * length, axis=1)[:, _PAD:-_PAD]) ** 2 / length
    value, start, end, tried = _best_line(powers)
    hertz = (np.array([start, end]) + _PAD) / (_PAD * length * record.period_s)
    chance = min(1.0, tried * float(gammaincc(whole, 0.5 * value)))
    # an unbiased amplitude: two of each tile are the noise's own
    amplitude = noise_nm * float(np.sqrt(max(value - 2.0 * whole, 0.0) * 2.0 / (whole * length)))
    return Left(
        "frequency",
        "Hz",
        float(hertz.mean()),
        (float(hertz.min()), float(hertz.max())),
        amplitude,
        chance,
        0.5 * amplitude**2,
    )


def _best_line(powers: FloatArray) -> tuple[float, int, int, int]:
    """Return the largest sum along a line, its bins at both ends, and the lines tried."""
    tiles, bins = powers.shape
    share = np.linspace(0.0, 1.0, tiles)
    best, tried = (-np.inf, 0, 0), 0
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
        if total[at] > best[0]:
            best = (float(total[at]), first + at, first + at + drift)
    return (*best, tried)
