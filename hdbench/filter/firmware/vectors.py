"""Test vectors: samples with everything that a filter meets, and what it must answer."""

from __future__ import annotations

import math

import numpy as np

from hdbench.filter.firmware.header import real
from hdbench.filter.kalman import new_state, run
from hdbench.filter.statespace import StateSpace
from hdbench.records import FloatArray

__all__ = ["check_samples", "vector_header"]

_SAMPLES = 600
_TOLERANCE_NM = 1e-3  # a float carries 24 bits; the acceptance of ten minutes at 1 kHz


def check_samples(n: int, sample_period_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return samples: start from rest, reversal, standstill, missing samples, a spike."""
    time = np.arange(n, dtype=np.float64) * float(np.float32(sample_period_s))
    share = np.arange(n) / n
    velocity = 156.0 * np.sin(2.0 * np.pi * 1.5 * share)
    velocity[(share > 0.4) & (share < 0.5)] = 0.0
    angle = np.concatenate([[0.0], np.cumsum(velocity[:-1] * np.diff(time))])
    torque = 0.4 * np.cos(2.0 * angle + 0.6) + 0.2 * np.cos(4.0 * angle - 1.1)
    torque += 0.9 * np.cos(0.01 * angle + 0.3)
    # noise that needs no generator: the fractional parts of multiples of the golden ratio
    torque += 0.05 * np.sqrt(12.0) * (np.arange(n) * 0.6180339887498949 % 1.0 - 0.5)
    torque[n // 3 : n // 3 + n // 100] = np.nan
    torque[n // 5] += 20.0
    exact = [values.astype(np.float32).astype(np.float64) for values in (velocity, torque)]
    return time, exact[0], exact[1]


def unresolved_tolerance_nm(space: StateSpace) -> float:
    r"""Return how far a float may be off while it still finds out what the torque is made of.

    Notes
    -----
    A float rounds the variance :math:`P_0` known before the data by :math:`2^{-24} P_0` in each of
    the n blocks' sums. Once the data leave R of it, the gain is wrong by the share
    :math:`n 2^{-24} P_0 / R`, which moves the estimate by that share of :math:`\sqrt R`:
    :math:`n 2^{-24} P_0 / \sqrt R`, added to what is allowed afterwards.
    """
    before = max((b.prior_variance if space.start == "prior" else 1.0) for b in space.blocks)
    share = len(space.blocks) * 2.0**-24
    return _TOLERANCE_NM + share * before / math.sqrt(space.measurement_noise)


def vector_header(space: StateSpace, sample_period_s: float) -> str:
    """Return the header with test vectors of a model."""
    time, velocity, torque = check_samples(_SAMPLES, sample_period_s)
    answer = run(space, new_state(space), time, velocity, torque)
    lines = [
        "/* Samples, and what the filter of the host answers in double precision. */",
        "#ifndef HDB_VECTORS_H",
        "#define HDB_VECTORS_H",
        "",
        f"#define HDB_VECTORS {_SAMPLES}",
        f"#define HDB_TOLERANCE ({real(_TOLERANCE_NM)}) /* N m */",
        f"#define HDB_TOLERANCE_UNRESOLVED ({real(unresolved_tolerance_nm(space))})",
        "",
    ]
    for name, values in (
        ("velocity", velocity),
        ("torque", torque),
        ("filtered", answer.torque_filtered_nm),
        ("variance", answer.innovation_variance_nm2),
    ):
        lines.append(f"static const hdb_real hdb_vector_{name}[HDB_VECTORS] = {{")
        lines += [f"    {real(value)}," for value in values.tolist()]
        lines += ["};", ""]
    lines += ["static const unsigned char hdb_vector_flag[HDB_VECTORS] = {"]
    lines += [f"    {value}," for value in answer.flags.tolist()]
    return "\n".join([*lines, "};", "", "#endif", ""])
