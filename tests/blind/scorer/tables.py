"""Tables by family, the confusion of names, and the shuffled truth."""

import random
from collections import Counter, defaultdict

from .binning import share
from .judge import judge
from .metrics import Row

__all__ = ["by_family", "by_outside", "confusion", "shuffled_rows"]


def _family(row):
    return row.truth["hidden"][0]["name"] if len(row.truth["hidden"]) == 1 else ""


def _grouped(rows, parts):
    out = defaultdict(list)
    for row in rows:
        if row.truth["part"] in parts and _family(row):
            out[_family(row)].append(row)
    return dict(sorted(out.items()))


def _cells(some, tiers):
    chosen = [row for row in some if row.tier in tiers]
    return (
        share(row.verdict.alarm for row in chosen),
        share(row.verdict.exact for row in chosen),
        share(row.verdict.covered for row in chosen),
        share(row.verdict.wrong_certain for row in chosen),
    )


def by_family(rows, parts="BP"):
    """family: (weak, strong, physical), each (detected, exact, covered, wrong certain)."""
    sizes = (("d5", "d7"), ("d10", "d20"), ("low", "mid", "high"))
    return {
        name: tuple(_cells(some, tiers) for tiers in sizes)
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
        out[name] = (
            share(row.verdict.alarm for row in some),
            share(row.verdict.right_domain for row in some),
            share(row.verdict.covered for row in some),
            share(row.verdict.wrong_certain for row in some),
            said.most_common(2),
        )
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
