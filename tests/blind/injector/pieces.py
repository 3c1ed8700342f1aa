"""Speed and load commands of the records, piece by piece, at 10 kHz."""

from dataclasses import dataclass

import numpy as np

__all__ = ["FINE_S", "Command", "Piece", "assemble", "hold", "locked", "sweep", "swing"]

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
