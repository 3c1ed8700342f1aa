"""Motion of the records: pieces of speed and load, the servo behind them, and each record."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

FINE_S = 1e-4


@dataclass(frozen=True)
class Piece:
    """Speed, rad/s, over `seconds`, under `load_nm`; a locked one has a load wave instead."""

    seconds: float
    start: float
    end: float
    swing_rad_s: float = 0.0
    hertz: float = 0.0
    load_nm: float = 0.0
    wave: str = ""


@dataclass(frozen=True)
class Command:
    """Commands at the fine grid: speed, rad/s, load, N m, and where the output is locked."""

    speed: np.ndarray
    load: np.ndarray
    locked: np.ndarray


def hold(speed, seconds, load_nm=0.0):
    """One speed."""
    return Piece(seconds, speed, speed, load_nm=load_nm)


def sweep(start, end, seconds, load_nm=0.0):
    """A linear sweep of the speed."""
    return Piece(seconds, start, end, load_nm=load_nm)


def swing(amplitude, hertz, seconds, mean=0.0, load_nm=0.0):
    """A sine of the speed about `mean`."""
    return Piece(seconds, mean, mean, amplitude, hertz, load_nm)


def locked(load_nm, hertz, seconds, wave):
    """Output locked: the motor presses by a `sine` or a `triangle`, or lets go (`rest`)."""
    return Piece(seconds, 0.0, 0.0, hertz=hertz, load_nm=load_nm, wave=wave)


def _wave(piece, time):
    if piece.wave == "rest":
        return np.zeros(len(time))
    turns = max(1, round(piece.hertz * piece.seconds)) / piece.seconds * time
    if piece.wave == "sine":
        return piece.load_nm * np.sin(2.0 * np.pi * turns)
    return piece.load_nm * 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * turns))


def _speed(piece, time, before, limit):
    line = piece.start + (piece.end - piece.start) * time / piece.seconds
    speed = line + piece.swing_rad_s * np.sin(2.0 * np.pi * piece.hertz * time)
    jump = piece.start - before
    # the ramp from the piece before, at the acceleration limit
    ramp = np.clip(1.0 - time * limit / max(abs(jump), 1e-9), 0.0, 1.0)
    return speed if piece.wave else speed - jump * ramp


def assemble(pieces, limit):
    """Join `pieces` into commands; speeds are reached at `limit`, rad/s^2."""
    speeds, loads, locks = [], [], []
    before = pieces[0].start
    for piece in pieces:
        time = np.arange(round(piece.seconds / FINE_S)) * FINE_S
        if piece.wave:
            speeds.append(np.zeros(len(time)))
            loads.append(_wave(piece, time))
        else:
            speeds.append(_speed(piece, time, before, limit))
            loads.append(np.full(len(time), piece.load_nm))
        locks.append(np.full(len(time), bool(piece.wave)))
        before = float(speeds[-1][-1])
    return Command(np.concatenate(speeds), np.concatenate(loads), np.concatenate(locks))


EVERY = 10
RATIO = 100.0
STIFFNESS = 1.6e4
_LIMIT = 2000.0


@dataclass(frozen=True)
class Path:
    """Motion and load; `fine_*` at 10 kHz, all else at the sampling instants."""

    fine_angle: np.ndarray
    fine_speed: np.ndarray
    fine_accel: np.ndarray
    fine_load: np.ndarray
    locked: np.ndarray
    time: np.ndarray
    angle: np.ndarray
    speed: np.ndarray
    accel: np.ndarray
    load: np.ndarray
    output: np.ndarray
    second_encoder: bool

    def earlier(self, delay):
        """The path as it was `delay` seconds ago at every sample."""
        fine = np.arange(len(self.fine_angle)) * FINE_S
        names = ("fine_angle", "fine_speed", "fine_accel", "fine_load")
        moved = {name: np.interp(fine - delay, fine, getattr(self, name)) for name in names}
        at = {name.removeprefix("fine_"): values[::EVERY] for name, values in moved.items()}
        twist = at["load"] / STIFFNESS if self.second_encoder else 0.0
        output = at["angle"] / RATIO - twist
        return replace(self, **moved, **at, time=self.time - delay, output=output)

    @property
    def seconds(self):
        """Duration, s."""
        return float(self.time[-1] - self.time[0])

    @property
    def loaded(self):
        """Whether a load is applied, be it one and the same throughout."""
        return bool(np.any(self.load))


def _lag(signal, rate):
    pole = np.exp(-rate * FINE_S)
    return lfilter([1.0 - pole], [1.0, -pole], signal, zi=[signal[0] * pole])[0]


def travel(pieces, rng, second_encoder=False):
    """Integrate the motion that `pieces` command.

    The output angle is the motor's over the ratio; with a second encoder at the output it is less
    the twist under load, which only such an encoder sees.
    """
    command = assemble(pieces, _LIMIT)
    rate = 2.0 * np.pi * rng.uniform(14.0, 22.0)
    speed = _lag(_lag(command.speed, rate), 1.6 * rate)
    load = _lag(_lag(command.load, 40.0), 60.0)
    # no shaft turns evenly: some 0.04 rad/s about 2 Hz while it moves; it comes and goes within
    # 30 ms, for no servo changes its acceleration from one sample to the next
    moving = _lag(_lag(np.minimum(np.abs(command.speed), 1.0), 70.0), 70.0)
    shake = _lag(_lag(rng.standard_normal(len(speed)), 15.0), 15.0)
    speed = speed + 0.04 / shake.std() * shake * moving
    # locked at the output, the motor turns by the twist
    twist = np.where(command.locked, RATIO / STIFFNESS * load, 0.0)
    speed = speed + np.gradient(twist, FINE_S)
    pick = slice(0, None, EVERY)
    time = np.arange(len(speed[pick])) * (FINE_S * EVERY)
    return Path(
        fine_load=load, locked=command.locked[pick], time=time, load=load[pick],
        second_encoder=second_encoder, **turned(speed, load[pick], second_encoder),
    )  # fmt: skip


def turned(speed, load, second_encoder):
    """Angle, speed and acceleration of a fine speed, and the output's angle under a load."""
    accel = np.gradient(speed, FINE_S)
    angle = np.concatenate([[0.0], np.cumsum(0.5 * FINE_S * (speed[1:] + speed[:-1]))])
    fine = {"angle": angle, "speed": speed, "accel": accel}
    at = {name: values[::EVERY] for name, values in fine.items()}
    output = at["angle"] / RATIO - (load / STIFFNESS if second_encoder else 0.0)
    return {**{f"fine_{name}": values for name, values in fine.items()}, **at, "output": output}


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


def _quick(rng):
    """The pieces of a compact record, shorter: the output turns less than once."""
    return [replace(piece, seconds=0.4 * piece.seconds) for piece in _compact(rng)]


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
    "quick": _quick,
    "short": _short,
    "protocol": _protocol,
    "long": _long,
}


def pieces_of(record, rng):
    """Return the pieces of `record`, a name of RECORDS."""
    return RECORDS[record](rng)


def duel_pieces(record, rng):
    """Return the pieces of a poor record."""
    speed = float(rng.uniform(60.0, 120.0))
    swings = [swing(20.0, 4.0, 6.0), hold(0.0, 2.0), swing(25.0, 2.5, 6.0), hold(0.0, 2.0)]
    if record == "one-speed":
        return [hold(speed, 40.0)]
    if record == "hanging":
        return [hold(0.0, 1.0, 25.0), hold(0.0, 20.0, 25.0), hold(speed, 14.0, 25.0)]
    if record == "brief":
        return [hold(0.0, 4.0), hold(speed, 18.0), hold(0.0, 4.0), hold(-speed, 14.0)]
    if record == "one-reversal":
        return [hold(speed, 20.0), hold(-speed, 20.0)]
    if record == "two-speeds":
        return [hold(sign * speed, 12.0) for sign in (1.0, -1.0, 1.0, -1.0)]
    if record == "free":
        return [*swings, hold(speed, 12.0), *swings]
    if record == "one-angle":
        presses = [locked(20.0, 0.5, 10.0, "sine"), locked(20.0, 0.5, 10.0, "triangle")]
        turn = [hold(0.0, 2.0), hold(speed, 12.0), hold(0.0, 1.0)]
        return [*turn, *presses, LET_GO, hold(0.0, 2.0)]
    load = {"one-sign": (12.0, 25.0), "one-load": (25.0, 25.0)}[record]
    out = [hold(0.0, 3.0)] if record == "one-sign" else [hold(0.0, 0.5, load[0])]
    for value in load:
        out += [hold(speed, 12.0, value), hold(-speed, 12.0, value)]
    return out
