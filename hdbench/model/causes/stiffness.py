"""Flexspline that is stiffer at high torque: gauges read its twist, not the torque behind it."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from hdbench.model.causes._memory import (
    even_step,
    first_order,
    remembered,
    second_order,
    spread_out,
)
from hdbench.model.causes._needs import all_of, loaded
from hdbench.model.causes._parts import (
    RATIO_LIMIT,
    REFERENCE_LOAD_NM,
    no_shape,
)
from hdbench.model.causes._twins import ComplexArray
from hdbench.model.definition import Cause, Parameter
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = ["CUBIC_STIFFNESS", "PIECEWISE_STIFFNESS"]

# stiffness at small torque of a size 20 drive of ratio 100, N m/rad: sets where the load's own
# resonance lies (150 Hz), above which the twist no longer follows the torque
_STIFFNESS_NM_PER_RAD = 1.6e4
# quality factors of 10 to 25 are common on such drives: the middle
_DAMPING = 0.03
# second over first knee of the catalogue's sizes 14 to 25: 3.1 to 3.6 ...
_SECOND_KNEE = 3.4
# ... and of any spring whose two knees can be told apart
_KNEE_RATIOS = (1.4, 5.0)
# the catalogue's first knee is at 0.16 to 0.26 of the rated torque; torques up to 1.6 times the
# rated one
_FIRST_KNEE = 0.1
# a record sampled slower than this is a list of readings: there it is cubic-nonlinearity
_SLOWEST_S = 0.1

Law = Callable[[FloatArray], FloatArray]


def low_pass(time: FloatArray, starts: NDArray[np.bool_], natural: float) -> Law:
    """Return w^2 / (s^2 + 2 zeta w s + w^2) for torques that are linear between samples.

    A start is taken as rest at its torque.
    """
    pole = natural * complex(-_DAMPING, np.sqrt(1.0 - _DAMPING * _DAMPING))
    scale = natural * natural / pole.imag
    even = even_step(time, starts, pole)
    if even is not None:
        return _even_low_pass(pole, scale, even, starts)
    step = np.where(starts, 0.0, np.diff(time, prepend=time[:1]))
    decay, gain, ramp = _over_step(pole, step)
    decay[starts] = 0.0

    def passed(torque: FloatArray) -> FloatArray:
        before = np.concatenate((torque[:1], torque[:-1]))
        drive = gain * before + ramp * (torque - before)
        drive[starts] = -torque[starts] / pole
        return np.asarray((scale * first_order(decay, drive)).imag)

    return passed


def _over_step(pole: complex, step: FloatArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Return what a step leaves, and the response to a torque of 1 and to one that rises by 1."""
    decay = np.exp(pole * step)
    gain = (decay - 1.0) / pole
    # nothing rises at a start
    ramp = (gain - step) / (pole * np.where(step > 0.0, step, 1.0))
    return decay, gain, ramp


def _even_low_pass(pole: complex, scale: float, step: float, starts: NDArray[np.bool_]) -> Law:
    """Return the same for samples a step apart: both poles in one recursion of real numbers."""
    decay, gain, ramp = (complex(part[0]) for part in _over_step(pole, np.array([step])))
    other = decay.conjugate()
    rest = gain - ramp
    above = scale * np.array([ramp, rest - ramp * other, -rest * other]).imag
    below = np.array([-2.0 * decay.real, abs(decay) ** 2])

    def passed(torque: FloatArray) -> FloatArray:
        return second_order(above, below, starts, torque)

    return passed


def _columns(motion: Motion, laws: tuple[Law, ...]) -> FloatArray:
    """Return what each deviation of the twist from a straight line takes from the reading."""
    applied = motion.applied_nm
    at, starts = remembered(motion, applied)
    inertia = motion.inertia_nm_s2 * motion.gear_ratio
    torque = applied[at]
    if inertia > 0.0:
        natural = float(np.sqrt(_STIFFNESS_NM_PER_RAD / inertia))
        passed = low_pass(motion.time_s[at], starts, natural)
        parts = [-passed(law(passed(torque))) for law in laws]
    else:
        parts = [-law(torque) for law in laws]
    return np.column_stack([spread_out(part, at, len(motion)) for part in parts])


def _cube(torque: FloatArray) -> FloatArray:
    return np.asarray(torque * (torque / REFERENCE_LOAD_NM) ** 2)


def _cubic(motion: Motion) -> FloatArray:
    return _columns(motion, (_cube,))


def _beyond(knee: float) -> Law:
    def law(torque: FloatArray) -> FloatArray:
        return np.asarray(torque - np.clip(torque, -knee, knee))

    return law


def _piecewise(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    knee = shape["knee_nm"]
    return _columns(motion, (_beyond(knee), _beyond(shape["knee_ratio"] * knee)))


def _sampled(motion: Motion) -> str | None:
    period = float(np.median(np.diff(motion.time_s))) if len(motion) > 1 else np.inf
    if period <= _SLOWEST_S:
        return None
    return (
        f"one sample per {period:.3g} s; needed: {_SLOWEST_S:g} s or less, readings show a spring "
        "that is no straight line as cubic-nonlinearity"
    )


def _knee_reach(motion: Motion) -> dict[str, tuple[float, float]]:
    torque = np.abs(motion.applied_nm[motion.valid & np.isfinite(motion.applied_nm)])
    largest = float(torque.max(initial=0.0))
    # a knee beyond the largest torque is never reached; one near zero leaves a straight line
    return {"knee_nm": (_FIRST_KNEE * largest, largest)}


CUBIC_STIFFNESS = Cause(
    name="cubic-stiffness",
    equation="y = K_1 phi, J phi'' + d phi' + K_1 phi + s K_1 phi (K_1 phi / 10 N m)^2 = tau, to "
    "first order in s",
    shape=(),
    linear=(
        # makers' K_1 < K_2 < K_3: softening is a matter of the sensor, cubic-nonlinearity
        Parameter(
            "stiffening",
            "1",
            0.0,
            RATIO_LIMIT,
            f"relative fall of the twist at {REFERENCE_LOAD_NM:g} N m, s",
        ),
    ),
    locked_to="load",
    parity="odd in load",
    channel="mechanical",
    look_alikes=("cubic-nonlinearity", "piecewise-stiffness", "saturation"),
    experiment="locked ramps of torque to the rated one with an output encoder; a fast torque sine "
    "about three loads",
    source="tau = k_1 phi + k_3 phi^3; gauges on the flexspline read its twist",
    columns=no_shape(_cubic),
    harmonic=False,
    # a spring that is stiffer at high torque is a straight one without a load
    applicable=all_of(loaded, _sampled),
)
PIECEWISE_STIFFNESS = Cause(
    name="piecewise-stiffness",
    equation="y = K_1 phi = tau - d_1 dz(tau, T_1) - d_2 dz(tau, T_2) behind the load's resonance, "
    "dz(tau, T) = tau - clip(tau, -T, T)",
    shape=(
        Parameter("knee_nm", "N m", 0.1, 500.0, "torque at the first change of stiffness, T_1"),
        Parameter(
            "knee_ratio",
            "1",
            *_KNEE_RATIOS,
            "torque at the second change over that at the first, T_2 / T_1",
            default=_SECOND_KNEE,
        ),
    ),
    linear=(
        # a flexspline whose teeth engage becomes stiffer, never softer
        Parameter("first_change", "1", 0.0, RATIO_LIMIT, "1 - K_1 / K_2, d_1"),
        Parameter("second_change", "1", 0.0, RATIO_LIMIT, "K_1 / K_2 - K_1 / K_3, d_2"),
    ),
    locked_to="load",
    parity="odd in load",
    channel="mechanical",
    look_alikes=("cubic-stiffness", "cubic-nonlinearity", "saturation"),
    experiment="locked ramps of torque to the rated one in fifty steps with an output encoder",
    source="maker's K_1, K_2, K_3 over three ranges of torque; gauges on the flexspline read its "
    "twist",
    columns=_piecewise,
    harmonic=False,
    applicable=all_of(loaded, _sampled),
    reach=_knee_reach,
)
