"""The records: which speeds and loads, for how long."""

import numpy as np

from .pieces import hold, locked, sweep, swing

__all__ = ["LET_GO", "RECORDS", "pieces_of"]

_SPEEDS = (3.0, 8.0, 20.0, 40.0, 75.0, 120.0, 200.0, 300.0, 400.0)
# the brake opens when the load has gone
LET_GO = locked(0.0, 0.0, 0.5, "rest")
# a quarter of an output turn between locked runs: 157 motor rad
_QUARTER = np.pi / 2.0 * 100.0


def _staircase(speeds, seconds):
    return [hold(sign * speed, seconds) for speed in speeds for sign in (1.0, -1.0)]


def _loaded(seconds, speed, both):
    signs = ((12.0, 1.0), (-25.0, -1.0)) if both else ((12.0, 1.0), (25.0, 1.0))
    out = []
    for load, _ in signs:
        out += [hold(0.0, 0.4, load), hold(speed, seconds - 0.2, load)]
        out += [hold(-speed, seconds - 0.2, load), hold(0.0, 0.4, 0.0)]
    return out


def _angles(seconds, move):
    out = []
    for k in range(4):
        if k:
            out.append(hold(_QUARTER / move, move))
        out += [hold(0.0, 0.3), locked(20.0, 0.8, seconds / 2.0, "sine")]
        out += [locked(20.0, 0.8, seconds / 2.0, "triangle"), LET_GO]
    return out


def _constant(rng):
    return [hold(rng.uniform(40.0, 150.0) * rng.choice([1.0, -1.0]), 40.0)]


def _mixed(rng):
    top = rng.uniform(350.0, 430.0)
    speeds = np.array([8.0, 30.0, 80.0, 160.0, 300.0]) * rng.uniform(0.93, 1.07, 5)
    return [
        hold(0.0, 3.0),
        *_staircase(speeds, 2.8),
        sweep(0.0, top, 7.0),
        sweep(top, -top, 7.0),
        swing(20.0, 4.0, 4.0),
        swing(25.0, 0.25, 8.0),
        hold(0.0, 3.0),
    ]


def _short(rng):
    top = rng.uniform(380.0, 440.0)
    speeds = np.array([6.0, 20.0, 60.0, 130.0, 260.0]) * rng.uniform(0.93, 1.07, 5)
    return [
        hold(0.0, 2.0),
        *_staircase(speeds, 1.36),
        sweep(0.0, top, 5.0),
        sweep(top, -top, 6.0),
        swing(20.0, 4.0, 2.0),
        *_loaded(1.5, rng.uniform(60.0, 90.0), True),
        *_angles(2.5, 0.8),
        swing(12.0, 0.3, 6.66),
        hold(0.0, 1.94),
    ]


def _compact(rng):
    top = rng.uniform(300.0, 360.0)
    speeds = np.array([10.0, 40.0, 130.0]) * rng.uniform(0.93, 1.07, 3)
    presses = []
    for k in range(3):
        presses += [hold(_QUARTER / 0.6, 0.6), hold(0.0, 0.2)] if k else [hold(0.0, 0.2)]
        presses += [locked(20.0, 0.8, 1.25, ("sine", "triangle")[k % 2]), LET_GO]
    return [
        hold(0.0, 1.0),
        *_staircase(speeds, 0.8),
        # the output turns more than once
        hold(170.0, 1.4),
        sweep(170.0, top, 1.3),
        sweep(top, -top, 2.6),
        swing(20.0, 4.0, 1.0),
        *_loaded(0.9, rng.uniform(60.0, 90.0), True),
        *presses,
        swing(12.0, 0.5, 4.0),
        hold(0.0, 0.95),
    ]


def _protocol(rng):
    speeds = np.array(_SPEEDS) * rng.uniform(0.93, 1.07, len(_SPEEDS))
    return [
        hold(0.0, 8.0),
        *_staircase(speeds, 3.0),
        sweep(0.0, 450.0, 12.0),
        sweep(450.0, -450.0, 12.0),
        swing(20.0, 5.0, 8.0),
        *_loaded(5.5, rng.uniform(70.0, 110.0), True),
        *_angles(6.0, 1.0),
        swing(12.0, 0.15, 16.6),
        hold(0.0, 8.2),
    ]


def _long(rng):
    speed = rng.uniform(50.0, 90.0)
    return [
        hold(0.0, 40.0),
        *_staircase((speed, 2.2 * speed), 20.0),
        hold(0.0, 30.0),
        hold(0.0, 170.0, 25.0),
        hold(0.0, 100.0),
        *_loaded(9.8, speed, True),
        *_staircase((speed,), 20.0),
        *_angles(8.0, 1.0),
        hold(0.0, 64.6),
    ]


RECORDS = {
    "constant": _constant,
    "mixed": _mixed,
    "compact": _compact,
    "short": _short,
    "protocol": _protocol,
    "long": _long,
}


def pieces_of(record, rng):
    """Return the pieces of `record`, a name of RECORDS."""
    return RECORDS[record](rng)
