"""Shares, and how well stated probabilities come true."""

from collections import defaultdict

__all__ = ["brier", "calibration_error", "share"]


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
