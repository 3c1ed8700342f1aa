"""The filter in NumPy: what runs where the C kernel was not compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hdbench.filter.layout import (
    ACCELERATION,
    ANGLE,
    HAS_ANGLE,
    HAS_VELOCITY,
    HEADER,
    SEEN,
    STARTED,
    TIME,
    USABLE,
    VELOCITY,
    VELOCITY_TIME,
)
from hdbench.records import FloatArray

__all__ = ["run"]

_CHUNK = 2048  # samples whose transition matrices are held at a time; changes memory only


def run(
    order: FloatArray,
    process_noise: FloatArray,
    misalignment: FloatArray,
    parameters: FloatArray,
    state: FloatArray,
    time_s: FloatArray,
    velocity_rad_s: FloatArray,
    torque_nm: FloatArray,
    angle_rad: FloatArray | None,
    torque_expected_nm: FloatArray,
    ripple_nm: FloatArray,
    misalignment_nm: FloatArray,
    torque_filtered_nm: FloatArray,
    /,
) -> int:
    """Filter samples in place; the C kernel's signature and, to rounding, its numbers.

    Parameters
    ----------
    order, process_noise, misalignment : ndarray, shape (n_blocks,)
        Cycles per motor turn; variance per sample, (N m)^2; 1 for an output-order block, else 0.
    parameters : ndarray, shape (4,)
        Measurement noise R, (N m)^2; load inertia J, kg m^2; gear ratio N, 1; time constant T, s.
    state : ndarray, shape (state_size(n_blocks),)
        Where the previous call ended; all zero at first. Changed in place.
    time_s, velocity_rad_s, torque_nm : ndarray, shape (n,)
        Samples; a value that is NaN or beyond 1e12 is missing.
    angle_rad : ndarray, shape (n,), or None
        Measured motor angle, unwrapped.
    torque_expected_nm, ripple_nm, misalignment_nm, torque_filtered_nm : ndarray, shape (n,)
        Outputs, N m.

    Returns
    -------
    int
        -1, or the first sample whose time is not finite or does not increase; then nothing changed.

    Notes
    -----
    ``x(k+1) = Phi x + K e``, ``P(k+1) = Q + (Phi - K C) P Phi'``,
    ``K = Phi P C' / (R + C P C')`` (report, equations 8-10), as measurement update and
    transition: the transition to a sample is done when that sample arrives, because it needs that
    sample's time.
    """
    bad = _first_bad_time(state, time_s)
    if bad >= 0:
        return bad
    filtering = _Recursion(order, process_noise, misalignment, float(parameters[0]), state)
    for start in range(0, time_s.size, _CHUNK):
        part = slice(start, start + _CHUNK)
        angle = None if angle_rad is None else angle_rad[part]
        turn, moving = _observe(
            state,
            parameters,
            (time_s[part], velocity_rad_s[part], angle),
            torque_expected_nm[part],
        )
        torque = torque_nm[part]
        known = np.abs(torque) <= USABLE
        residual = np.where(known & moving, torque - torque_expected_nm[part], math.nan)
        predicted = filtering.run(turn, residual.tolist())
        ripple_nm[part], misalignment_nm[part] = predicted
        torque_filtered_nm[part] = np.where(known, torque - (predicted[0] + predicted[1]), math.nan)
    filtering.store(state)
    return -1


def _first_bad_time(state: FloatArray, time_s: FloatArray) -> int:
    before = np.concatenate(([state[TIME] if state[SEEN] else -math.inf], time_s[:-1]))
    bad = ~(np.isfinite(time_s) & (time_s > before[: time_s.size]))
    return int(np.argmax(bad)) if bad.any() else -1


def _observe(
    state: FloatArray,
    parameters: FloatArray,
    samples: tuple[FloatArray, FloatArray, FloatArray | None],
    expected: FloatArray,
) -> tuple[list[float], NDArray[np.bool_]]:
    """Advance the motion part of `state` over time, velocity and angle; fill `expected`.

    Returns the motor turn into each sample, rad, and whether its velocity is known.
    """
    _, inertia, ratio, constant = parameters.tolist()
    motion = _Motion(state, constant)
    times, velocities = samples[0].tolist(), samples[1].tolist()
    angles = [math.nan] * len(times) if samples[2] is None else samples[2].tolist()
    turns = []
    for k, (time, velocity, angle) in enumerate(zip(times, velocities, angles, strict=True)):
        turns.append(motion.turn(time, angle))
        motion.accelerate(time, velocity)
        expected[k] = inertia * motion.values[ACCELERATION] / ratio
    state[:HEADER] = motion.values
    return turns, np.abs(samples[1]) <= USABLE


class _Motion:
    """The header of the state while one call runs, as plain floats."""

    def __init__(self, state: FloatArray, constant: float) -> None:
        self.values: list[float] = state[:HEADER].tolist()
        self.two_t = 2.0 * constant

    def turn(self, time: float, angle: float) -> float:
        """Return the motor turn from the previous sample to this one, rad."""
        values = self.values
        turned = 0.0
        if values[SEEN] and values[HAS_VELOCITY]:
            turned = values[VELOCITY] * (time - values[TIME])
        if abs(angle) <= USABLE:
            if values[HAS_ANGLE]:
                turned = angle - values[ANGLE]
            values[ANGLE], values[HAS_ANGLE] = angle, 1.0
        elif values[HAS_ANGLE]:
            values[ANGLE] += turned
        values[SEEN], values[TIME] = 1.0, time
        return turned

    def accelerate(self, time: float, velocity: float) -> None:
        """Difference the velocity by Tustin with the true period; hold where it is missing."""
        values = self.values
        if not abs(velocity) <= USABLE:
            return
        if values[HAS_VELOCITY]:
            dt = time - values[VELOCITY_TIME]
            change = velocity - values[VELOCITY]
            values[ACCELERATION] = (2.0 * change + (self.two_t - dt) * values[ACCELERATION]) / (
                self.two_t + dt
            )
        values[HAS_VELOCITY] = 1.0
        values[VELOCITY], values[VELOCITY_TIME] = velocity, time


class _Recursion:
    """Oscillator states `x` and covariance `P` while one call runs."""

    def __init__(
        self,
        order: FloatArray,
        process_noise: FloatArray,
        misalignment: FloatArray,
        measurement_noise: float,
        state: FloatArray,
    ) -> None:
        n = 2 * order.size
        self.order: list[float] = order.tolist()
        self.noise = np.diag(np.repeat(process_noise, 2))
        self.measurement_noise = measurement_noise
        self.C = np.zeros(n)
        self.C[::2] = 1.0
        self.outputs = np.zeros((2, n))
        self.outputs[0, ::2], self.outputs[1, ::2] = 1.0 - misalignment, misalignment
        self.started = bool(state[STARTED])
        self.x = state[HEADER : HEADER + n].copy()
        self.P = np.zeros((n, n))
        rows, columns = _packed(order.size)
        self.P[rows, columns] = state[HEADER + n :]
        self.P[columns, rows] = state[HEADER + n :]

    def run(self, turn: list[float], residual: list[float]) -> FloatArray:
        """Return predicted ripple and misalignment, shape (2, n); NaN residuals only predict."""
        predicted = np.zeros((2, len(turn)))
        for k, (phi, value) in enumerate(zip(self._transitions(turn), residual, strict=True)):
            known = not math.isnan(value)
            if self.started:
                self.x = phi @ self.x
                turned = phi @ self.P @ phi.T
                self.P = 0.5 * (turned + turned.T) + self.noise
                predicted[:, k] = self.outputs @ self.x
            elif known:
                self.started = True
                self.x, self.P = value * self.C, np.eye(self.C.size)
            if known:
                gain = self.P @ self.C
                variance = self.measurement_noise + float(self.C @ gain)
                innovation = value - float(self.C @ self.x)
                self.x = self.x + gain * (innovation / variance)
                self.P -= gain[:, None] * gain / variance
        return predicted

    def _transitions(self, turn: list[float]) -> FloatArray:
        """Return Phi of each transition, shape (n, states, states)."""
        phi = np.zeros((len(turn), self.C.size, self.C.size))
        for i, order in enumerate(self.order):
            angles = [order * value for value in turn]
            # one by one: the bits must not depend on where a sample stands in its block
            c = [math.cos(angle) if math.isfinite(angle) else 1.0 for angle in angles]
            s = [math.sin(angle) if math.isfinite(angle) else 0.0 for angle in angles]
            at = 2 * i
            phi[:, at, at] = phi[:, at + 1, at + 1] = c
            phi[:, at, at + 1] = s
            phi[:, at + 1, at] = np.negative(s)
        return phi

    def store(self, state: FloatArray) -> None:
        """Write `x` and `P` back in the kernel's layout."""
        if self.started:
            n = self.C.size
            state[STARTED] = 1.0
            state[HEADER : HEADER + n] = self.x
            state[HEADER + n :] = self.P[_packed(n // 2)]


def _packed(n_blocks: int) -> tuple[list[int], list[int]]:
    """Rows and columns of P in the order the state vector holds them."""
    rows, columns = [], []
    for i in range(n_blocks):
        rows += [2 * i, 2 * i, 2 * i + 1]
        columns += [2 * i, 2 * i + 1, 2 * i + 1]
    for i in range(n_blocks):
        for j in range(i + 1, n_blocks):
            rows += [2 * i, 2 * i, 2 * i + 1, 2 * i + 1]
            columns += [2 * j, 2 * j + 1, 2 * j, 2 * j + 1]
    return rows, columns
