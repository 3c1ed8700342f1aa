"""Sines and exponentials by the kernel's series: the same bits on every machine."""

from __future__ import annotations

import numpy as np

from hdbench.records import FloatArray

__all__ = ["decay", "sines", "tail"]

# Taylor's to r^15 and r^16, their last terms spread over the others by Chebyshev's polynomial
_SINE = (
    1.5917529185277703e-10,
    -2.5051126335234744e-08,
    2.755731608291509e-06,
    -0.0001984126983672866,
    0.008333333333330932,
    -0.16666666666666666,
)
_COSINE = (
    -1.1382298940514779e-11,
    2.087614320648874e-09,
    -2.755731726081664e-07,
    2.4801587298749064e-05,
    -0.0013888888888887389,
    0.041666666666666664,
)


def tail(b: FloatArray) -> FloatArray:
    """Return 6 (exp(b) - 1 - b - b^2/2) / b^3."""
    b = np.minimum(b, 0.5)
    total = np.ones_like(b)
    for k in range(16, 3, -1):
        total = 1.0 + b * (1.0 / k) * total
    return total


def decay(a: FloatArray) -> FloatArray:
    """Return 1 - exp(-a) for a >= 0, by its series on [0, 1/4] and doublings."""
    small, doublings = np.minimum(a, 64.0), np.zeros(a.size, dtype=int)
    while (small > 0.25).any():
        doublings += small > 0.25
        small = np.where(small > 0.25, 0.5 * small, small)
    total = np.ones_like(small)
    for k in range(14, 1, -1):
        total = 1.0 - small * (1.0 / k) * total
    missing: FloatArray = small * total
    for done in range(int(doublings.max(initial=0))):
        missing = np.where(done < doublings, missing * (2.0 - missing), missing)
    return missing


def sines(angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return cosine and sine by the kernel's polynomials on quarter turns."""
    k = np.rint(angle * float.fromhex("0x1.45f306dc9c883p-1"))
    part1, part2 = float.fromhex("0x1.921fb5440p0"), float.fromhex("0x1.0b4611a60p-34")
    r = (angle - k * part1) - k * part2
    z = r * r
    s, c = np.full_like(z, _SINE[0]), np.full_like(z, _COSINE[0])
    for s_next, c_next in zip(_SINE[1:], _COSINE[1:], strict=True):
        s, c = s * z + s_next, c * z + c_next
    s = r + r * (z * s)
    c = 1.0 + (z * z * c - 0.5 * z)
    m = k - 4.0 * np.rint(k * 0.25)
    odd = m * m * (4.0 - m * m) * (1.0 / 3.0)
    side = m * odd
    axis = (1.0 - odd) * (1.0 - 0.5 * m * m)
    return axis * c - side * s, axis * s + side * c
