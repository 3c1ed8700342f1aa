"""Time one sample of the filter beside other libraries, in one run on one trace.

Usage: python tools/bench_filter.py [--covariance N]

`tools/bench.py` prints the table. A shared machine allows ratios only: the rounds of all contenders
alternate, and processor time is counted (none of them uses a second thread). Ours starts from
velocity and torque; what the libraries start from stands in each row (`tools/bench_peers.py`).
Run as a program this shows the covariance's eigenvalues on the way over so many samples.
"""

from __future__ import annotations

import argparse
import math
import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from bench_peers import LONGEST, Work, peers

from hdbench.filter import FilterModel, OscillatorBlock
from hdbench.filter.kalman import batch, new_state, pack, run, smooth
from hdbench.records import FloatArray

_ROUNDS = 5
_PERIOD_S = 1e-3
_FEW = 3_000  # samples of the slow forms
_TRACES = 64


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
            run(packed, state, t[k : k + 1], v[k : k + 1], y[k : k + 1])

    def numpy_form() -> None:
        run(packed, new_state(packed), t[:_FEW], v[:_FEW], y[:_FEW], form="numpy")

    return {
        "run": (lambda: run(packed, new_state(packed), t, v, y).ripple_nm, n),
        f"batch of {_TRACES}": (
            lambda: batch(packed, t[:m], columns[0], columns[1]).torque_filtered_nm,
            m * _TRACES,
        ),
        "smoother": (
            lambda: smooth(packed, t[half], v[half], y[half]).torque_expected_nm,
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


def covariance(n: int) -> None:
    """Run `n` samples and print the eigenvalues of P on the way."""
    packed, chunk = model(), 1_000_000
    t, v, y = trace(chunk)
    state, size = new_state(packed), 6
    for k in range(max(n // chunk, 1)):
        run(packed, state, t + k * chunk * _PERIOD_S, v, y)
        p = np.zeros((size, size))
        p[np.tril_indices(size)] = state[-size * (size + 1) // 2 :]
        values = np.linalg.eigvalsh(p + np.tril(p, -1).T)
        if k % 10 == 9 or k == 0:
            print(f"{(k + 1) * chunk:12d} samples: P from {values[0]:.6g} to {values[-1]:.6g}")


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
    wanted = run(packed, new_state(packed), time_s, v, y).ripple_nm
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
        run(packed, new_state(packed), t, v, y, form=form).torque_filtered_nm
        for form in ("c", "numpy")
    )
    return float(np.abs(one - two).max())


def main() -> None:
    """Run the campaign of the covariance; `tools/bench.py` prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--covariance", type=int, default=100_000_000, help="samples to run over")
    covariance(parser.parse_args().covariance)


if __name__ == "__main__":
    main()
