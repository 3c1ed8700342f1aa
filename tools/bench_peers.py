"""The filter's six-state job done by other libraries, for `tools/bench_filter.py`.

Each library is timed two ways: with its 6 x 6 transition matrices made beforehand and not counted,
and from the same velocity and torque that ours starts from, the matrices made within.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import partial
from types import ModuleType

import numpy as np

from hdbench.records import FloatArray

Work = Callable[[], FloatArray | None]

GIVEN, WITHIN = "matrices given", "from velocity"
_PERIOD_S = 1e-3


class Job:
    """What a library is given: matrices, start, torque.

    Parameters
    ----------
    v, y : ndarray, shape (n,)
        Velocity, rad/s, and torque, N m.
    """

    def __init__(self, v: FloatArray, y: FloatArray) -> None:
        self.y = y
        self.phi = np.zeros((v.size, 6, 6))
        for at, order in ((0, 2.0), (2, 4.0), (4, 0.01)):
            cosine, sine = np.cos(order * v * _PERIOD_S), np.sin(order * v * _PERIOD_S)
            self.phi[:, at, at] = self.phi[:, at + 1, at + 1] = cosine
            self.phi[:, at, at + 1], self.phi[:, at + 1, at] = sine, -sine
        self.c = np.array([[1.0, 0.0] * 3])
        self.q = np.diag([1000.0] * 4 + [0.05] * 2)
        self.start = np.array([y[0], 0.0] * 3)


Maker = Callable[[ModuleType, Job], Work]


def _plain(_: ModuleType, job: Job) -> Work:
    phi, c, q, y = job.phi, job.c, job.q, job.y

    def work() -> FloatArray:
        x, p, out = job.start, np.eye(6), np.zeros(y.size)
        for k in range(y.size):
            out[k] = (c @ x)[0]
            gain = phi[k] @ p @ c.T / (1.0 + c @ p @ c.T)
            x = phi[k] @ x + gain[:, 0] * (y[k] - out[k])
            p = q + (phi[k] - gain @ c) @ p @ phi[k].T
        return out

    return work


def _filterpy(m: ModuleType, job: Job) -> Work:
    def work() -> FloatArray:
        kf = m.KalmanFilter(dim_x=6, dim_z=1)
        kf.x, kf.P, kf.H, kf.R, kf.Q = job.start[:, None].copy(), np.eye(6), job.c, np.eye(1), job.q
        out = np.zeros(job.y.size)
        for k in range(job.y.size):
            out[k] = (job.c @ kf.x)[0, 0]
            kf.update(job.y[k])
            kf.predict(F=job.phi[k])
        return out

    return work


def _statsmodels(m: ModuleType, job: Job, *, lean: bool = False) -> Work:
    kf = m.KalmanFilter(k_endog=1, k_states=6, k_posdef=6)
    kf.bind(job.y.copy())
    kf["design"], kf["obs_cov"], kf["selection"] = job.c, np.eye(1), np.eye(6)
    kf["transition"], kf["state_cov"] = np.ascontiguousarray(job.phi.transpose(1, 2, 0)), job.q
    kf.initialize_known(job.start, np.eye(6))
    if lean:  # keep nothing but the predictions
        kf.conserve_memory = m.MEMORY_CONSERVE & ~m.MEMORY_NO_FORECAST_MEAN
    return lambda: np.asarray(kf.filter().forecasts[0])


def _pykalman(m: ModuleType, job: Job) -> Work:
    phi = job.phi[:-1]

    def work() -> FloatArray:
        start = (job.start, np.eye(6))
        kf = m.KalmanFilter(phi, job.c, job.q, np.eye(1), np.zeros(6), np.zeros(1), *start)
        means, _ = kf.filter(job.y)
        ahead = np.einsum("kij,kj->ki", phi, np.asarray(means)[:-1])
        return np.asarray(np.append(job.start[::2].sum(), ahead[:, ::2].sum(axis=1)))

    return work


def _whole(make: Maker, library: ModuleType, v: FloatArray, y: FloatArray) -> FloatArray | None:
    return make(library, Job(v, y))()


# name, module, maker, samples: those of a row differ by the patience that they need
_LIBRARIES: tuple[tuple[str, str, Maker, int], ...] = (
    ("plain NumPy", "numpy", _plain, 3_000),
    ("filterpy", "filterpy.kalman", _filterpy, 10_000),
    ("statsmodels", "statsmodels.tsa.statespace.kalman_filter", _statsmodels, 100_000),
    (
        "statsmodels, lean",
        "statsmodels.tsa.statespace.kalman_filter",
        partial(_statsmodels, lean=True),
        100_000,
    ),
    ("pykalman", "pykalman", _pykalman, 3_000),
)
LONGEST = max(samples for *_, samples in _LIBRARIES)


def peers(v: FloatArray, y: FloatArray) -> tuple[dict[str, tuple[Work, int]], list[str]]:
    """Return every other library that is here, and the names of those that are not."""
    work: dict[str, tuple[Work, int]] = {}
    missing = []
    for name, module, make, n in _LIBRARIES:
        try:
            library = importlib.import_module(module)
        except ImportError:
            missing.append(name)
            continue
        own = v[:n], y[:n]
        work[f"{name}, {GIVEN}"] = (make(library, Job(*own)), n)
        work[f"{name}, {WITHIN}"] = (partial(_whole, make, library, *own), n)
    return work, missing
