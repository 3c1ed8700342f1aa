"""Tune on one simulated trace, filter another, and hold the result against an oracle.

    python tools/tuning_campaign.py --seeds 20 --scenario all --json campaign.json

Free motion at 40 to 160 rad/s, ripple 1.2 and 0.6 N m at orders 2 and 4, misalignment 3 N m once
per output turn, white noise 0.05 N m, and a torque unknown to the filter: the scenarios. The
oracle is a Kalman filter that is told the spectrum of that torque, the noise, and that ripple and
misalignment are constant. Generator and oracle share no code with hdbench: dense matrices, matrix
exponentials, plain recursion.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time as clock
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, expm

Array = NDArray[np.float64]

PERIOD_S = 1e-3
NOISE_NM = 0.05
RATIO = 100.0
INERTIA = 1.725e-2
RIPPLE = ((2.0, 1.2), (4.0, 0.6), (1.0 / RATIO, 3.0))
JUDGED_FROM_S = 20.0
RMS_NM = 2.0


@dataclass(frozen=True)
class Known:
    """A disturbance as the oracle knows it: dx = A x dt + noise, torque = first state.

    The second part, `noise_drift`, is of coloured measurement noise: predicted, and not taken off.
    """

    drift: Array
    diffusion: Array  # covariance of the driving noise per second
    prior: Array


@dataclass(frozen=True)
class Scenario:
    """One kind of unknown torque: its generator, and what the oracle knows of it."""

    name: str
    make: Callable[[np.random.Generator, Array], tuple[Array, Array]]  # torque, extra noise
    known: Known | None


def _linear(rng: np.random.Generator, n: int, known: Known) -> Array:
    """Return n samples of a linear process from its prior, exact at the sampling period."""
    size = len(known.drift)
    f, q = _discrete(known, PERIOD_S)
    values, vectors = np.linalg.eigh(q)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    x = np.linalg.cholesky(known.prior + 1e-12 * np.eye(size)) @ rng.normal(size=size)
    out = np.empty(n)
    noise = rng.normal(size=(n, size)) @ root.T
    for k in range(n):
        out[k] = x[0]
        x = f @ x + noise[k]
    return out


def _discrete(known: Known, dt: float) -> tuple[Array, Array]:
    """Return transition and noise covariance over dt (van Loan's exponential)."""
    n = len(known.drift)
    whole = np.zeros((2 * n, 2 * n))
    whole[:n, :n] = -known.drift
    whole[:n, n:] = known.diffusion
    whole[n:, n:] = known.drift.T
    e = expm(whole * dt)
    f = e[n:, n:].T
    q = f @ e[:n, n:]
    return f, 0.5 * (q + q.T)


def _second_order(hz: float, damping: float) -> Known:
    """Return a damped oscillator driven by white noise; damping 1/sqrt 2 is Butterworth."""
    w = 2.0 * math.pi * hz
    drift = np.array([[0.0, 1.0], [-w * w, -2.0 * damping * w]])
    prior = np.diag([RMS_NM**2, (w * RMS_NM) ** 2])
    return Known(drift, np.diag([0.0, 4.0 * damping * w**3 * RMS_NM**2]), prior)


def _first_order(hz: float, rms: float) -> Known:
    w = 2.0 * math.pi * hz
    return Known(np.array([[-w]]), np.array([[2.0 * w * rms**2]]), np.array([[rms**2]]))


def _sine(hz: float) -> Known:
    w = 2.0 * math.pi * hz
    drift = np.array([[0.0, w], [-w, 0.0]])
    return Known(drift, np.zeros((2, 2)), RMS_NM**2 * np.eye(2))


_STEP_RATE, _STEP_NM = 0.2, 2.0
_SLOPE_S, _SLOPE_NM_S = 4.0, 0.7
_STEPS = Known(np.zeros((1, 1)), np.array([[_STEP_RATE * _STEP_NM**2]]), np.array([[4.0]]))
_RAMPS = Known(
    np.array([[0.0, 1.0], [0.0, -1.0 / _SLOPE_S]]),
    np.diag([0.0, 2.0 * _SLOPE_NM_S**2 / _SLOPE_S]),
    np.diag([4.0, _SLOPE_NM_S**2]),
)
_COLOURED = _first_order(8.0, 0.1)


def _make_linear(known: Known) -> Callable[[np.random.Generator, Array], tuple[Array, Array]]:
    return lambda rng, t: (_linear(rng, t.size, known), np.zeros(t.size))


def _make_sine(hz: float) -> Callable[[np.random.Generator, Array], tuple[Array, Array]]:
    def make(rng: np.random.Generator, t: Array) -> tuple[Array, Array]:
        phase = rng.uniform(0.0, 2.0 * math.pi)
        return RMS_NM * math.sqrt(2.0) * np.cos(2.0 * math.pi * hz * t + phase), np.zeros(t.size)

    return make


def _make_steps(rng: np.random.Generator, t: Array) -> tuple[Array, Array]:
    jumps = rng.random(t.size) < _STEP_RATE * PERIOD_S
    size = np.where(jumps, rng.normal(0.0, _STEP_NM, t.size), 0.0)
    return rng.normal(0.0, 2.0) + np.cumsum(size), np.zeros(t.size)


def _make_ramps(rng: np.random.Generator, t: Array) -> tuple[Array, Array]:
    turn = rng.random(t.size) < PERIOD_S / _SLOPE_S
    turn[0] = True
    slopes = rng.normal(0.0, _SLOPE_NM_S, t.size)[turn]
    slope = slopes[np.cumsum(turn) - 1]
    return rng.normal(0.0, 2.0) + np.cumsum(slope) * PERIOD_S, np.zeros(t.size)


def _make_none(rng: np.random.Generator, t: Array) -> tuple[Array, Array]:
    return np.zeros(t.size), np.zeros(t.size)


def _make_coloured(rng: np.random.Generator, t: Array) -> tuple[Array, Array]:
    torque = _linear(rng, t.size, _second_order(2.0, math.sqrt(0.5)))
    return torque, _linear(rng, t.size, _COLOURED)


def _with_colour() -> Known:
    base = _second_order(2.0, math.sqrt(0.5))
    return Known(
        block_diag(base.drift, _COLOURED.drift),
        block_diag(base.diffusion, _COLOURED.diffusion),
        block_diag(base.prior, _COLOURED.prior),
    )


SCENARIOS = {
    s.name: s
    for s in (
        Scenario(
            "2 Hz low-pass noise",
            _make_linear(_second_order(2.0, math.sqrt(0.5))),
            _second_order(2.0, math.sqrt(0.5)),
        ),
        Scenario(
            "2 Hz first-order noise", _make_linear(_first_order(2.0, 2.0)), _first_order(2.0, 2.0)
        ),
        Scenario(
            "2 Hz narrow-band noise", _make_linear(_second_order(2.0, 0.1)), _second_order(2.0, 0.1)
        ),
        Scenario("2 Hz sine", _make_sine(2.0), _sine(2.0)),
        Scenario("steps of load", _make_steps, _STEPS),
        Scenario("slow ramps", _make_ramps, _RAMPS),
        Scenario("0.3 Hz sine", _make_sine(0.3), _sine(0.3)),
        Scenario("none", _make_none, None),
        Scenario("coloured noise", _make_coloured, _with_colour()),
    )
}


@dataclass(frozen=True)
class Made:
    """A simulated trace with its truth."""

    time: Array
    velocity: Array
    angle: Array
    torque: Array
    truth: Array
    expected: Array


def make(scenario: Scenario, seed: int, duration_s: float) -> Made:
    """Simulate free motion: a sum of slow sines of speed, exact angle and acceleration."""
    rng = np.random.default_rng([seed, len(scenario.name), ord(scenario.name[0])])
    t = np.arange(round(duration_s / PERIOD_S)) * PERIOD_S
    hz, phase = rng.uniform(0.02, 0.08, 3), rng.uniform(0.0, 2.0 * math.pi, 3)
    w = 2.0 * math.pi * hz[:, None]
    wave = np.sin(w * t + phase[:, None]).sum(axis=0)
    scale = 120.0 / float(np.ptp(wave))
    least = float(wave.min())
    velocity = 40.0 + scale * (wave - least)
    swing = (np.cos(phase[:, None]) - np.cos(w * t + phase[:, None])) / w
    angle = (40.0 - scale * least) * t + scale * swing.sum(axis=0)
    acceleration = scale * (w * np.cos(w * t + phase[:, None])).sum(axis=0)
    expected = INERTIA * acceleration / RATIO
    unknown, extra = scenario.make(rng, t)
    truth = expected + unknown
    phases = rng.uniform(0.0, 2.0 * math.pi, len(RIPPLE))
    waves = sum(a * np.cos(o * angle + p) for (o, a), p in zip(RIPPLE, phases, strict=True))
    torque = truth + waves + extra + rng.normal(0.0, NOISE_NM, t.size)
    return Made(t, velocity, angle, torque, truth, expected)


def oracle(made: Made, known: Known | None, prior_nm: float) -> Array:
    """Return the filtered torque of a Kalman filter that is told everything but the phases."""
    orders = np.array([order for order, _ in RIPPLE])
    n = 2 * orders.size
    size = n + (0 if known is None else len(known.drift))
    p, c, taken = np.eye(size) * prior_nm**2, np.zeros(size), np.zeros(size)
    c[0:n:2] = taken[0:n:2] = 1.0
    f, q = np.eye(size), np.zeros((size, size))
    if known is not None:
        f[n:, n:], q[n:, n:] = _discrete(known, PERIOD_S)
        p[n:, n:] = known.prior
        c[n] = 1.0
        if size - n == 3:  # coloured noise beside the torque is seen too
            c[n + 2] = 1.0
    x, out = np.zeros(size), np.empty(made.time.size)
    residual = made.torque - made.expected
    turn = np.diff(made.angle, prepend=0.0)
    for k in range(out.size):
        if k:
            a = orders * turn[k]
            f[range(0, n, 2), range(0, n, 2)] = f[range(1, n, 2), range(1, n, 2)] = np.cos(a)
            f[range(0, n, 2), range(1, n, 2)] = np.sin(a)
            f[range(1, n, 2), range(0, n, 2)] = -np.sin(a)
            x = f @ x
            p = f @ p @ f.T + q
        out[k] = made.torque[k] - taken @ x
        g = p @ c
        s = NOISE_NM**2 + c @ g
        x = x + g * ((residual[k] - c @ x) / s)
        p = p - np.outer(g, g) / s
    return out


def error_rms(made: Made, filtered: Array) -> float:
    """Return the torque error after 20 s, N m."""
    late = made.time >= JUDGED_FROM_S
    return float(np.sqrt(np.mean(np.square((filtered - made.truth)[late]))))


def suppression_db(made: Made, filtered: Array) -> list[float]:
    """Return what is left of orders 2 and 4 after 20 s, fitted beside each other."""
    late = made.time >= JUDGED_FROM_S
    design = np.hstack(
        [np.stack([np.cos(o * made.angle), np.sin(o * made.angle)], 1) for o, _ in RIPPLE]
    )[late]

    def amplitudes(signal: Array) -> Array:
        fit = np.linalg.lstsq(design, (signal - made.truth)[late], rcond=None)[0]
        return np.asarray(np.hypot(fit[::2], fit[1::2]))

    ratio = amplitudes(made.torque) / amplitudes(filtered)
    return [float(20.0 * np.log10(x)) for x in ratio[:2]]


def one(scenario: Scenario, seed: int, duration_s: float) -> dict[str, object]:
    """Tune on one trace, filter another; return the figures of this seed."""
    from dataclasses import replace

    from hdbench.filter import Channels, OnlineFilter, preset, tune
    from hdbench.filter.response import filter_response
    from hdbench.filter.tuning.run import settings_of
    from hdbench.profile import load_profile

    profile = load_profile("cim-tr-97-06").data
    report = preset("report-6", profile)
    first, second = make(scenario, seed, duration_s), make(scenario, seed + 1000, duration_s)
    settings = settings_of(profile)
    started = clock.monotonic()
    channels = Channels(first.time, first.velocity, first.torque, first.angle, "simulated")
    found = tune(replace(report, use_measured_angle=True), [channels], settings)
    seconds = clock.monotonic() - started

    def run(model: object) -> Array:
        online = OnlineFilter(model)  # type: ignore[arg-type]
        args = (second.time, second.velocity, second.torque, second.angle)
        return online.process(*args).torque_filtered_nm

    tuned = run(found.model)
    best = error_rms(second, oracle(second, scenario.known, settings.order_prior_std_nm))
    responses = [filter_response(found.model, v, PERIOD_S) for v in (40.0, 100.0, 160.0)]
    gains = [p.gain for r in responses for p in r.passed]
    grid = [abs(h) for r in responses for h in _band(found.model, r.velocity_rad_s)]
    error = error_rms(second, tuned)
    return {
        "seed": seed,
        "slow": found.candidates[0].slow,
        "converged": found.converged,
        "tuned_error_nm": error,
        "oracle_error_nm": best,
        "report_error_nm": error_rms(second, run(report)),
        "ratio": error / best,
        "suppression_db": suppression_db(second, tuned),
        "noise_gain": max(r.noise_gain for r in responses),
        "gain_least": min([*gains, *grid]),
        "gain_most": max([*gains, *grid]),
        "tuning_s": seconds,
    }


def _one(task: tuple[str, int, float]) -> dict[str, object]:
    name, seed, duration_s = task
    return one(SCENARIOS[name], seed, duration_s)


def _band(model: object, velocity: float) -> Array:
    from hdbench.filter import transfer_at_steady_speed

    hz = np.concatenate(([0.0], np.geomspace(0.5, 10.0, 60)))
    found = transfer_at_steady_speed(model, velocity, PERIOD_S, hz)  # type: ignore[arg-type]
    return np.abs(found)


def table(results: dict[str, list[dict[str, object]]]) -> str:
    """Return the medians as a Markdown table."""
    head = (
        "| unknown torque | error: tuned | oracle | report-6 | tuned / oracle (median, worst) | "
        "2x, 4x dB (median, least) | noise gain | gain at 0, 0.5-10 Hz | slow block |"
    )
    lines = [head, "|---" * 9 + "|"]
    for name, rows in results.items():

        def column(key: str, rows: list[dict[str, object]] = rows) -> Array:
            return np.array([row[key] for row in rows], dtype=float)

        db = np.array([row["suppression_db"] for row in rows], dtype=float)
        kinds = sorted({str(row["slow"]) for row in rows})
        count = {k: sum(row["slow"] == k for row in rows) for k in kinds}
        ratio = column("ratio")
        lines.append(
            f"| {name} | {np.median(column('tuned_error_nm')):.3f} "
            f"| {np.median(column('oracle_error_nm')):.3f} "
            f"| {np.median(column('report_error_nm')):.3f} "
            f"| {np.median(ratio):.2f}, {ratio.max():.2f} "
            f"| {np.median(db[:, 0]):.0f}, {np.median(db[:, 1]):.0f} (least {db.min():.0f}) "
            f"| {column('noise_gain').max():.3f} "
            f"| {column('gain_least').min():.3f} ... {column('gain_most').max():.3f} "
            f"| {', '.join(f'{k} {c}' for k, c in count.items())} |"
        )
    return "\n".join(lines)


def main() -> int:
    """Run the campaign."""
    from hdbench.batch import Workers, run_tasks

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--duration", type=float, default=60.0)
    parser.add_argument("--scenario", action="append", choices=["all", *SCENARIOS])
    parser.add_argument("--json", type=Path)
    parser.add_argument("--workers", type=int, default=1)
    args = parser.parse_args()
    wanted = args.scenario or ["all"]
    names = list(SCENARIOS) if "all" in wanted else wanted
    results: dict[str, list[dict[str, object]]] = {name: [] for name in names}
    seeds = range(args.first, args.first + args.seeds)
    tasks = ((name, seed, args.duration) for seed in seeds for name in names)
    for outcome in run_tasks(_one, tasks, Workers(args.workers)):
        name, row = outcome.task[0], outcome.value
        if outcome.lost:
            print(name, "the worker died", file=sys.stderr, flush=True)
            continue
        results[name].append(row)
        print(name, json.dumps(row), file=sys.stderr, flush=True)
        if args.json is not None:
            args.json.write_text(json.dumps(results, indent=1))
    print(table(results))
    return 0


if __name__ == "__main__":
    sys.exit(main())
