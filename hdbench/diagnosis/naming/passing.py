"""What comes and goes: short bursts of any height."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.naming.left import Left
from hdbench.diagnosis.noise.whitened import Space

__all__ = ["bursts"]

# lengths of a burst, samples, a factor of two apart: between two of them it keeps 84 % of its
# signal to noise
_WIDTHS = (4, 8, 16, 32, 64, 128)
# a window of which less than this share is left beside what is explained shows no burst
_MIN_SHARE = 0.5


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
