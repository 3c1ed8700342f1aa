"""Time one sample of the filter beside other libraries, in one run on one trace.

`tools/bench.py` prints the table. A shared machine allows ratios only: the rounds of all contenders
alternate, and processor time is counted (none of them uses a second thread). Ours starts from
velocity and torque. Each library is timed two ways: with its 6 x 6 transition matrices made
beforehand and not counted, and from the same velocity and torque, the matrices made within.
"""

from __future__ import annotations

import importlib
import math
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import ModuleType

import numpy as np

from hdbench.filter import FilterModel, OscillatorBlock
from hdbench.filter.kalman import batch, new_state, pack, run, smooth
from hdbench.records import FloatArray

_ROUNDS = 5
_PERIOD_S = 1e-3
_FEW = 3_000  # samples of the slow forms
_TRACES = 64
Work = Callable[[], FloatArray | None]

GIVEN, WITHIN = "matrices given", "from velocity"


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


def model() -> FloatArray:
    """Return the report's model of six states as the kernel reads it, without expected torque."""
    orders = ((2.0, 1000.0), (4.0, 1000.0), (0.01, 0.05))
    blocks = tuple(OscillatorBlock(order, "ripple", q) for order, q in orders)
    return pack(FilterModel("report-6", blocks, 1.0, 0.0, 1.0, 1.0, use_measured_angle=False))


def trace(n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return time, velocity with reversals, and torque with ripple and noise."""
    rng = np.random.default_rng(1)
    time_s = np.arange(n) * _PERIOD_S
    velocity = 156.0 * np.sin(2.0 * np.pi * 0.3 * time_s)
    angle = np.cumsum(velocity) * _PERIOD_S
    torque = 0.4 * np.cos(2.0 * angle) + 0.2 * np.cos(4.0 * angle) + rng.normal(0.0, 0.05, n)
    return time_s, velocity, torque


def ours(n: int) -> dict[str, tuple[Work, int]]:
    """Return our forms: what to time, and samples per call."""
    packed, (t, v, y) = model(), trace(n)
    m = max(n // 200, 10)
    columns = [np.repeat(a[:m, None], _TRACES, axis=1) * np.linspace(0.9, 1, 64) for a in (v, y)]
    half = slice(0, max(n // 10, 10))

    def steps() -> None:
        state = new_state(packed)
        for k in range(_FEW):
            run(packed, state, (t[k : k + 1], v[k : k + 1], y[k : k + 1], None))

    def numpy_form() -> None:
        run(packed, new_state(packed), (t[:_FEW], v[:_FEW], y[:_FEW], None), form="numpy")

    return {
        "run": (lambda: run(packed, new_state(packed), (t, v, y, None)).ripple_nm, n),
        f"batch of {_TRACES}": (
            lambda: batch(packed, (t[:m], columns[0], columns[1], None)).torque_filtered_nm,
            m * _TRACES,
        ),
        "smoother": (
            lambda: smooth(packed, (t[half], v[half], y[half], None)).torque_expected_nm,
            half.stop,
        ),
        "one sample per call": (steps, _FEW),
        "NumPy form": (numpy_form, _FEW),
    }


def float_ns(rounds: int) -> float | None:
    """Return what a sample costs in the exported float32 build, ns; None without a compiler."""
    from hdbench.filter.firmware import export_firmware
    from hdbench.filter.presets import preset
    from hdbench.profile import load_profile

    compiler = shutil.which("cc")
    if compiler is None:
        return None
    program = """
#include <stdio.h>
#include <time.h>
#include "hdb_model.h"
#include "hdb_vectors.h"
int main(void)
{
    static hdb_state state; hdb_output out; double best = 1e9;
    for (int r = 0; r < ROUNDS; ++r) {
        const clock_t start = clock();
        for (int n = 0; n < 200; ++n)
            for (int k = 0; k < HDB_VECTORS; ++k)
                hdb_filter_step(&hdb_exported_model, &state, HDB_SAMPLE_PERIOD_S,
                                hdb_vector_velocity[k], hdb_vector_torque[k], &out);
        const double took = (double)(clock() - start) / CLOCKS_PER_SEC / (200.0 * HDB_VECTORS);
        best = took < best ? took : best;
    }
    printf("%g", 1e9 * best + 0 * (double)out.filtered);
    return 0;
}
"""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        report = preset("report-6", load_profile("cim-tr-97-06").data)
        export_firmware(report, folder, sample_period_s=_PERIOD_S, source="bench")
        (folder / "bench.c").write_text(program)
        flags = ["-std=c99", "-O3", "-DHDB_EXPORTED", f"-DROUNDS={rounds}"]
        files = ["filter.c", "bench.c", "-o", "bench"]
        subprocess.run([compiler, *flags, *files], cwd=folder, check=True)
        said = subprocess.run([folder / "bench"], capture_output=True, text=True, check=True)
    return float(said.stdout)


def timed(work: dict[str, tuple[Work, int]]) -> dict[str, float]:
    """Return the least processor time of each contender over alternating rounds, ns per sample."""
    best = dict.fromkeys(work, math.inf)
    for _ in range(_ROUNDS):
        for name, (function, samples) in work.items():
            start = time.process_time_ns()
            function()
            best[name] = min(best[name], (time.process_time_ns() - start) / samples)
    return best


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Parameters
    ----------
    name : str
        What was timed.
    cost : float
        What it took, in the unit of its table.
    against : float
        The same over what ours took.
    differs_nm : float or None
        Largest difference from our answer, N m.
    """

    name: str
    cost: float
    against: float
    differs_nm: float | None = None


def rows(n: int) -> tuple[list[Row], list[str]]:
    """Time every form and library on the report's model of six states."""
    time_s, v, y = trace(LONGEST)
    contenders, missing = peers(v, y)
    best = timed({**ours(max(n, _FEW)), **contenders})
    single = float_ns(_ROUNDS)
    if single is not None:
        best["float32, as exported"] = single
    packed = model()
    wanted = run(packed, new_state(packed), (time_s, v, y, None)).ripple_nm
    found = []
    for name, value in best.items():
        apart = None
        if name in contenders:
            answer = np.asarray(contenders[name][0]())
            # the first prediction is reported as 0 by ours: nothing was seen
            apart = float(np.abs(answer[1:] - wanted[1 : answer.size]).max())
        found.append(Row(name, value, value / best["run"], apart))
    found.append(Row("C against NumPy form", math.nan, math.nan, forms_apart(packed, n)))
    return found, missing


def forms_apart(packed: FloatArray, n: int) -> float:
    """Return how far the compiled and the NumPy form are apart, N m."""
    t, v, y = trace(n)
    one, two = (
        run(packed, new_state(packed), (t, v, y, None), form=form).torque_filtered_nm
        for form in ("c", "numpy")
    )
    return float(np.abs(one - two).max())
