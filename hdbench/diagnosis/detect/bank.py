"""Columns of all families, made once for a record and tested against any residual of it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.detect.shapes import chosen_shapes
from hdbench.diagnosis.fit.terms import Term, fresh_columns, harmonics
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.noise.convolution import DIRECT, convolution
from hdbench.diagnosis.noise.whitened import Whitener
from hdbench.model import Cause
from hdbench.records.trace import FloatArray

__all__ = ["Bank", "Gram", "Grams", "Member", "bank_gram", "build_bank"]

# rows that are whitened at a time
_CHUNK = 4096
# one of so many rows, picked at random, stands for all: what is slow and what is fast alike
_SAMPLED = 6
# memory that the columns may take, bytes; families beyond it get fewer shapes
_MEMORY = 3.2e8


@dataclass(frozen=True, slots=True)
class Member:
    """A term of a bank.

    Parameters
    ----------
    term : Term
        Cause with a shape.
    place : slice
        Its columns in the table.
    peak_nm : float
        Largest torque of its columns as they stand in the table, N m per unit of the norm.
    whole : bool
        False for one harmonic of several: a member of its own where the others are small.
    """

    term: Term
    place: slice
    peak_nm: float
    whole: bool = True


@dataclass(frozen=True, slots=True)
class Bank:
    """Members of all families with their columns.

    Parameters
    ----------
    members : tuple of Member
        Members, family by family; a member's harmonics follow it.
    table : ndarray of float32, shape (n_samples, n_columns)
        Their columns, each scaled to unit mean square.
    """

    members: tuple[Member, ...]
    table: NDArray[np.float32]

    @property
    def families(self) -> dict[str, list[int]]:
        """Indices of the members of each family, by the cause's name."""
        found: dict[str, list[int]] = {}
        for index, member in enumerate(self.members):
            found.setdefault(member.term.cause.name, []).append(index)
        return found

    @property
    def family_places(self) -> tuple[slice, ...]:
        """Columns of each family: its members stand side by side."""
        return tuple(
            slice(self.members[index[0]].place.start, self.members[index[-1]].place.stop)
            for index in self.families.values()
        )


def build_bank(record: Record, causes: Iterable[Cause]) -> Bank:
    """Return the bank of causes on a record.

    Parameters
    ----------
    record : Record
        Record.
    causes : iterable of Cause
        Causes that the record can show.

    Returns
    -------
    Bank
        Without members whose columns are zero or not finite.
    """
    terms = [chosen_shapes(cause, record) for cause in causes]
    most = int(_MEMORY / (4.0 * len(record.valid)))
    while _n_columns(terms) > most:
        longest = max(range(len(terms)), key=lambda k: len(terms[k]))
        if len(terms[longest]) <= 1:
            break
        terms[longest] = terms[longest][::2]
    members: list[Member] = []
    table = np.empty((len(record.valid), _n_columns(terms)), dtype=np.float32, order="F")
    at = 0
    for term in (t for family in terms for t in family):
        columns = fresh_columns(term, record)
        square = np.einsum("nk,nk->k", columns, columns)
        if not np.all((square > 0.0) & (square < np.inf)):
            continue
        columns /= np.sqrt(square / len(columns))
        members += _with_parts(term, columns, at)
        table[:, at : at + columns.shape[1]] = columns
        at += columns.shape[1]
    return Bank(tuple(members), table[:, :at])


def _with_parts(term: Term, columns: FloatArray, at: int) -> list[Member]:
    """Return a member with columns from a place on, and its harmonics where it has several."""
    parts = harmonics(term.cause)
    own = [list(range(columns.shape[1])), *(parts if len(parts) > 1 else [])]
    members = []
    for part in own:
        some = columns[:, part[0] : part[-1] + 1]
        peak = float(np.sqrt(np.max(np.einsum("nk,nk->n", some, some))))
        members.append(Member(term, slice(at + part[0], at + part[-1] + 1), peak, part is own[0]))
    return members


def _n_columns(terms: list[list[Term]]) -> int:
    """Return how many columns the members of some families have."""
    return sum(len(family[0].cause.linear) * len(family) for family in terms if family)


@dataclass(frozen=True, slots=True)
class Gram:
    """Whitened columns of a bank, as far as a look needs them.

    Parameters
    ----------
    blocks : tuple of ndarray
        Gram matrix of each family's whitened columns.
    rows : ndarray of int, shape (m,)
        Some samples, picked at random.
    sample : ndarray, shape (m, n_columns)
        All whitened columns at these.
    """

    blocks: tuple[FloatArray, ...]
    rows: NDArray[np.int64]
    sample: NDArray[np.float32]

    def scaled(self, factor: float) -> Gram:
        """Return the same for whitened columns times a factor."""
        if factor == 1.0:
            return self
        blocks = tuple(block * factor**2 for block in self.blocks)
        return Gram(blocks, self.rows, self.sample * np.float32(factor))


@dataclass(frozen=True, slots=True)
class Grams:
    """Gram matrices of both banks for one noise.

    Parameters
    ----------
    whitener : Whitener
        Noise.
    bank, curves : Gram
        As `bank_gram` gives them.
    """

    whitener: Whitener
    bank: Gram
    curves: Gram


def bank_gram(bank: Bank, whitener: Whitener) -> Gram:
    """Return the Gram matrix of the whitened columns of each family.

    Parameters
    ----------
    bank : Bank
        Bank.
    whitener : Whitener
        Noise.

    Returns
    -------
    Gram
        Formed chunk by chunk, so that whitened columns are never all in memory.
    """
    places = bank.family_places
    if len(whitener.kernel) > DIRECT:
        return _long_gram(bank, whitener)
    blocks = [np.zeros((p.stop - p.start,) * 2) for p in places]
    starts = range(0, len(bank.table), _CHUNK)
    rows = _sampled(len(bank.table))
    edges = np.searchsorted(rows, [*starts, len(bank.table)])
    sample = np.empty((len(rows), bank.table.shape[1]), dtype=np.float32)
    # family by family, so that a chunk and its shifts stay in the cache
    for block, place in zip(blocks, places, strict=True):
        for start, (first, last) in zip(starts, pairwise(edges.tolist()), strict=True):
            stop = min(start + _CHUNK, len(bank.table))
            white = _white_rows(bank.table[:, place], whitener, start, stop)
            block += white.T @ white
            sample[first:last, place] = white[rows[first:last] - start]
    return Gram(tuple(blocks), rows, sample)


def _sampled(count: int) -> NDArray[np.int64]:
    """Return the rows that stand for all of a table, in order; the same for as many rows."""
    picked = np.random.default_rng(count).permutation(count)[: -(-count // _SAMPLED)]
    return np.sort(picked)


def _long_gram(bank: Bank, whitener: Whitener) -> Gram:
    """Return the same for a kernel that reaches over many chunks, family by family."""
    rows = _sampled(len(bank.table))
    sample = np.empty((len(rows), bank.table.shape[1]), dtype=np.float32)
    blocks = []
    for place in bank.family_places:
        white = whitener.apply(bank.table[:, place])
        blocks.append((white.T @ white).astype(np.float64))
        sample[:, place] = white[rows]
    return Gram(tuple(blocks), rows, sample)


def _white_rows(
    table: NDArray[np.float32], whitener: Whitener, start: int, stop: int
) -> NDArray[np.float32]:
    """Return whitened columns at the samples from `start` to `stop`."""
    kernel = whitener.kernel.astype(np.float32)
    first = max(0, start - len(kernel) + 1)
    rows = np.ascontiguousarray(table[first:stop].T)
    white = np.empty_like(rows)
    convolution(kernel, stop - first)(rows, white)
    white = white[:, start - first :].T
    white *= (whitener.used[start:stop] / whitener.std).astype(np.float32)[:, None]
    return white
