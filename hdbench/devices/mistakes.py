"""Mistakes that the operator of a simulated bench is told to make."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from hdbench.errors import UsageError

__all__ = ["MISTAKES", "Mistake", "Mistakes", "parse_mistakes"]

Kind = Literal["wrong-weight", "swing", "early-release"]
MISTAKES: dict[Kind, str] = {
    "wrong-weight": "hangs another weight of the set, or the one named in kg",
    "swing": "lets the weight swing and does not steady it; at an angle in rad, or by the seed",
    "early-release": "takes the weight off again before it was read; after a time in s, or 0.7 s",
}
_WORD = re.compile(r"(wrong-weight|swing|early-release)@(\d{1,4})(?::(\d+(?:\.\d+)?))?")

# angles drawn for a swing: the vertical force then varies by 1 % to 6 %
_SWING_RAD = (0.1, 0.25)
# below the shortest average that a reading takes
_RELEASE_S = 0.7
# random streams of the simulated bench begin with its seed; this one is the operator's
_STREAM = 0x0B5E55


@dataclass(frozen=True, slots=True)
class Mistake:
    """One mistake.

    Parameters
    ----------
    kind : str
        ``wrong-weight``, ``swing`` or ``early-release``.
    number : int
        Point of the calibration's sequence at which it is made, from 1; once.
    size : float or None
        Mass in kg, angle in rad, time in s; None lets the seed choose.
    """

    kind: Kind
    number: int
    size: float | None = None


def parse_mistakes(text: str) -> tuple[Mistake, ...]:
    """Read a list of mistakes."""
    found = []
    for word in filter(None, (part.strip() for part in text.split(","))):
        match = _WORD.fullmatch(word)
        if match is None or int(match[2]) < 1:
            raise UsageError(
                f"{word!r} is no mistake; needed: {', '.join(MISTAKES)} with @ and a point",
                where="--operator-mistakes",
                fix="for example wrong-weight@5,swing@7,early-release@9",
            )
        kinds: dict[str, Kind] = {kind: kind for kind in MISTAKES}
        size = None if match[3] is None else float(match[3])
        found.append(Mistake(kinds[match[1]], int(match[2]), size))
    return tuple(found)


@dataclass(frozen=True, slots=True)
class Mistakes:
    """Which mistakes are made, and how large they are.

    Parameters
    ----------
    planned : sequence of Mistake
        What was asked for.
    masses_kg : sequence of float
        Weights at hand, kg.
    seed : int
        Chooses the sizes that are not given, >= 0.
    """

    planned: Sequence[Mistake] = ()
    masses_kg: Sequence[float] = ()
    seed: int = 0

    def of(self, number: int, attempt: int) -> dict[Kind, float]:
        """Return the sizes of the mistakes at one loading."""
        if attempt != 1:
            return {}
        return {m.kind: self._size(m) for m in self.planned if m.number == number}

    def other_mass_kg(self, mass_kg: float, number: int) -> float:
        """Return a weight of the set other than `mass_kg`, kg; without any, twice it or 1 kg."""
        others = [mass for mass in self.masses_kg if mass != mass_kg]
        if not others:
            return 2.0 * mass_kg or 1.0
        return float(self._draws(number).choice(others))

    def _size(self, mistake: Mistake) -> float:
        if mistake.size is not None:
            return mistake.size
        if mistake.kind == "swing":
            return float(self._draws(mistake.number).uniform(*_SWING_RAD))
        return _RELEASE_S if mistake.kind == "early-release" else float("nan")

    def _draws(self, number: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, _STREAM, number])
