"""Transition and process noise of every block over one sample.

Sines and exponentials are the kernel's series, so that a steady response has the same digits on
every machine.
"""

from __future__ import annotations

import math

import numpy as np

from hdbench.filter.kalman import block_rows
from hdbench.records import FloatArray

_WALK, _INTEGRATED, _ORNSTEIN, _MATERN, _RESONANCE = range(1, 6)
_REDUCIBLE = 1e5  # rad: up to here quarter turns are taken off exactly
_WITHIN = 32.0  # rad: beyond, a turn loses its whole turns
_PER_TURN = float.fromhex("0x1.45f306dc9c883p-3")
_TURN = float.fromhex("0x1.921fb5440p2"), float.fromhex("0x1.0b4611a60p-32")
_PER_QUARTER = float.fromhex("0x1.45f306dc9c883p-1")
_QUARTER = float.fromhex("0x1.921fb5440p0"), float.fromhex("0x1.0b4611a60p-34")
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


def transitions(packed: FloatArray, turn: float, dt: float) -> FloatArray:
    """Return f11, f12, f21, f22, q11, q12, q22 of every block in the axes of its torque."""
    rows = []
    for row in block_rows(packed):
        kind, _, order, omega, q_sample, q_rad, q_s, *_ = row
        if kind > 0:
            rows.append(slow_transition(row, dt))
            continue
        cosine, sine = _sines(order * turn + omega * dt)
        noise = (q_sample + q_rad * abs(turn)) + q_s * dt
        rows.append((cosine, sine, -sine, cosine, noise, 0.0, noise))
    return np.array(rows)


def slow_transition(row: list[float], dt: float) -> tuple[float, ...]:
    """Return f11, f12, f21, f22, q11, q12, q22 of a slow torque; `row` is of the packed model."""
    kind, _, damped, omega, q_sample, _, q_s, rate, variance, *_ = row
    if kind == _WALK:
        return 1.0, 0.0, 0.0, 0.0, q_sample + q_s * dt, 0.0, 0.0
    if kind == _INTEGRATED:
        q = q_s * dt
        return 1.0, dt, 0.0, 1.0, q * dt * dt * (1.0 / 3.0), q * dt * 0.5, q
    a = rate * dt
    missing = _decay(a)
    e = 1.0 - missing
    if kind == _ORNSTEIN:
        return e, 0.0, 0.0, 0.0, variance * (missing * (1.0 + e)), 0.0, 0.0
    b = 2.0 * a
    lost = _decay(b)
    left = 1.0 - lost
    if kind == _MATERN:
        f1 = left * (b * b * b * (1.0 / 6.0) * _tail(b))
        if b > 0.5:
            f1 = 1.0 - left * (1.0 + b + 0.5 * b * b)
        return (
            e * (1.0 + a),
            e * dt,
            -(rate * a * e),
            e * (1.0 - a),
            variance * f1,
            variance * rate * (2.0 * a * a * left),
            variance * rate * rate * (2.0 * b * left + f1),
        )
    w2 = omega * omega
    c, s = _sines(_within(damped * dt))
    s = s / damped
    zs = rate * s
    pull = 2.0 * zs * left
    q1 = lost - pull * (c + zs)
    return (
        e * (c + zs),
        e * s,
        -(w2 * (e * s)),
        e * (c - zs),
        variance * max(q1, 0.0),
        variance * w2 * (pull * s),
        variance * w2 * (lost + pull * (c - zs)),
    )


def _within(turn: float) -> float:
    """Return the turn of one sample less its whole turns; 0 where it is not finite."""
    if abs(turn) <= _WITHIN:
        return turn
    if abs(turn) <= _REDUCIBLE:
        whole = round(turn * _PER_TURN)
        return (turn - whole * _TURN[0]) - whole * _TURN[1]
    return math.atan2(math.sin(turn), math.cos(turn)) if math.isfinite(turn) else 0.0


def _sines(angle: float) -> tuple[float, float]:
    """Return cosine and sine by polynomials on quarter turns."""
    k = round(angle * _PER_QUARTER)
    r = (angle - k * _QUARTER[0]) - k * _QUARTER[1]
    z = r * r
    s, c = _SINE[0], _COSINE[0]
    for more_s, more_c in zip(_SINE[1:], _COSINE[1:], strict=True):
        s, c = s * z + more_s, c * z + more_c
    s = r + r * (z * s)
    c = 1.0 + (z * z * c - 0.5 * z)
    return ((c, s), (-s, c), (-c, -s), (s, -c))[k % 4]


def _decay(a: float) -> float:
    """Return 1 - exp(-a) for a >= 0, by its series on [0, 1/4] and doublings."""
    small, doublings = min(a, 64.0), 0
    while small > 0.25:
        small, doublings = 0.5 * small, doublings + 1
    total = 1.0
    for k in range(14, 1, -1):
        total = 1.0 - small * (1.0 / k) * total
    missing = small * total
    for _ in range(doublings):
        missing = missing * (2.0 - missing)
    return missing


def _tail(b: float) -> float:
    """Return 6 (exp(b) - 1 - b - b^2/2) / b^3 for b <= 1/2."""
    b, total = min(b, 0.5), 1.0
    for k in range(16, 3, -1):
        total = 1.0 + b * (1.0 / k) * total
    return total
