"""Figures of a campaign, each by its definition on the benchmark's page."""

import math
import statistics
from collections import defaultdict

from .judge import FAULT_NAMES, GROUP, names_of


def share(flags):
    """(share of true flags or None, number of flags)."""
    flags = [bool(flag) for flag in flags]
    return (sum(flags) / len(flags) if flags else None), len(flags)


def _stated(rows):
    """(probability stated for the first name, whether it is in the true group) of each answer."""
    for row in rows:
        if row.verdict.probability is None:
            continue
        effect = row.truth["hidden"][0]
        same = {name for name, value in effect["alike"].items() if value < 0.01}
        yield row.verdict.probability, row.verdict.named[0] in same


def brier(rows):
    """Mean square of stated probability less what came true; a uniform guess over 40 has 0.975."""
    pairs = list(_stated(rows))
    return (sum((p - right) ** 2 for p, right in pairs) / len(pairs) if pairs else None), len(pairs)


def calibration_error(rows):
    """Expected calibration error: the first name is in the true group with the P that is told."""
    bins = defaultdict(list)
    for stated, right in _stated(rows):
        bins[min(9, int(10.0 * stated))].append((stated, right))
    count = sum(map(len, bins.values()))
    if not count:
        return None, 0
    error = 0.0
    for some in bins.values():
        stated = sum(p for p, _ in some) / len(some)
        true = sum(right for _, right in some) / len(some)
        error += len(some) / count * abs(stated - true)
    return error, count


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


def _clean(rows, part="A"):
    out = {}
    chosen = [row for row in _part(rows, part) if not row.truth["hidden"]]
    for name, noises in (("white", {"white"}), ("coloured", {"ar", "flicker"})):
        some = [row for row in chosen if row.truth["noise"] in noises]
        out[f"false_alarms_{name}"] = share(row.verdict.alarm for row in some)
        out[f"false_names_{name}"] = share(bool(row.verdict.named) for row in some)
        out[f"false_unexplained_{name}"] = share(row.verdict.unexplained > 0 for row in some)
        out[f"false_flags_{name}"] = share(
            bool((row.entry.get("answer") or {}).get("data_flags")) for row in some
        )
    return out


def _first_right(row):
    """The first cause's own name is the true one's, whatever stands beside it."""
    alike = row.truth["hidden"][0]["alike"]
    named = row.verdict.named
    return bool(named) and alike.get(named[0], 1.0) < GROUP


def _single(rows):
    """By size in sigmas, on records that move through speeds (one speed is told apart)."""
    out = {}
    able = [row for row in rows if row.truth["record"] != "constant"]
    for tier in ("d3", "d5", "d7", "d10", "d20"):
        some = [row for row in able if row.tier == tier]
        found = [row for row in some if row.verdict.alarm]
        out[f"detection_{tier}"] = share(row.verdict.alarm for row in some)
        out[f"name_{tier}"] = share(row.verdict.exact for row in some)
        out[f"first_{tier}"] = share(_first_right(row) for row in some)
        out[f"cover_{tier}"] = share(row.verdict.covered for row in found)
        sizes = [row.verdict.set_size for row in found if row.verdict.covered]
        out[f"set_size_{tier}"] = (statistics.fmean(sizes) if sizes else None, len(sizes))
        out[f"wrong_certain_{tier}"] = share(row.verdict.wrong_certain for row in some)
    strong = [row for row in able if row.tier in ("d10", "d20")]
    out["wrong_certain_d10_up"] = share(row.verdict.wrong_certain for row in strong)
    flat = [row for row in rows if row.truth["record"] == "constant"]
    out["one_speed_cover"] = share(row.verdict.covered for row in flat if row.verdict.alarm)
    out["one_speed_wrong_certain"] = share(row.verdict.wrong_certain for row in flat)
    return out


def _parameters(rows):
    values = [
        (bound, own)
        for row in rows
        if row.tier in ("d10", "d20")
        for _, _, bound, own in row.verdict.deviations
    ]
    stated = [abs(own) < 1.96 for _, own in values if own is not None]
    rms = math.sqrt(statistics.fmean(b * b for b, _ in values)) if values else None
    # a wrong minimum weighs more than all others in a mean square: the middle beside it
    middle = statistics.median(abs(b) for b, _ in values) / 0.6745 if values else None
    return {
        "parameter_rms": (rms, len(values)),
        "parameter_rms_robust": (middle, len(values)),
        "parameter_coverage": share(stated),
    }


def _gain(rows, physical):
    pairs = [row.verdict.gain for row in rows if row.verdict.gain]
    pairs = [(ours, best) for ours, best in pairs if best > (0.01 if physical else 0.0)]
    if not pairs:
        return None, 0
    if physical:
        return statistics.fmean(ours / best for ours, best in pairs), len(pairs)
    return sum(ours for ours, _ in pairs) / sum(best for _, best in pairs), len(pairs)


def _are_two(row):
    """Two names of one group are one effect on that record: nothing can tell how much is whose."""
    first, second = (
        {name for name, value in effect["alike"].items() if value < GROUP}
        for effect in row.truth["hidden"]
    )
    return first != second


def _doubles(rows):
    out = {}
    rows = [row for row in rows if _are_two(row)]
    for tier in ("d10", "d15", "mid"):
        some = [row for row in rows if row.tier == tier]
        out[f"both_{tier}"] = share(row.verdict.exact for row in some)
        out[f"both_covered_{tier}"] = share(row.verdict.covered for row in some)
        out[f"one_of_two_{tier}"] = share(row.verdict.found > 0 for row in some)
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
        "duel_poor_set": share(_says_both(row) for row in poor),
        "duel_poor_both": share(_both_named(row) for row in poor),
        "duel_poor_covered": share(row.verdict.covered for row in poor),
        "duel_poor_wrong_certain": share(row.verdict.wrong_certain for row in poor),
        "duel_good_name": share(row.verdict.exact for row in good),
        "duel_good_covered": share(row.verdict.covered for row in good),
    }


def _says_both(row):
    """Both names of the pair stand in one set, and the run that was proposed separates them.

    The runner has simulated that run with the injector's own bench: the two effects, each of the
    size that was hidden, must be so far apart on it that a wrong name has 1 % (4.65 sigmas).
    """
    if not _both_named(row):
        return False
    return (row.entry.get("proposal") or {}).get("sigmas", 0.0) >= SEPARATED


def _both_named(row):
    """Both names of the pair stand in one set."""
    pair = set(row.truth["note"].split("|")[:2])
    causes = (row.entry.get("answer") or {}).get("causes", ())
    return any(pair <= names_of(cause) for cause in causes)


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
    clean = _part(rows, "A")
    alarms = sum(row.verdict.alarm for row in clean) / len(clean) if clean else 0.0
    return statistics.fmean(map(mark, some)) - 5.0 * max(0.0, alarms - 0.01), len(some)


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


def _faults(rows):
    by = defaultdict(list)
    for row in rows:
        by[row.truth["fault"]].append(row)
    return {
        fault: {
            "flagged": share(
                bool((row.entry.get("answer") or {}).get("data_flags"))
                or (row.entry.get("answer") or {}).get("verdict") == "data-bad"
                or "refused" in row.entry
                or bool(row.verdict.named)
                for row in some
            ),
            "own_name": share(row.verdict.fault_told for row in some),
            "wrong_names": (sum(row.verdict.phantoms for row in some) / len(some), len(some)),
            "no_answer": share("crashed" in row.entry for row in some),
        }
        for fault, some in sorted(by.items())
    }


def figures(rows):
    """Return all figures of judged `rows`: name to (value, number of records)."""
    single, physical = _part(rows, "B"), _part(rows, "P")
    phantoms = [row.verdict.phantoms for row in physical]
    asked = [row for row in (*single, *physical) if row.verdict.named]
    return {
        **_clean(rows),
        **_single(single),
        **_parameters((*single, *physical)),
        "gain_d10_up": _gain([row for row in single if row.tier in ("d10", "d20")], False),
        "gain_physical": _gain(physical, True),
        **_doubles(_part(rows, "C")),
        **_outside(_part(rows, "D")),
        "phantoms": (statistics.fmean(phantoms) if phantoms else None, len(phantoms)),
        "physical_name": share(row.verdict.exact for row in physical),
        "physical_cover": share(row.verdict.covered for row in physical),
        **_duels(_part(rows, "E")),
        "calibration_error": calibration_error(asked),
        "brier": brier(asked),
        "score": _score(rows),
        "crashes": share("crashed" in row.entry for row in rows),
        "refusals": share("refused" in row.entry for row in rows if row.truth["part"] != "F"),
        "fault_told": share(
            row.verdict.fault_told
            for row in _part(rows, "F")
            if FAULT_NAMES.get(row.truth["fault"])
        ),
        **_time(rows),
        "faults": _faults(_part(rows, "F")),
        "machine": _machine(rows),
    }
