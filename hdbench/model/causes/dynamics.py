"""Causes of friction and of what lags, bends or rings: functions of velocity and torque."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hdbench.model.causes._memory import (
    ComplexArray,
    even_step,
    first_order,
    remembered,
    second_order,
    spread_out,
)
from hdbench.model.causes._parts import (
    REFERENCE_LOAD_NM,
    STANDING_RAD_S,
    Computed,
    Shape,
    accelerates,
    all_of,
    largest_size,
    loaded,
    moves_and_reverses,
    reverses,
    single,
    size_of_speed_varies,
    speed_varies,
)
from hdbench.model.causes.sensor import whole_signal
from hdbench.model.localfit import delayed
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

# ends of the catalogue's domains of the transition and of the Stribeck speed
_SLOWEST_RAD_S, _FASTEST_RAD_S = 0.05, 80.0
# friction has its whole sign before it falls: tanh 5 = 0.9999
_WHOLE_SIGN = 5.0
# samples slower than the Stribeck speed's domain that a record must have to show the effect
_SLOW_SAMPLES = 20


def _direction(motion: Motion, shape: Shape) -> FloatArray:
    """Return the sign of the speed, rounded at the reversal."""
    return np.asarray(np.tanh(motion.velocity_rad_s / shape["transition_rad_s"]))


def _stribeck(motion: Motion, shape: Shape) -> FloatArray:
    speed, fall = motion.velocity_rad_s, shape["stribeck_rad_s"]
    turn = min(shape["transition_rad_s"], fall / _WHOLE_SIGN)
    return single(np.exp(-((speed / fall) ** 2)) * np.tanh(speed / turn))


def _asymmetric(motion: Motion, _: Shape) -> FloatArray:
    size = np.abs(motion.velocity_rad_s)
    return np.column_stack((np.tanh(size / STANDING_RAD_S), size))


def _moves_slowly(motion: Motion) -> str | None:
    speed = np.abs(motion.velocity_rad_s[motion.valid])
    slow = int(((speed > _SLOWEST_RAD_S) & (speed < _FASTEST_RAD_S)).sum())
    if slow >= _SLOW_SAMPLES:
        return None
    return (
        f"{slow} samples move slower than {_FASTEST_RAD_S:g} rad/s; needed: {_SLOW_SAMPLES} to "
        "see friction fall with speed"
    )


def _fall_is_seen(motion: Motion) -> dict[str, tuple[float, float]]:
    """Return the Stribeck speeds whose double was reached: there 2 % of the excess is left."""
    largest = largest_size(motion.velocity_rad_s, motion)
    return {"stribeck_rad_s": (0.0, 0.5 * largest)}


def _presliding(motion: Motion, shape: Shape) -> FloatArray:
    at, starts = remembered(motion, motion.angle_rad)
    way = np.diff(motion.angle_rad[at], prepend=motion.angle_rad[at[:1]])
    left = np.where(starts, 0.0, np.exp(-np.abs(way) / shape["breakaway_rad"]))
    speed = motion.velocity_rad_s[at]
    begin = np.where(np.abs(speed) > STANDING_RAD_S, np.sign(speed), 0.0)
    state = first_order(left, np.where(starts, begin, np.sign(way) * (1.0 - left)))
    return single(spread_out(state, at, len(motion)))


# neither two channels of one converter nor a filter of a bench delay by more than this
_SLOWEST_S = 0.1
# two channels of one bench differ by 0.1 to 3 ms; no further, so that a delay stays within a
# period of the fastest ripple
_LARGEST_DELAY_S = 0.005
# below this a shift is its first term to 1e-4 at the highest frequency that 1 kHz holds
_INFINITESIMAL_S = 1e-7
# stiffness at small torque of a size 20 drive of ratio 100, N m/rad: sets where the load's own
# resonance lies (150 Hz), above which the twist no longer follows the torque
_STIFFNESS_NM_PER_RAD = 1.6e4
# quality factors of 10 to 25 are common on such drives: the middle
_DAMPING = 0.03
# the catalogue's first knee is at 0.16 to 0.26 of the rated torque; torques up to 1.6 times the
# rated one
_FIRST_KNEE = 0.1
# a record sampled slower than this is a list of readings: there it is cubic-nonlinearity
_SLOWEST_RECORD_S = 0.1
Law = Callable[[FloatArray], FloatArray]


def _skew(motion: Motion, shape: Shape) -> FloatArray:
    delay = shape["delay_s"]
    if abs(delay) < _INFINITESIMAL_S:
        delay = _INFINITESIMAL_S
    torque = np.where(motion.valid, whole_signal(motion), np.nan)
    return single((delayed(motion.time_s, torque, delay) - torque) / delay)


def _changes(motion: Motion) -> str | None:
    torque = whole_signal(motion)
    known = torque[motion.valid & np.isfinite(torque)]
    if not (len(known) > 1 and float(np.ptp(known)) > 0.0):
        return "the simulated torque is constant; needed: a torque that changes"
    period = float(np.median(np.diff(motion.time_s)))
    if period <= _SLOWEST_S:
        return None
    return f"one sample in {period:.3g} s; needed: one in {_SLOWEST_S:g} s to see a delay"


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


def _beyond(knee: float) -> Law:
    def law(torque: FloatArray) -> FloatArray:
        return np.asarray(torque - np.clip(torque, -knee, knee))

    return law


def _piecewise(motion: Motion, shape: Shape) -> FloatArray:
    knee = shape["knee_nm"]
    return _columns(motion, (_beyond(knee), _beyond(shape["knee_ratio"] * knee)))


def _sampled(motion: Motion) -> str | None:
    period = float(np.median(np.diff(motion.time_s))) if len(motion) > 1 else np.inf
    if period <= _SLOWEST_RECORD_S:
        return None
    return (
        f"one sample per {period:.3g} s; needed: {_SLOWEST_RECORD_S:g} s or less, readings show a "
        "spring that is no straight line as cubic-nonlinearity"
    )


def _knee_reach(motion: Motion) -> dict[str, tuple[float, float]]:
    largest = largest_size(motion.applied_nm, motion)
    # a knee beyond the largest torque is never reached; one near zero leaves a straight line
    return {"knee_nm": (_FIRST_KNEE * largest, largest)}


COMPUTED = {
    "coulomb-friction": Computed(lambda m, s: single(_direction(m, s)), moves_and_reverses),
    "viscous-friction": Computed(lambda m, _: single(m.velocity_rad_s), speed_varies),
    "stribeck-friction": Computed(
        _stribeck, all_of(moves_and_reverses, _moves_slowly), _fall_is_seen
    ),
    "asymmetric-friction": Computed(_asymmetric, all_of(reverses, size_of_speed_varies)),
    "load-dependent-friction": Computed(
        lambda m, s: single(np.abs(m.applied_nm) * _direction(m, s)),
        all_of(moves_and_reverses, loaded),
    ),
    "presliding": Computed(_presliding, moves_and_reverses),
    "inertia-error": Computed(
        lambda m, _: single(m.acceleration_rad_s2 / m.gear_ratio), accelerates
    ),
    "time-skew": Computed(
        _skew, _changes, reach=lambda _: {"delay_s": (-_LARGEST_DELAY_S, _LARGEST_DELAY_S)}
    ),
    "cubic-stiffness": Computed(lambda m, _: _columns(m, (_cube,)), all_of(loaded, _sampled)),
    "piecewise-stiffness": Computed(_piecewise, all_of(loaded, _sampled), reach=_knee_reach),
}
