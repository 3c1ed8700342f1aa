"""The recursion of the filter in Python, sample by sample, with the kernel's bits."""

from __future__ import annotations

import math

import numpy as np

from hdbench.filter.layout import GATED, GATED_RUN, HEADER, MISSING, STARTED, UNRESOLVED
from hdbench.filter.transitions import Blocks, steps_of
from hdbench.records import FloatArray

__all__ = ["Recursion"]

_RESOLVED = 200.0  # a block with more innovation variances is not known from the data


class Recursion:
    """Phases `psi`, states `z` and lower triangle `p` of the covariance while one call runs.

    `before`: z and p as predicted for the last sample.

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
        self.z: list[float] = values[2 * self.n : 4 * self.n]
        packed, rows = values[4 * self.n :], range(2 * self.n)
        self.p: list[list[float]] = [packed[i * (i + 1) // 2 :][: i + 1] for i in rows]
        self.variance = math.nan
        self.before: tuple[list[float], list[list[float]]] = (self.z, self.p)
        self.seen, self.used = 0, 0
        self.product, self.log_sum, self.squares = 1.0, 0.0, 0.0

    def transitions(self, turn: FloatArray, dt: FloatArray) -> list[list[list[float]]]:
        """Return `hdbench.filter.transitions.steps_of` and advance the phases.

        Parameters
        ----------
        turn, dt : ndarray, shape (n,)
            Motor turn, rad, and time, s, since the sample before.

        Returns
        -------
        list of list of list of float
            Per sample and block.
        """
        return steps_of(self.blocks, self.psi, turn, dt)

    def run(self, steps: list[list[list[float]]], residual: list[float]) -> FloatArray:
        """Filter one chunk.

        Parameters
        ----------
        steps : list
            As `transitions` returns it.
        residual : list of float
            Torque minus expected torque, N m; NaN where a sample only predicts.

        Returns
        -------
        ndarray, shape (6, n)
            Ripple, misalignment, slow torque, innovation, its variance, flag.
        """
        out = np.empty((6, len(residual)))
        for k, (step, value) in enumerate(zip(steps, residual, strict=True)):
            out[:, k] = self.step(step, value)
        return out

    def step(self, step: list[list[float]], residual: float) -> tuple[float, ...]:
        """Filter one sample.

        Parameters
        ----------
        step : list of list of float
            Of each block, as `transitions` returns it.
        residual : float
            As in `run`.

        Returns
        -------
        tuple of float
            One column of what `run` returns.
        """
        known = not math.isnan(residual)
        parts = [0.0, 0.0, 0.0]
        if self.started:
            parts, predicted = self._predict(step)
            innovation = residual - predicted
        else:
            innovation = self._start(step, residual, known)
        self.before = (self.z, [row.copy() for row in self.p])
        g = self._project(step)
        flag = 0 if known else MISSING
        if known and self.gate > 0.0 and self._outlying(innovation):
            flag = GATED
        if not flag:
            self._measure(g, innovation)
        self.seen += 1
        if self.seen % 8 == 0 and not 1e-150 < self.product < 1e150:
            self.log_sum += math.log(self.product)
            self.product = 1.0
        if self._unresolved():
            flag |= UNRESOLVED
        return (*parts, innovation, self.variance if self.started else math.nan, float(flag))

    def _start(self, step: list[list[float]], residual: float, known: bool) -> float:
        """Set z and P, or leave them at zero; return the innovation of this sample."""
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

    def _predict(self, step: list[list[float]]) -> tuple[list[float], float]:
        """Do z <- F z, P <- F P F' + Q; return what each part's blocks predict, and all of them."""
        z, p = self.z.copy(), self.p
        self.z = z
        parts, seen = [0.0, 0.0, 0.0], []
        for i, block in enumerate(step):
            u, v = 2 * i, 2 * i + 1
            if i >= self.blocks.n_oscillators:
                self._drift(u, block)
                seen.append(z[u])
            else:
                cosine, sine, noise = block
                seen.append(z[u] * cosine + z[v] * sine)
                p[u][u] += noise
                p[v][v] += noise
            parts[int(self.blocks.rows[i][1])] += seen[i]
        return parts, seen[0] + _added(seen[1:])

    def _drift(self, u: int, block: list[float]) -> None:
        """Do z <- F z, P <- F P F' + Q of the slow block whose first state is `u`."""
        f11, f12, f21, f22, q11, q12, q22 = block
        z, p, v = self.z, self.p, u + 1
        z[u], z[v] = f11 * z[u] + f12 * z[v], f21 * z[u] + f22 * z[v]
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
        """Return P C' and set the innovation variance: the diagonal with the first block, the rest.

        Sums stand in the kernel's order.
        """
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
            g.append((own + more[0]) + _added(more[1:]))
        back = [g[2 * i] * c + g[2 * i + 1] * s for i, (c, s) in enumerate(seen)]
        self.variance = (self.r + back[0]) + _added(back[1:])
        return g

    def _outlying(self, innovation: float) -> bool:
        """Say whether a sample is gated, and count such samples in a row."""
        beyond = innovation * innovation > self.gate * self.variance
        if beyond and self.gated_run < self.gate_samples:
            self.gated_run += 1.0
            return True
        self.gated_run = 0.0
        return False

    def _measure(self, g: list[float], innovation: float) -> None:
        """Do z <- z + P C' e / S, P <- P - P C' C P / S, and add to the likelihood."""
        inverse = 1.0 / self.variance
        step = inverse * innovation
        self.z = [value + gain * step for value, gain in zip(self.z, g, strict=True)]
        for a, row in enumerate(self.p):
            for b in range(a + 1):
                row[b] -= inverse * (g[a] * g[b])
        self.used += 1
        self.squares += innovation * innovation * inverse
        self.product *= self.variance

    def _unresolved(self) -> bool:
        limit = _RESOLVED * self.variance
        return any(
            self.p[2 * i][2 * i] + self.p[2 * i + 1][2 * i + 1] > limit
            for i in range(self.blocks.n_oscillators)
        )

    def sums(self) -> tuple[float, float, float]:
        """Return number of samples used, sum of log S and sum of e^2 / S.

        Returns
        -------
        tuple of float
            Over all samples of this call.
        """
        return float(self.used), self.log_sum + math.log(self.product), self.squares

    def store(self, state: FloatArray) -> None:
        """Write phases, z and P back in the kernel's layout.

        Parameters
        ----------
        state : ndarray
            Changed in place.
        """
        state[STARTED], state[GATED_RUN] = float(self.started), self.gated_run
        packed = [value for row in self.p for value in row]
        state[HEADER:] = [*self.psi, *([0.0] * self.n), *self.z, *packed]


def _added(values: list[float]) -> float:
    """Add up from the left; `sum` of newer Pythons compensates its rounding."""
    total = 0.0
    for value in values:
        total += value
    return total
