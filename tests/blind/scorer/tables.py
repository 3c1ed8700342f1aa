"""Answers as tables: by family, by what is outside, confusions, and one record on one line."""

import random
from collections import Counter, defaultdict

from .judge import judge
from .metrics import Row, shares


def _cause(cause):
    extra = "".join(f"~{name}" for name in cause.get("group", ())[1:])
    rivals = "".join(f" or {name}" for name in cause.get("rivals", ()))
    return f"{cause['name']}{extra}{rivals}"


def one_line(truth, entry, verdict):
    """Hidden, answered, scored, seconds and megabytes."""
    hidden = " + ".join(
        f"{e['name']} {e['tier']}" + (f" d={e['d']:.1f}" if e["d"] else "") for e in truth["hidden"]
    )
    hidden = hidden or truth["fault"] or "clean"
    group = " ".join(
        "{" + ",".join(sorted(n for n, v in e["alike"].items() if v < 0.01)) + "}"
        for e in truth["hidden"]
    )
    answer = entry.get("answer")
    if answer is None:
        said = entry.get("refused") or entry.get("crashed")
    else:
        left = [f"?{u['domain']}@{u['location']:.4g}" for u in answer["unexplained"]]
        flags = sorted({f"!{f['name']}" for f in answer.get("data_flags", ())})
        minor = [f"({c['name']})" for c in answer.get("minor", ())]
        said = "; ".join([*map(_cause, answer["causes"]), *left, *minor, *flags]) or "nothing"
    marks = [
        word
        for word, is_set in (
            ("EXACT", verdict.exact),
            ("covered", verdict.covered and not verdict.exact),
            ("WRONG-CERTAIN", verdict.wrong_certain),
            ("alarm", verdict.alarm and not truth["hidden"] and not truth["fault"]),
            ("TOLD", verdict.fault_told),
            ("missed", bool(truth["hidden"]) and not verdict.alarm),
        )
        if is_set
    ]
    away = " ".join(f"{p}:{z:+.2f}" for _, p, z, _ in verdict.deviations)
    return (
        f"{truth['key']} [{truth['record']} {truth['noise']} {truth['sigma_nm']}] {hidden} {group}"
        f" -> {said} | {' '.join(marks) or '-'} {away} | {entry['seconds']:.1f} s "
        f"{entry['peak_mb']:.0f} MB"
    )


def _family(row):
    return row.truth["hidden"][0]["name"] if len(row.truth["hidden"]) == 1 else ""


def _grouped(rows, parts):
    out = defaultdict(list)
    for row in rows:
        if row.truth["part"] in parts and _family(row):
            out[_family(row)].append(row)
    return dict(sorted(out.items()))


def _cells(rows, second, tiers=None):
    rows = [row for row in rows if tiers is None or row.tier in tiers]
    said = ("alarm", second, "covered", "wrong_certain")
    return tuple(shares(rows, dict(zip(said, said, strict=True))).values())


def by_family(rows, parts="BP"):
    """family: (weak, strong, physical), each (detected, exact, covered, wrong certain)."""
    sizes = (("d5", "d7"), ("d10", "d20"), ("low", "mid", "high"))
    return {
        name: tuple(_cells(some, "exact", tiers) for tiers in sizes)
        for name, some in _grouped(rows, parts).items()
    }


def by_outside(rows):
    """kind: (alarm, right domain, free place named, wrong certain, most frequent answers)."""
    out = {}
    for name, some in _grouped(rows, "D").items():
        said = Counter(
            ", ".join([*row.verdict.named, *(["unexplained"] if row.verdict.unexplained else [])])
            or "nothing"
            for row in some
        )
        out[name] = (*_cells(some, "right_domain"), said.most_common(2))
    return out


def _answered_as(row):
    verdict, effect = row.verdict, row.truth["hidden"][0]
    if verdict.covered:
        return effect["name"]
    if verdict.named:
        return verdict.named[0]
    if verdict.unexplained:
        return "unexplained"
    return "nothing" if verdict.answered else "no answer"


def confusion(rows, parts="BP", tiers=("d10", "d20", "mid", "high")):
    """{(true, answered): count}; an answer whose set holds the true group counts as true."""
    out = Counter()
    for name, some in _grouped(rows, parts).items():
        for row in some:
            if row.tier in tiers:
                out[name, _answered_as(row)] += 1
    return out


def shuffled_rows(rows, seed=1):
    """The same answers against truths dealt out anew within each part: must fall to chance."""
    parts = defaultdict(list)
    for row in rows:
        if row.truth["hidden"]:
            parts[row.truth["part"]].append(row)
    out = [row for row in rows if not row.truth["hidden"]]
    for some in parts.values():
        truths = [row.truth for row in some]
        random.Random(seed).shuffle(truths)
        for truth, row in zip(truths, some, strict=True):
            out.append(Row((truth, row.entry, judge(truth, row.entry))))
    return out
