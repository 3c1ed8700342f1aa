"""Missing, clipped and spiky samples as named causes, with what each costs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.acquisition.flags import DataFlag
from hdbench.diagnosis.acquisition.measure import (
    Residual,
    gain_of,
    share_of,
)
from hdbench.diagnosis.acquisition.named import (
    Acquired,
    Tail,
    acquired_cause,
    entry,
    normal_tail,
)
from hdbench.model import CauseTerm
from hdbench.records.trace import FloatArray

__all__ = ["Cost", "clipping", "gaps", "spiky"]

# a finite number for what the stamps themselves say: no statistic is needed
_CERTAIN = Tail(700.0, 0.0)


@dataclass(frozen=True, slots=True)
class Cost:
    """What the masked samples cost the baseline.

    Parameters
    ----------
    full : Residual
        Residual of every sample that has a value, by a baseline that masked ones did not train.
    used : ndarray of bool, shape (n,)
        Samples that the diagnosis uses.
    time_s : ndarray, shape (n,)
        Time, s.
    rng : Generator
        For the bootstrap.
    """

    full: Residual
    used: NDArray[np.bool_]
    time_s: FloatArray
    rng: np.random.Generator

    def of(self, mask: NDArray[np.bool_]) -> tuple[Residual, Residual]:
        """Return the residual with the marked samples in, and without them."""
        left, there = self.full.left_nm, self.full.valid
        return Residual(left, there & (self.used | mask)), Residual(left, there & self.used)

    def scatter_nm(self) -> float:
        """Return the robust scatter of what is used, N m."""
        left = np.abs(self.full.left_nm[self.full.valid & self.used])
        return float(np.quantile(left, 0.6827)) if len(left) else 0.0


def _masked(
    what: tuple[str, str],
    parameters: dict[str, dict[str, float | str | None]],
    tail: Tail,
    cost: Cost,
    mask: NDArray[np.bool_],
) -> Acquired:
    """Return masked samples as a cause; what: name and domain."""
    name, domain = what
    before, after = cost.of(mask)
    measured = (gain_of(before, after, cost.rng), share_of(before, after))
    cause = acquired_cause(name, parameters, tail, measured, domain=domain)
    return Acquired(cause)


def gaps(flags: tuple[DataFlag, ...], held: NDArray[np.bool_], cost: Cost) -> list[Acquired]:
    """Return the missing samples as one cause, none where none is missing.

    Parameters
    ----------
    flags : tuple of DataFlag
        Flags of the record.
    held : ndarray of bool, shape (n,)
        Samples that repeat the one before.
    cost : Cost
        What masked samples cost.

    Returns
    -------
    list of Acquired
    """
    lost = [flag for flag in flags if flag.name == "missed-samples"]
    if not lost:
        return []
    count = sum(flag.samples for flag in lost)
    parameters = {
        "samples": entry(count, 0.0, "1"),
        "stretches": entry(len(lost), 0.0, "1"),
        "step_time_s": entry(lost[0].from_s, None, "s"),
    }
    return [_masked(("missed-samples", "time"), parameters, _CERTAIN, cost, held)]


def clipping(torque: FloatArray, clipped: NDArray[np.bool_], cost: Cost) -> list[Acquired]:
    """Return clipped samples as a saturation, none where none is clipped.

    Parameters
    ----------
    torque : ndarray, shape (n,)
        Torque, N m.
    clipped : ndarray of bool, shape (n,)
        Samples at a limit.
    cost : Cost
        What masked samples cost.

    Returns
    -------
    list of Acquired

    Notes
    -----
    The evidence is that of so many samples at the limits where Poisson numbers as large as those
    of the values next to them were to be expected.
    """
    if not clipped.any():
        return []
    low, high = float(torque[clipped].min()), float(torque[clipped].max())
    others = torque[np.isfinite(torque) & ~clipped]
    counts = np.unique(others, return_counts=True)[1] if len(others) else np.ones(1, dtype=np.intp)
    expected = float(max(1, counts[:3].max(), counts[-3:].max()))
    seen = float(clipped.sum())
    nats = max(0.0, seen * float(np.log(seen / expected)) - seen + expected)
    parameters = {
        "limit_nm": entry(max(abs(low), abs(high)), None, "N m"),
        "samples": entry(seen, 0.0, "1"),
    }
    tail = Tail(nats, float(np.exp(-nats)))
    return [_masked(("saturation", "torque"), parameters, tail, cost, clipped)]


def spiky(spikes: NDArray[np.bool_], sizes_nm: FloatArray, cost: Cost) -> list[Acquired]:
    """Return spikes as one cause, none where there is none or nothing speaks for it.

    Parameters
    ----------
    spikes : ndarray of bool, shape (n,)
        Isolated samples far from the rest.
    sizes_nm : ndarray, shape (n,)
        Their distance from the rest, N m.
    cost : Cost
        What masked samples cost.

    Returns
    -------
    list of Acquired
    """
    if not spikes.any():
        return []
    scatter = cost.scatter_nm()
    largest = float(np.abs(sizes_nm[spikes]).max())
    count, total = int(spikes.sum()), len(spikes)
    size = float(np.sqrt(np.mean(sizes_nm[spikes] ** 2)))
    parameters = {
        "share": entry(count / total, float(np.sqrt(count)) / total, "1"),
        "size_nm": entry(size, size / float(np.sqrt(2.0 * count)), "N m"),
        "samples": entry(count, 0.0, "1"),
        "largest_nm": entry(largest, scatter, "N m"),
        "first_s": entry(float(cost.time_s[int(np.argmax(spikes))]), None, "s"),
    }
    sigmas = np.abs(sizes_nm[spikes]) / max(scatter, 1e-300)
    # each has a place among all samples and a size of its own
    nats = float(np.sum(0.5 * sigmas**2 - np.log(total) - 0.5 * np.log(total)))
    if not nats > 0.0:
        return []
    tail = Tail(nats, normal_tail(float(sigmas.max()), total, 1, total).chance)
    found = _masked(("spikes", "outliers"), parameters, tail, cost, spikes)
    return [replace(found, term=CauseTerm("spikes", {"share": count / total, "size_nm": size}, ()))]
