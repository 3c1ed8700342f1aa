"""Rate of false alarms of `hdbench trend`, and how soon it finds a step.

    python tools/trend_campaign.py --histories 1000

Stable histories of 60 runs with four kinds of uncertainty, each looked at once at its end; the
same looked at after every run; and histories whose level steps by two run-to-run stds after run
30, looked at after each of the eight runs that follow.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable

import numpy as np

from hdbench.records import FloatArray
from hdbench.trend.charts import LEAST_RUNS, study_history

_PROBABILITY = 0.05
_RUNS = 60
_BEFORE = 30
_AFTER = 8
_STEP = 2.0

Maker = Callable[[np.random.Generator, int], tuple[FloatArray, FloatArray]]


def _none(draw: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray]:
    return draw.normal(size=n), np.zeros(n)


def _alike(draw: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray]:
    return draw.normal(size=n) + 0.5 * draw.normal(size=n), np.full(n, 0.5)


def _unlike(draw: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray]:
    own = np.where(np.arange(n) % 3 == 0, 2.0, 0.3)
    return 0.5 * draw.normal(size=n) + own * draw.normal(size=n), own


def _common(draw: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray]:
    # nine tenths of the uncertainty is one error in all runs, as of one set of weights
    return draw.normal(size=n) + 10.0 * draw.normal(), np.full(n, 10.0)


_MAKERS: dict[str, Maker] = {
    "no own uncertainty": _none,
    "own half the scatter": _alike,
    "own from .6 to 4 times the scatter": _unlike,
    "own common to all runs": _common,
}


def signals(values: FloatArray, own: FloatArray, draw: np.random.Generator) -> int:
    """Return how many signals one look at a history shows."""
    months = np.arange(values.size, dtype=np.float64)
    found = study_history(values, own, months, probability=_PROBABILITY, draw=draw)
    return len(found.signals)


def false_alarms(make: Maker, histories: int, seed: int = 0) -> float:
    """Return the share of stable histories with any signal."""
    draw = np.random.default_rng(seed)
    hits = 0
    for _ in range(histories):
        hits += signals(*make(draw, _RUNS), np.random.default_rng(1)) > 0
    return hits / histories


def alarms_of_many_looks(histories: int, seed: int = 0) -> float:
    """Return the share of stable histories with a signal at any look, one after every run."""
    draw = np.random.default_rng(seed)
    hits = 0
    for _ in range(histories):
        values, own = _none(draw, _RUNS)
        hits += any(
            signals(values[:n], own[:n], np.random.default_rng(1))
            for n in range(LEAST_RUNS, _RUNS + 1)
        )
    return hits / histories


def found_steps(histories: int, seed: int = 0) -> float:
    """Return the share of steps found within eight runs, in histories without an earlier alarm."""
    draw = np.random.default_rng(seed)
    found = looked = 0
    while looked < histories:
        values, own = _none(draw, _BEFORE + _AFTER)
        if signals(values[:_BEFORE], own[:_BEFORE], np.random.default_rng(1)):
            continue
        looked += 1
        values[_BEFORE:] += _STEP
        found += any(
            signals(values[:n], own[:n], np.random.default_rng(1))
            for n in range(_BEFORE + 1, _BEFORE + _AFTER + 1)
        )
    return found / histories


def main() -> int:
    """Print the shares with their standard errors."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--histories", type=int, default=1000)
    count = parser.parse_args().histories
    error = (_PROBABILITY * (1.0 - _PROBABILITY) / count) ** 0.5
    print(f"any signal in a stable history of {_RUNS} runs; stated {_PROBABILITY} +- {error:.3f}")
    for name, make in _MAKERS.items():
        # uneven uncertainties draw limits for each history anew: fewer of them
        some = count // 3 if make is _unlike else count
        print(f"  {name:36}{false_alarms(make, some):.3f} of {some}", flush=True)
    print(
        f"  looked at after every run           {alarms_of_many_looks(count // 5):.3f}", flush=True
    )
    share = found_steps(count)
    print(f"step of {_STEP:g} run-to-run stds found within {_AFTER} runs: {share:.3f}; wanted .9")
    return 0


if __name__ == "__main__":
    sys.exit(main())
