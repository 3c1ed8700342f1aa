"""Shares, and how well stated probabilities come true."""

from collections import defaultdict

__all__ = ["calibration_error", "share"]


def share(flags):
    """(share of true flags or None, number of flags)."""
    flags = [bool(flag) for flag in flags]
    return (sum(flags) / len(flags) if flags else None), len(flags)


def calibration_error(rows):
    """Expected calibration error of the first name: it is in the true group with P = 1 / set."""
    bins = defaultdict(list)
    for row in rows:
        if row.verdict.probability is None:
            continue
        effect = row.truth["hidden"][0]
        same = {name for name, value in effect["alike"].items() if value < 0.01}
        right = row.verdict.named[0] in same
        bins[min(9, int(10.0 * row.verdict.probability))].append((row.verdict.probability, right))
    count = sum(map(len, bins.values()))
    if not count:
        return None, 0
    error = 0.0
    for some in bins.values():
        stated = sum(p for p, _ in some) / len(some)
        true = sum(right for _, right in some) / len(some)
        error += len(some) / count * abs(stated - true)
    return error, count
