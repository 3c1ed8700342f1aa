"""Levels of the figures: pass levels, aims, and counts that chance may reach."""

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from scipy.stats import binom, binomtest

_TIERS = ("d3", "d5", "d7", "d10", "d20")


@dataclass(frozen=True)
class Level:
    """A figure: its words, its pass level, its aim; levels.toml says what each entry means."""

    key: str
    words: str
    needed: float | None = None
    aim: float | None = None
    low: bool = False
    percent: bool = True
    most: float | None = None
    chance: float | None = None

    def holds(self, value, limit):
        """Whether `value` keeps `limit` (None: nothing to keep or nothing measured)."""
        if value is None or limit is None:
            return None
        if self.low:
            return value <= limit
        return value >= limit and (self.most is None or value <= self.most)


def _read(part) -> Iterator[Level]:
    table = tomllib.loads(Path(__file__).with_name("levels.toml").read_text())
    for entry in table[part]:
        if not entry.pop("by_size", False):
            yield Level(**entry)
            continue
        for tier in _TIERS:
            limits = {name: entry.get(name, {}).get(tier) for name in ("needed", "aim")}
            key, words = f"{entry['key']}_{tier}", f"{entry['words']}, {tier[1:]} sigma"
            yield Level(key, words, low=entry.get("low", False), **limits)


LEVELS, WIDE_LEVELS = tuple(_read("levels")), tuple(_read("wide"))


def counted(level, count):
    """Number of events that keeps `level` but for chance (0.2 %), None where it has no share."""
    if not level.percent or not count or (level.needed is None and level.chance is None):
        return None
    rate = level.needed if level.chance is None else level.chance
    if level.low:
        return int(binom.isf(0.002, count, rate))
    return count - int(binom.isf(0.002, count, 1.0 - rate))


def interval(share, count):
    """Wilson's 95 % interval of a share."""
    return tuple(binomtest(round(share * count), count).proportion_ci(0.95, "wilson"))
