"""Motion of the records: pieces of speed and load, the servo behind them, and each record."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from .family import draw_numbers, read_table

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


def _speed(piece, time, before):
    line = piece.start + (piece.end - piece.start) * time / piece.seconds
    speed = line + piece.swing_rad_s * np.sin(2.0 * np.pi * piece.hertz * time)
    jump = piece.start - before
    # the ramp from the piece before, at the acceleration limit
    return speed - jump * np.clip(1.0 - time * _LIMIT / max(abs(jump), 1e-9), 0.0, 1.0)


def _commanded(pieces):
    """Speed, rad/s, load, N m, and where the output is locked, at the fine grid."""
    parts, before = [], pieces[0].start
    for piece in pieces:
        time = np.arange(round(piece.seconds / FINE_S)) * FINE_S
        zero, is_locked = np.zeros(len(time)), bool(piece.wave)
        speed = zero if is_locked else _speed(piece, time, before)
        load = _wave(piece, time) if is_locked else zero + piece.load_nm
        parts.append((speed, load, np.full(len(time), is_locked)))
        before = float(speed[-1])
    return map(np.concatenate, zip(*parts, strict=True))


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
    commanded, loads, locks = _commanded(pieces)
    rate = 2.0 * np.pi * rng.uniform(14.0, 22.0)
    speed = _lag(_lag(commanded, rate), 1.6 * rate)
    load = _lag(_lag(loads, 40.0), 60.0)
    # no shaft turns evenly: some 0.04 rad/s about 2 Hz while it moves; it comes and goes within
    # 30 ms, for no servo changes its acceleration from one sample to the next
    moving = _lag(_lag(np.minimum(np.abs(commanded), 1.0), 70.0), 70.0)
    shake = _lag(_lag(rng.standard_normal(len(speed)), 15.0), 15.0)
    speed = speed + 0.04 / shake.std() * shake * moving
    # locked at the output, the motor turns by the twist
    twist = np.where(locks, RATIO / STIFFNESS * load, 0.0)
    speed = speed + np.gradient(twist, FINE_S)
    pick = slice(0, None, EVERY)
    time = np.arange(len(speed[pick])) * (FINE_S * EVERY)
    return Path(
        fine_load=load, time=time, load=load[pick],
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


def _staircase(speeds, seconds):
    return [hold(sign * speed, seconds) for speed in speeds for sign in (1.0, -1.0)]


def _loaded(seconds, speed):
    out = []
    for load in (12.0, -25.0):
        out += [hold(0.0, 0.4, load), hold(speed, seconds - 0.2, load)]
        out += [hold(-speed, seconds - 0.2, load), hold(0.0, 0.4)]
    return out


def _turn(seconds):
    return [hold(0.25 * 2.0 * np.pi * RATIO / seconds, seconds)]


def _press(seconds, *waves):
    """The brake opens when the load has gone."""
    pressed = [locked(20.0, 0.8, seconds / len(waves), wave) for wave in waves]
    return [*pressed, locked(0.0, 0.0, 0.5, "rest")]


def _angles(seconds, move):
    press = [hold(0.0, 0.3), *_press(seconds, "sine", "triangle")]
    return press + 3 * [*_turn(move), *press]


_PIECES = (hold, sweep, swing, locked, _staircase, _loaded, _turn, _press, _angles)
_KINDS = {piece.__name__.strip("_"): piece for piece in _PIECES}
_RECORDS = read_table("motion")


def _number(told, numbers):
    """A number of motion.toml, or those that it calls by name."""
    if isinstance(told, list):
        return [_number(one, numbers) for one in told]
    factor, _, name = told.rpartition(" ") if isinstance(told, str) else ("", "", "")
    return float(factor or 1.0) * numbers[name] if name in numbers else told


def pieces_of(record, rng):
    """Return the pieces of `record`, a name of motion.toml."""
    entry = _RECORDS[record]
    if "like" in entry:
        pieces = pieces_of(entry["like"], rng)
        return [replace(piece, seconds=entry["share"] * piece.seconds) for piece in pieces]
    numbers, out = draw_numbers(entry["draw"], rng), []
    for kind, *told in entry["pieces"]:
        made = _KINDS[kind](*_number(told, numbers))
        out += made if isinstance(made, list) else [made]
    return out
