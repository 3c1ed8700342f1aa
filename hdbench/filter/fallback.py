"""NumPy form of the kernel: transitions, recursion and smoother of the blocks."""

from __future__ import annotations

import math

import numpy as np

from hdbench.filter.kalman import (
    ACCELERATION,
    ANGLE,
    GATED,
    GATED_RUN,
    HAS_ANGLE,
    HAS_VELOCITY,
    HEADER,
    INVERSE,
    MISSING,
    PRIOR,
    SEEN,
    STARTED,
    STEP,
    TIME,
    UNRESOLVED,
    USABLE,
    VELOCITY,
    VELOCITY_TIME,
    Arrays,
    block_rows,
    new_state,
)
from hdbench.records import FloatArray

_WALK, _INTEGRATED, _ORNSTEIN, _MATERN, _RESONANCE = range(1, 6)


def transitions(packed: FloatArray, turn: float, dt: float) -> FloatArray:
    """Return f11, f12, f21, f22, q11, q12, q22 of every block in the axes of its torque."""
    rows = []
    for row in block_rows(packed):
        kind, _, order, omega, q_sample, q_rad, q_s, *_ = row
        if kind > 0:
            rows.append(slow_transition(row, dt))
            continue
        angle = order * turn + omega * dt
        cosine, sine = math.cos(angle), math.sin(angle)
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
    missing = -math.expm1(-a)
    e = 1.0 - missing
    if kind == _ORNSTEIN:
        return e, 0.0, 0.0, 0.0, variance * (missing * (1.0 + e)), 0.0, 0.0
    b = 2.0 * a
    lost = -math.expm1(-b)
    left = 1.0 - lost
    if kind == _MATERN:
        from scipy.special import gammainc

        # 1 - (1 + b + b^2/2) exp(-b), without its cancellation
        f1 = float(gammainc(3.0, b))
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
    turn = damped * dt
    c, s = math.cos(turn), math.sin(turn) / damped
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


_CHUNK = 2048  # samples whose transitions are held at a time
_RESOLVED = 200.0  # a block with more innovation variances is not known from the data


class _Filter:
    """Phases psi, states z in axes that rest, and their covariance p, while one call runs."""

    def __init__(self, packed: FloatArray, state: FloatArray) -> None:
        self.rows = block_rows(packed)
        self.oscillators, n = int(packed[0]), len(self.rows)
        self.r, self.gate, self.gate_samples, self.prior_start = packed[[2, 6, 7, 8]].tolist()
        self.motion = packed[3:6].tolist()
        self.head: list[float] = state[:HEADER].tolist()
        psi, z, g, packed_p = np.split(state[HEADER:], (2 * n, 4 * n, 6 * n))
        self.psi = psi[: self.oscillators].copy()
        p = np.zeros((2 * n, 2 * n))
        p[np.tril_indices(2 * n)] = packed_p
        p += np.tril(p, -1).T
        # what the compiled kernel leaves to do of its last measurement
        self.z: FloatArray = z + g * self.head[STEP]
        self.p: FloatArray = p - self.head[INVERSE] * np.outer(g, g)
        self.used, self.logs, self.squares = 0, 0.0, 0.0

    def store(self, state: FloatArray) -> None:
        """Write the state in the kernel's layout, no measurement left to do."""
        n = len(self.rows)
        self.head[INVERSE] = self.head[STEP] = 0.0
        state[:] = 0.0
        state[:HEADER] = self.head
        state[HEADER : HEADER + self.oscillators] = self.psi
        state[HEADER + 2 * n : HEADER + 4 * n] = self.z
        state[HEADER + 6 * n :] = self.p[np.tril_indices(2 * n)]

    def observe(
        self, time: FloatArray, velocity: FloatArray, angle: FloatArray | None
    ) -> FloatArray:
        """Return motor turn, time and expected torque of every sample, shape (3, n)."""
        inertia, ratio, constant = self.motion
        head, two_t, found = self.head, 2.0 * constant, np.empty((3, time.size))
        angles = np.full(time.size, math.nan) if angle is None else angle
        rows = zip(time.tolist(), velocity.tolist(), angles.tolist(), strict=True)
        for k, (t, v, a) in enumerate(rows):
            dt = t - head[TIME] if head[SEEN] else 0.0
            turned = head[VELOCITY] * dt if head[SEEN] and head[HAS_VELOCITY] else 0.0
            if abs(a) <= USABLE:
                turned = a - head[ANGLE] if head[HAS_ANGLE] else turned
                head[ANGLE], head[HAS_ANGLE] = a, 1.0
            elif head[HAS_ANGLE]:
                head[ANGLE] += turned
            head[SEEN], head[TIME] = 1.0, t
            if abs(v) <= USABLE:
                if head[HAS_VELOCITY]:
                    gap = t - head[VELOCITY_TIME]
                    rise = 2.0 * (v - head[VELOCITY]) + (two_t - gap) * head[ACCELERATION]
                    head[ACCELERATION] = rise / (two_t + gap)
                head[HAS_VELOCITY], head[VELOCITY], head[VELOCITY_TIME] = 1.0, v, t
            expected = inertia / ratio * head[ACCELERATION]
            found[:, k] = turned if math.isfinite(turned) else 0.0, dt, expected
        return found

    def steps(self, turn: FloatArray, dt: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return what each state is seen through, oscillators' noise, slow transitions."""
        table = np.array(self.rows)[: self.oscillators]
        order, omega, q_sample, q_rad, q_s = table[:, 2:7].T
        turns, psi = np.outer(turn, order) + np.outer(dt, omega), self.psi
        # a turn so far is a fault; less its whole turns it is exact
        far = np.arctan2(np.sin(turns), np.cos(turns))
        turns = np.where(np.abs(turns) > 32.0, far, turns)
        phases = np.empty_like(turns)
        for k, step in enumerate(turns):
            # sample by sample, so that splitting a record changes no bit
            phases[k] = psi = np.remainder(psi + step, 2.0 * np.pi)
        self.psi = psi
        seen = np.zeros((turn.size, 2 * len(self.rows)))
        seen[:, ::2] = 1.0
        axes = np.stack((np.cos(phases), np.sin(phases)), axis=2)
        seen[:, : 2 * self.oscillators] = axes.reshape(turn.size, -1)
        noise = q_sample + np.outer(np.abs(turn), q_rad) + np.outer(dt, q_s)
        periods, at = np.unique(dt, return_inverse=True)
        slow = self.rows[self.oscillators :]
        drifts = np.array([[slow_transition(row, d) for row in slow] for d in periods.tolist()])
        return seen, noise, drifts.reshape(periods.size, -1, 7)[at]

    def predict(self, noise: FloatArray, drifts: FloatArray) -> None:
        """Do z <- F z, P <- F P F' + Q; P stays symmetric to the last bit."""
        places = np.arange(2 * self.oscillators)
        self.p[places, places] += np.repeat(noise, 2)
        for i, (f11, f12, f21, f22, q11, q12, q22) in enumerate(drifts.tolist()):
            at = slice(2 * (self.oscillators + i), 2 * (self.oscillators + i) + 2)
            f = np.array(((f11, f12), (f21, f22)))
            self.z[at] = f @ self.z[at]
            rows = f @ self.p[at]
            corner = rows[:, at] @ f.T + ((q11, q12), (q12, q22))
            corner[0, 1] = corner[1, 0]
            self.p[at], self.p[:, at] = rows, rows.T
            self.p[at, at] = corner

    def start(self, seen: FloatArray, residual: float) -> bool:
        """Set z and P before the first sample; False where the filter still waits for one."""
        self.z, self.p = np.zeros_like(self.z), np.zeros_like(self.p)
        if self.prior_start:
            self.p = np.diag([value for row in self.rows for value in row[PRIOR : PRIOR + 2]])
        elif math.isfinite(residual):
            self.p = np.eye(self.z.size)
            self.z = seen * residual
        else:
            return False
        self.head[STARTED] = 1.0
        return True

    def sample(self, c: FloatArray, residual: float) -> tuple[float, float, int]:
        """Measure one sample; return innovation, its variance and the flag."""
        gain = self.p @ c
        variance = self.r + float(c @ gain)
        innovation = residual - float(c @ self.z)
        flag = self._judge(innovation, variance)
        if not flag:
            self.z = self.z + gain * (innovation / variance)
            self.p = self.p - np.outer(gain, gain) / variance
            self.used += 1
            self.logs += math.log(variance)
            self.squares += innovation * innovation / variance
        left = np.diag(self.p)[: 2 * self.oscillators].reshape(-1, 2).sum(axis=1)
        return innovation, variance, flag | UNRESOLVED * bool((left > _RESOLVED * variance).any())

    def _judge(self, innovation: float, variance: float) -> int:
        if math.isnan(innovation):
            return MISSING
        beyond = 0.0 < self.gate * variance < innovation * innovation
        if beyond and self.head[GATED_RUN] < self.gate_samples:
            self.head[GATED_RUN] += 1.0
            return GATED
        self.head[GATED_RUN] = 0.0 if self.gate else self.head[GATED_RUN]
        return 0


def _first_bad_time(state: FloatArray, time: FloatArray) -> int:
    """Return the first sample whose time does not increase, or -1."""
    before = np.concatenate(([state[TIME] if state[SEEN] else -math.inf], time[:-1]))
    bad = ~(np.isfinite(time) & (time > before[: time.size]))
    return int(np.argmax(bad)) if bad.any() else -1


def run(
    packed: FloatArray,
    state: FloatArray,
    samples: Arrays,
    outputs: tuple[FloatArray, ...],
    flags: np.ndarray[tuple[int], np.dtype[np.uint8]],
    sums: FloatArray,
) -> int:
    """Filter samples into `outputs`; return the first sample with a wrong time, or -1."""
    time, velocity, torque, angle = samples
    bad = _first_bad_time(state, time)
    if bad >= 0:
        return bad
    own = _Filter(packed, state)
    parts = np.array([[row[1] == part for row in own.rows] for part in range(3)], dtype=float)
    for start in range(0, time.size, _CHUNK):
        at = slice(start, start + _CHUNK)
        turn, dt, expected = own.observe(
            time[at], velocity[at], None if angle is None else angle[at]
        )
        known = np.abs(torque[at]) <= USABLE
        usable = known & (np.abs(velocity[at]) <= USABLE)
        residual = np.where(usable, torque[at] - expected, math.nan)
        seen, noise, drifts = own.steps(turn, dt)
        predicted = np.zeros((3, turn.size))
        found = np.full((2, turn.size), math.nan)
        for k, value in enumerate(residual.tolist()):
            begun = bool(own.head[STARTED])
            if begun:
                own.predict(noise[k], drifts[k])
                predicted[:, k] = parts @ (own.z * seen[k]).reshape(-1, 2).sum(axis=1)
            elif not own.start(seen[k], value):
                flags[start + k] = MISSING
                continue
            found[0, k], found[1, k], flags[start + k] = own.sample(seen[k], value)
        for out, values in zip(outputs, (expected, *predicted), strict=False):
            out[at] = values
        filtered = torque[at] - (predicted[0] + predicted[1])
        outputs[4][at] = np.where(known, filtered, math.nan)
        outputs[5][at], outputs[6][at] = found
    own.store(state)
    sums[:] = own.used, own.logs, own.squares
    return -1


def batch(
    packed: FloatArray,
    samples: Arrays,
    outputs: tuple[FloatArray | None, ...],
    sums: FloatArray,
) -> int:
    """Filter many traces of one model, one after the other."""
    time, velocity, torque, angle = samples
    flags = np.empty(time.size, np.uint8)
    for j in range(torque.shape[1]):
        found, total = tuple(np.empty((7, time.size))), np.empty(3)
        own = (time, velocity[:, j], torque[:, j], None if angle is None else angle[:, j])
        bad = run(packed, new_state(packed), own, found, flags, total)
        if bad >= 0:
            return bad
        for out, column in zip(outputs, found[4:], strict=True):
            if out is not None:
                out[:, j] = column
        sums[:, j] = total
    return -1


def smooth(
    packed: FloatArray,
    samples: Arrays,
    expected: FloatArray,
    mean: FloatArray,
    covariance: FloatArray,
) -> int:
    """Smooth a trace: forwards keeping every prediction, then backwards."""
    time, velocity, torque, angle = samples
    state = new_state(packed)
    bad = _first_bad_time(state, time)
    if bad >= 0:
        return bad
    own = _Filter(packed, state)
    turn, dt, expected[:] = own.observe(time, velocity, angle)
    usable = (np.abs(torque) <= USABLE) & (np.abs(velocity) <= USABLE)
    residual = np.where(usable, torque - expected, math.nan).tolist()
    seen, noise, drifts = own.steps(turn, dt)
    records: list[tuple[FloatArray, FloatArray, float, float]] = []
    for k, value in enumerate(residual):
        if own.head[STARTED]:
            own.predict(noise[k], drifts[k])
        elif not own.start(seen[k], value):
            continue
        z, p, used = own.z.copy(), own.p.copy(), own.used
        innovation, variance, _ = own.sample(seen[k], value)
        records.append((z, p, innovation if own.used > used else math.nan, variance))
    first = time.size - len(records)
    mean[:first] = covariance[:first] = math.nan
    size = 2 * len(own.rows)
    vector, matrix = np.zeros(size), np.zeros((size, size))
    for k in range(time.size - 1, first - 1, -1):
        z, p, innovation, variance = records[k - first]
        c, f, axes = seen[k], np.eye(size), np.eye(size)
        for i in range(len(own.rows)):
            at = slice(2 * i, 2 * i + 2)
            if i < own.oscillators:
                axes[at, at] = ((c[2 * i], c[2 * i + 1]), (-c[2 * i + 1], c[2 * i]))
            else:
                f[at, at] = drifts[k, i - own.oscillators, :4].reshape(2, 2)
        if not math.isnan(innovation):
            gain = p @ c / variance
            pull = matrix @ gain
            vector = vector + c * (innovation / variance - gain @ vector)
            matrix = matrix - np.outer(c, pull) - np.outer(pull, c)
            matrix += np.outer(c, c) * (gain @ pull + 1.0 / variance)
        mean[k] = (axes @ (z + p @ vector)).reshape(-1, 2)
        whole = axes @ (p - p @ matrix @ p) @ axes.T
        corners = (np.diag(whole)[::2], np.diag(whole, 1)[::2], np.diag(whole)[1::2])
        covariance[k] = np.stack(corners, axis=1)
        vector = f.T @ vector
        matrix = f.T @ matrix @ f
    return -1
