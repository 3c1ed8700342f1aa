"""Levels of the figures: pass levels, aims, and counts that chance may reach."""

from dataclasses import dataclass

from scipy.stats import binom, binomtest


@dataclass(frozen=True)
class Level:
    """A figure: its words, its pass level, its aim; `low` where small is good.

    `most` is an upper end beside a pass level, `chance` a count: the campaign passes up to the
    number of events that a rate of `chance` exceeds in 0.2 % of campaigns.
    """

    key: str
    words: str
    needed: float | None
    aim: float | None
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


def _by_size(key, words, needed, aims, low=False):
    tiers = ("d3", "d5", "d7", "d10", "d20")
    return [
        Level(f"{key}_{tier}", f"{words}, {tier[1:]} sigma", need, aim, low)
        for tier, need, aim in zip(tiers, needed, aims, strict=True)
    ]


LEVELS = (
    Level("false_alarms_white", "false alarms, clean, white noise", 0.02, 0.01, True, chance=0.01),
    Level("false_names_white", "- a cause", 0.01, None, True),
    Level("false_unexplained_white", "- an unexplained place", 0.01, None, True),
    Level("false_flags_white", "- a flag for sound data", None, None, True),
    Level("false_alarms_coloured", "false alarms, clean, AR(0.9) and 1/f noise", 0.03, 0.01, True,
          chance=0.016),
    Level("false_names_coloured", "- a cause", None, None, True),
    Level("false_unexplained_coloured", "- an unexplained place", None, None, True),
    Level("false_flags_coloured", "- a flag for sound data", None, None, True),
    *_by_size("detection", "detection", (None, 0.80, 0.95, 0.99, None), (None,) * 5),
    *_by_size("name", "name, exact to the group", (None, 0.60, 0.85, 0.93, 0.97),
              (None, 0.65, 0.88, 0.93, 0.97)),
    *_by_size("first", "the first name is right, rivals or not", (None,) * 5, (None,) * 5),
    *_by_size("cover", "true group in the reported set, given detection",
              (None, 0.95, 0.95, 0.95, 0.95), (None,) * 5),
    Level("set_size_d5", "names in the set, 5 sigma", 2.5, None, True, False),
    Level("set_size_d7", "names in the set, 7 sigma", 1.5, None, True, False),
    Level("set_size_d10", "names in the set, 10 sigma", 1.3, None, True, False),
    *_by_size("wrong_certain", "wrong name without rivals", (0.03,) * 3 + (0.01, 0.01),
              (None, None, None, 0.01, 0.01), True),
    Level("wrong_certain_d10_up", "wrong name without rivals, 10 sigma and more", 0.01, 0.01, True),
    Level("one_speed_cover", "one constant speed: true group in the set", 0.95, None),
    Level("one_speed_wrong_certain", "one constant speed: wrong without rivals", 0.03, None, True),
    Level("parameter_rms", "parameters: RMS error / bound, 10 sigma and more", 1.3, 1.2, True,
          False),
    Level("parameter_rms_robust", "- by the median", None, 1.2, True, False),
    Level("parameter_coverage", "- 95 % intervals that hold the truth (90 to 98 %)", 0.90, None,
          most=0.98),
    Level("gain_d10_up", "held-out gain / the oracle's, 10 sigma and more", 0.95, 0.97),
    Level("gain_physical", "held-out gain / the oracle's, physical sizes", 0.98, 0.98),
    Level("both_d10", "two effects, both exact, 10 sigma", 0.80, 0.85),
    Level("both_d15", "two effects, both exact, 15 sigma", 0.88, 0.90),
    Level("both_mid", "two effects, both exact, physical sizes", None, None),
    Level("both_covered_d10", "two effects, both in the sets, 10 sigma", None, None),
    Level("both_covered_d15", "two effects, both in the sets, 15 sigma", None, None),
    Level("outside_right", "outside the catalogue: right domain or place", 0.95, None),
    Level("outside_place", "- place within 3 bounds", 0.95, None),
    Level("near_miss_honest", "near miss: rivals or rest told", 0.90, None),
    Level("phantoms", "phantom causes per record, physical sizes", 0.05, 0.02, True, False),
    Level("physical_name", "name, exact to the group, physical sizes", None, None),
    Level("physical_cover", "true group in a set, physical sizes", None, None),
    Level("duel_poor_set", "duels, poor record: both names and a run that separates", 0.90, None),
    Level("duel_poor_both", "- both names", None, None),
    Level("duel_poor_wrong_certain", "- wrong name without rivals", None, None, True),
    Level("duel_good_name", "duels, good record: exact", None, None),
    Level("duel_good_covered", "- true group in the set", None, None),
    Level("calibration_error", "calibration error of P(name)", 0.05, None, True, False),
    Level("brier", "Brier score of P(name)", None, None, True, False),
    Level("fault_told", "bad data: told by the fault's own name", None, None),
    Level("score", "S, the one number", None, None, False, False),
    Level("slowest_172_s", "slowest record of 172 s, s of one core", 30.0, 10.0, True, False),
    Level("most_memory_gb", "most memory up to 172 s, GB", None, 1.0, True, False),
    Level("crashes", "crashes and time-outs", 0.0, 0.0, True),
    Level("refusals", "good records refused", 0.0, 0.0, True),
)  # fmt: skip


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
