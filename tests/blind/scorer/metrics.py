"""Figures of a campaign, each by its definition on the benchmark's page."""

import math
import statistics
from collections import defaultdict

from .judge import FAULT_NAMES, names_of, same_names


def mean(values):
    """(mean or None, number of values)."""
    values = list(values)
    return (statistics.fmean(values) if values else None), len(values)


def share(flags):
    """(share of true flags or None, number of flags)."""
    return mean(bool(flag) for flag in flags)


def shares(rows, names, end=""):
    """Share of the verdicts that say so: name of the figure to what they say."""
    return {f"{name}{end}": share(getattr(row.verdict, said) for row in rows)
            for name, said in names.items()}  # fmt: skip


def _stated(rows):
    """(probability stated for the first name, whether it is in the true group) of each answer."""
    return [
        (row.verdict.probability, _first_right(row))
        for row in rows
        if row.verdict.probability is not None
    ]


def brier(rows):
    """Mean square of stated probability less what came true; a uniform guess over 40 has 0.975."""
    pairs = _stated(rows)
    return (sum((p - right) ** 2 for p, right in pairs) / len(pairs) if pairs else None), len(pairs)


def calibration_error(rows):
    """Expected calibration error: the first name is in the true group with the P that is told."""
    bins, pairs = defaultdict(list), _stated(rows)
    for stated, right in pairs:
        bins[min(9, int(10.0 * stated))].append((stated, right))
    error = 0.0
    for some in bins.values():
        stated, true = (sum(values) / len(some) for values in zip(*some, strict=True))
        error += len(some) / len(pairs) * abs(stated - true)
    return (error if pairs else None), len(pairs)


# Q(d sin gamma / 2) = 1 %: distance of two effects, sigmas, at which a wrong name has 1 %
SEPARATED = 4.65


class Row(tuple):
    """(truth, entry, verdict) of one record."""

    __slots__ = ()
    truth = property(lambda self: self[0])
    entry = property(lambda self: self[1])
    verdict = property(lambda self: self[2])

    @property
    def tier(self):
        """Size as asked for."""
        return self.truth["hidden"][0]["tier"] if self.truth["hidden"] else ""


def _part(rows, part):
    return [row for row in rows if row.truth["part"] == part]


def _of_noise(rows, kind):
    names = {"false_alarms": "alarm", "false_names": "named", "false_unexplained": "unexplained"}
    flags = share((row.entry.get("answer") or {}).get("data_flags") for row in rows)
    return {**shares(rows, names, kind), f"false_flags{kind}": flags}


def _clean(rows):
    some = [row for row in rows if not row.truth["hidden"]]
    white = [row for row in some if row.truth["noise"] == "white"]
    coloured = [row for row in some if row.truth["noise"] in ("ar", "flicker")]
    return {**_of_noise(white, "_white"), **_of_noise(coloured, "_coloured")}


def _first_right(row):
    """The first cause's own name is the true one's, whatever stands beside it."""
    named = row.verdict.named
    return bool(named) and named[0] in same_names(row.truth["hidden"][0])


def _single(rows):
    """By size in sigmas, on records that move through speeds (one speed is told apart)."""
    out = {}
    able = [row for row in rows if row.truth["record"] != "constant"]
    flat = [row for row in rows if row.truth["record"] == "constant"]
    for tier in ("d3", "d5", "d7", "d10", "d20"):
        some = [row for row in able if row.tier == tier]
        found = [row for row in some if row.verdict.alarm]
        names = {"detection": "alarm", "name": "exact", "wrong_certain": "wrong_certain"}
        out |= shares(some, names, f"_{tier}") | shares(found, {"cover": "covered"}, f"_{tier}")
        out[f"first_{tier}"] = share(map(_first_right, some))
        sizes = (row.verdict.set_size for row in found if row.verdict.covered)
        out[f"set_size_{tier}"] = mean(sizes)
    strong = [row for row in able if row.tier in ("d10", "d20")]
    out |= shares(strong, {"wrong_certain_d10_up": "wrong_certain"})
    found = [row for row in flat if row.verdict.alarm]
    return (
        out
        | shares(flat, {"one_speed_wrong_certain": "wrong_certain"})
        | shares(found, {"one_speed_cover": "covered"})
    )


def _parameters(rows):
    away = [some for row in rows if row.tier in ("d10", "d20") for some in row.verdict.deviations]
    bounds = [bound for *_, bound, _ in away]
    rms = math.sqrt(statistics.fmean(bound * bound for bound in bounds)) if bounds else None
    # a wrong minimum weighs more than all others in a mean square: the middle beside it
    middle = statistics.median(map(abs, bounds)) / 0.6745 if bounds else None
    return {
        "parameter_rms": (rms, len(bounds)),
        "parameter_rms_robust": (middle, len(bounds)),
        "parameter_coverage": coverage(away),
    }


def coverage(away):
    """Share of stated 95 % intervals that hold the truth."""
    return share(abs(own) < 1.96 for *_, own in away if own is not None)


def _gain(rows, physical):
    pairs = [row.verdict.gain for row in rows if row.verdict.gain]
    pairs = [(ours, best) for ours, best in pairs if best > (0.01 if physical else 0.0)]
    if physical or not pairs:
        return mean(ours / best for ours, best in pairs)
    return sum(ours for ours, _ in pairs) / sum(best for _, best in pairs), len(pairs)


def _doubles(rows):
    out = {}
    # two names of one group are one effect on that record: nothing can tell how much is whose
    rows = [row for row in rows if len({*map(same_names, row.truth["hidden"])}) == 2]
    names = {"both": "exact", "both_covered": "covered", "one_of_two": "found"}
    for tier in ("d10", "d15", "mid"):
        out |= shares([row for row in rows if row.tier == tier], names, f"_{tier}")
    return out


def _honest(row):
    """Told as unexplained in its domain, or named where the catalogue's free place covers it."""
    return row.verdict.right_domain or row.verdict.covered


def _outside(rows):
    def distance(row):
        effect = row.truth["hidden"][0]
        free = 1.0 if effect.get("accept") else effect["perpendicular"]
        return effect["d"] * free

    far = [row for row in rows if distance(row) >= 7.0]
    near = [row for row in rows if distance(row) < 4.0]
    places = [row.verdict.place_error for row in far if row.verdict.place_error is not None]
    return {
        "outside_right": share(_honest(row) for row in far),
        "outside_place": share(error <= 3.0 for error in places),
        "near_miss_honest": share(_limits_told(row) for row in near),
    }


def _limits_told(row):
    """A name with rivals or an unexplained rest beside it; silence is no answer."""
    verdict = row.verdict
    return verdict.unexplained > 0 or (bool(verdict.named) and not verdict.wrong_certain)


def _duels(rows):
    poor = [row for row in rows if row.truth["note"].endswith("poor")]
    good = [row for row in rows if row.truth["note"].endswith("good")]
    return {
        "duel_poor_set": share(_both_named(row) and _separated(row) for row in poor),
        "duel_poor_both": share(map(_both_named, poor)),
        **shares(
            poor, {"duel_poor_covered": "covered", "duel_poor_wrong_certain": "wrong_certain"}
        ),
        **shares(good, {"duel_good_name": "exact", "duel_good_covered": "covered"}),
    }


def _both_named(row):
    """Both names of the pair stand in one set."""
    pair = set(row.truth["note"].split("|")[:2])
    causes = (row.entry.get("answer") or {}).get("causes", ())
    return any(pair <= names_of(cause) for cause in causes)


def _separated(row):
    """The run that was proposed separates the pair.

    The runner has simulated that run with the injector's own bench: the two effects, each of the
    size that was hidden, must be so far apart on it that a wrong name has 1 % (4.65 sigmas).
    """
    return (row.entry.get("proposal") or {}).get("sigmas", 0.0) >= SEPARATED


def mark(row):
    """Marks of one record for the one number: 1, 0.5, 0 or -1."""
    verdict = row.verdict
    if verdict.wrong_certain:
        return -1.0
    if verdict.exact or (row.truth["part"] == "D" and _honest(row)):
        return 1.0
    return 0.5 if verdict.covered and verdict.set_size <= 3.0 else 0.0


def _score(rows):
    some = [row for row in rows if row.truth["part"] in "BCDE"]
    if not some:
        return None, 0
    alarms, _ = share(row.verdict.alarm for row in _part(rows, "A"))
    return statistics.fmean(map(mark, some)) - 5.0 * max(0.0, (alarms or 0.0) - 0.01), len(some)


def _machine(rows):
    out = {}
    for record in ("compact", "short", "mixed", "constant", "protocol", "long", "loads"):
        spent = [_cpu(row) for row in rows if row.truth["record"] == record]
        memory = [row.entry["peak_mb"] for row in rows if row.truth["record"] == record]
        if spent:
            out[record] = (statistics.median(spent), max(spent), max(memory), len(spent))
    return out


def _cpu(row):
    """Seconds of one core; wall time where an old campaign kept nothing else."""
    return row.entry.get("cpu_s", row.entry["seconds"])


def _time(rows):
    """Slowest of the records of 172 s, and the most memory of any up to that length."""
    whole = [_cpu(row) for row in rows if row.truth["record"] == "protocol"]
    memory = [row.entry["peak_mb"] for row in rows if row.truth["record"] != "long"]
    return {
        "slowest_172_s": (max(whole) if whole else None, len(whole)),
        "most_memory_gb": (max(memory) / 1024.0 if memory else None, len(memory)),
    }


def _flagged(row):
    answer = row.entry.get("answer") or {}
    told = answer.get("data_flags") or row.verdict.named or "refused" in row.entry
    return bool(told) or answer.get("verdict") == "data-bad"


def _faults(rows):
    by = defaultdict(list)
    for row in rows:
        by[row.truth["fault"]].append(row)
    return {
        fault: {
            "flagged": share(map(_flagged, some)),
            **shares(some, {"own_name": "fault_told"}),
            "wrong_names": mean(row.verdict.phantoms for row in some),
            "no_answer": share("crashed" in row.entry for row in some),
        }
        for fault, some in sorted(by.items())
    }


def figures(rows):
    """Return all figures of judged `rows`: name to (value, number of records)."""
    single, physical = _part(rows, "B"), _part(rows, "P")
    asked = [row for row in (*single, *physical) if row.verdict.named]
    bad = [row for row in _part(rows, "F") if FAULT_NAMES.get(row.truth["fault"])]
    return {
        **_clean(_part(rows, "A")),
        **_single(single),
        **_parameters((*single, *physical)),
        "gain_d10_up": _gain([row for row in single if row.tier in ("d10", "d20")], False),
        "gain_physical": _gain(physical, True),
        **_doubles(_part(rows, "C")),
        **_outside(_part(rows, "D")),
        "phantoms": mean(row.verdict.phantoms for row in physical),
        **shares(physical, {"physical_name": "exact", "physical_cover": "covered"}),
        **_duels(_part(rows, "E")),
        "calibration_error": calibration_error(asked),
        "brier": brier(asked),
        "score": _score(rows),
        "crashes": share("crashed" in row.entry for row in rows),
        "refusals": share("refused" in row.entry for row in rows if row.truth["part"] != "F"),
        **shares(bad, {"fault_told": "fault_told"}),
        **_time(rows),
        "faults": _faults(_part(rows, "F")),
        "machine": _machine(rows),
    }
