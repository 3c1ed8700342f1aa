"""The recursion of the filter in Python, sample by sample, with the kernel's bits."""

from __future__ import annotations

import math

import numpy as np

from hdbench.filter.layout import (
    GATED,
    GATED_RUN,
    HEADER,
    INVERSE,
    MISSING,
    STARTED,
    STEP,
    UNRESOLVED,
)
from hdbench.filter.transitions import Blocks, steps_of
from hdbench.filter.twin_sums import Likelihood, added, along
from hdbench.records import FloatArray

__all__ = ["Recursion"]

_RESOLVED = 200.0  # a block with more innovation variances is not known from the data


class Recursion:
    """Phases `psi`, states `z` and lower triangle `p` of the covariance while one call runs.

    `z` and `p` are those predicted for the last sample; its measurement, with `g` = P C',
    `inverse` = 1/S and `to_do` = e/S, is done when the next one comes, as in the kernel.

    Parameters
    ----------
    model : ndarray
        The packed model.
    state : ndarray
        Where the previous call ended.
    """

    def __init__(self, model: FloatArray, state: FloatArray) -> None:
        self.blocks = Blocks.unpack(model)
        self.n = len(self.blocks.rows)
        self.r, self.gate, self.gate_samples = float(model[2]), float(model[6]), float(model[7])
        self.prior_start = bool(model[8])
        self.started, self.gated_run = bool(state[STARTED]), float(state[GATED_RUN])
        values = state[HEADER:].tolist()
        self.psi: list[float] = values[: self.n]
        self.inverse, self.to_do = float(state[INVERSE]), float(state[STEP])
        self.z: list[float] = values[2 * self.n : 4 * self.n]
        self.g: list[float] = values[4 * self.n : 6 * self.n]
        packed, rows = values[6 * self.n :], range(2 * self.n)
        self.p: list[list[float]] = [packed[i * (i + 1) // 2 :][: i + 1] for i in rows]
        self.variance = math.nan
        self.likelihood = Likelihood()

    def transitions(self, turn: FloatArray, dt: FloatArray) -> list[list[list[float]]]:
        """Return `hdbench.filter.transitions.steps_of` and advance the phases."""
        return steps_of(self.blocks, self.psi, turn, dt)

    def run(self, steps: list[list[list[float]]], residual: list[float]) -> FloatArray:
        """Filter one chunk."""
        out = np.empty((6, len(residual)))
        for k, (step, value) in enumerate(zip(steps, residual, strict=True)):
            out[:, k] = self.step(step, value)
        return out

    def step(self, step: list[list[float]], residual: float) -> tuple[float, ...]:
        """Filter one sample."""
        known = not math.isnan(residual)
        self._move(step)
        ahead = along(self.blocks.n_oscillators, step, self.g)
        innovation = residual - along(self.blocks.n_oscillators, step, self.z) - ahead * self.to_do
        self.z = [value + gain * self.to_do for value, gain in zip(self.z, self.g, strict=True)]
        parts = self._parts(step)
        if not self.started:
            parts, innovation = [0.0, 0.0, 0.0], self._start(step, residual, known)
        self._measure(step, ahead)
        flag = 0 if known else MISSING
        if known and self.gate > 0.0 and self._outlying(innovation):
            flag = GATED
        self.inverse = 0.0 if flag else 1.0 / self.variance
        self.to_do = 0.0 if flag else self.inverse * innovation
        self.likelihood.count(innovation, self.variance, self.inverse)
        if self._unresolved():
            flag |= UNRESOLVED
        return (*parts, innovation, self.variance if self.started else math.nan, float(flag))

    def _start(self, step: list[list[float]], residual: float, known: bool) -> float:
        """Set z and P, or leave them at zero; return the innovation of this sample."""
        for row in self.p:
            row[:] = [0.0] * len(row)
        if not (self.prior_start or known):
            return residual
        self.started = True
        first = 0.0 if self.prior_start else residual
        prior = self.blocks.prior() if self.prior_start else [1.0] * (2 * self.n)
        innovation = residual
        self.z = []
        for i in range(self.n):
            for m in (2 * i, 2 * i + 1):
                self.p[m][m] = prior[m]
            oscillator = i < self.blocks.n_oscillators
            self.z += [step[i][0] * first, step[i][1] * first] if oscillator else [0.0, 0.0]
            innovation -= first
        return innovation

    def _move(self, step: list[list[float]]) -> None:
        """Do z <- F z, g <- F g, P <- F P F' + Q."""
        for i, block in enumerate(step):
            if i >= self.blocks.n_oscillators:
                self._drift(2 * i, block)
                continue
            self.p[2 * i][2 * i] += block[2]
            self.p[2 * i + 1][2 * i + 1] += block[2]

    def _parts(self, step: list[list[float]]) -> list[float]:
        """Return what each part's blocks predict."""
        parts, z = [0.0, 0.0, 0.0], self.z
        for i, block in enumerate(step):
            seen = z[2 * i]
            if i < self.blocks.n_oscillators:
                seen = z[2 * i] * block[0] + z[2 * i + 1] * block[1]
            parts[int(self.blocks.rows[i][1])] += seen
        return parts

    def _drift(self, u: int, block: list[float]) -> None:
        """Do the same for the slow block whose first state is `u`."""
        f11, f12, f21, f22, q11, q12, q22 = block
        z, p, v = self.z, self.p, u + 1
        for x in (z, self.g):
            x[u], x[v] = f11 * x[u] + f12 * x[v], f21 * x[u] + f22 * x[v]
        p11, p12, p22 = p[u][u], p[v][u], p[v][v]
        t0, t1 = f11 * p11 + f12 * p12, f11 * p12 + f12 * p22
        u0, u1 = f21 * p11 + f22 * p12, f21 * p12 + f22 * p22
        for j in range(2 * self.n):
            if j in (u, v):
                continue
            (a, b), (c, d) = (max(u, j), min(u, j)), (max(v, j), min(v, j))
            above, below = p[a][b], p[c][d]
            p[a][b], p[c][d] = f11 * above + f12 * below, f21 * above + f22 * below
        p[u][u] = (t0 * f11 + t1 * f12) + q11
        p[v][u] = (t0 * f21 + t1 * f22) + q12
        p[v][v] = (u0 * f21 + u1 * f22) + q22

    def _project(self, step: list[list[float]]) -> list[float]:
        """Return P C': the diagonal with the first block, the rest, in the kernel's order."""
        p, size = self.p, range(2 * self.n)
        seen = [
            (block[0], block[1]) if i < self.blocks.n_oscillators else (1.0, 0.0)
            for i, block in enumerate(step)
        ]
        g = []
        for j in size:
            own = p[j][j] * seen[j // 2][j % 2]
            more = []
            for i, (cosine, sine) in enumerate(seen):
                u, v = 2 * i, 2 * i + 1
                first = p[max(u, j)][min(u, j)] if u != j else 0.0
                second = p[max(v, j)][min(v, j)] if v != j else 0.0
                more.append(first * cosine + second * sine)
            g.append((own + more[0]) + added(more[1:]))
        return g

    def _outlying(self, innovation: float) -> bool:
        """Say whether a sample is gated, and count such samples in a row."""
        beyond = innovation * innovation > self.gate * self.variance
        if beyond and self.gated_run < self.gate_samples:
            self.gated_run += 1.0
            return True
        self.gated_run = 0.0
        return False

    def _measure(self, step: list[list[float]], ahead: float) -> None:
        """Do the measurement of the sample before on P; find g and S of this one.

        Both come from P without that measurement: P C' - g (C g) / S.
        """
        scaled = ahead * self.inverse
        found = self._project(step)
        self.variance = self.r + (along(self.blocks.n_oscillators, step, found) - ahead * scaled)
        for a, row in enumerate(self.p):
            for b in range(a + 1):
                row[b] -= self.inverse * (self.g[a] * self.g[b])
        self.g = [new - old * scaled for new, old in zip(found, self.g, strict=True)]

    def _unresolved(self) -> bool:
        limit = _RESOLVED * self.variance
        left = [row[-1] - self.inverse * (g * g) for row, g in zip(self.p, self.g, strict=True)]
        return any(left[2 * i] + left[2 * i + 1] > limit for i in range(self.blocks.n_oscillators))

    def store(self, state: FloatArray) -> None:
        """Write phases, z and P back in the kernel's layout."""
        state[STARTED], state[GATED_RUN] = float(self.started), self.gated_run
        state[INVERSE], state[STEP] = self.inverse, self.to_do
        packed = [value for row in self.p for value in row]
        state[HEADER:] = [*self.psi, *([0.0] * self.n), *self.z, *self.g, *packed]
