"""Sums of the filter in Python, each in the order in which the kernel adds."""

from __future__ import annotations

import math

__all__ = ["Likelihood", "added", "along"]


def added(values: list[float]) -> float:
    """Add up from the left; `sum` of newer Pythons compensates its rounding."""
    total = 0.0
    for value in values:
        total += value
    return total


def along(n_oscillators: int, step: list[list[float]], x: list[float]) -> float:
    """Return C x as vectors are folded: even and odd states apart, every fourth slot together."""
    even, odd = [0.0] * 4, [0.0] * 4
    for i, block in enumerate(step):
        if i < n_oscillators:
            even[i % 4] += x[2 * i] * block[0]
            odd[i % 4] += x[2 * i + 1] * block[1]
        else:
            even[(i + max(3 - n_oscillators, 0)) % 4] += x[2 * i]
    return ((even[0] + even[2]) + (even[1] + even[3])) + ((odd[0] + odd[2]) + (odd[1] + odd[3]))


class Likelihood:
    """Number of samples used, sum of log S and sum of e^2 / S, over one call.

    The logarithm is taken of products of S, from time to time.
    """

    def __init__(self) -> None:
        self.seen, self.used = 0, 0
        self.product, self.log_sum, self.squares = 1.0, 0.0, 0.0

    def count(self, innovation: float, variance: float, inverse: float) -> None:
        """Add a sample."""
        self.seen += 1
        if inverse > 0.0:
            self.used += 1
            self.squares += innovation * innovation * inverse
            self.product *= variance
        if self.seen % 8 == 0 and not 1e-150 < self.product < 1e150:
            self.log_sum += math.log(self.product)
            self.product = 1.0

    def sums(self) -> tuple[float, float, float]:
        """Return number of samples used, sum of log S and sum of e^2 / S."""
        return float(self.used), self.log_sum + math.log(self.product), self.squares
