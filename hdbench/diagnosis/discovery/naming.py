"""Naming: one table of evidence for each cause, its group, rivals and probability."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hdbench.diagnosis.discovery.dictionary import Look
from hdbench.diagnosis.discovery.fit import Beside, Fit
from hdbench.diagnosis.discovery.form import STRONG
from hdbench.diagnosis.discovery.joint import all_possible, best_joined, on_simulated, value_of
from hdbench.diagnosis.discovery.lines import scan_looks
from hdbench.diagnosis.discovery.loudness import loudness_of
from hdbench.diagnosis.discovery.refine import (
    Candidate,
    candidate_of,
    of_right_size,
    refined,
    weighed,
)
from hdbench.diagnosis.discovery.search import Search, needed_nats, settled
from hdbench.diagnosis.discovery.tables import is_table
from hdbench.diagnosis.discovery.term import is_line, is_other_torque, is_whole_share, same_torque
from hdbench.diagnosis.evidence import RIVAL_NATS, SAME_SPACE
from hdbench.model import Cause
from hdbench.records.trace import FloatArray

# names that are weighed against a cause
_NAMES = 7
# names that are fitted with their form errors against a strong cause
_FITTED = 3
# sweeps in which a better name may take a place
_SWEEPS = 2
# another name for an effect explains more of it than not; the rest of the table are other effects
_SAME_EFFECT = 0.5
# a look this far behind cannot become a rival by a better shape
_BEHIND_NATS = 12.0


@dataclass(frozen=True, slots=True)
class Named:
    """A cause and what it could also be.

    Parameters
    ----------
    best : Candidate
        The cause itself, beside all others.
    group, rivals : tuple of Candidate
        Other names that span the same space, and that are nearly as likely.
    probability : float
        Of the group, among all names.
    """

    best: Candidate
    group: tuple[Candidate, ...]
    rivals: tuple[Candidate, ...]
    probability: float


def name_causes(search: Search) -> dict[int, Named]:
    """Name every cause against all others.

    Where a better name, no other form of the same torque, takes a place the search goes on; so it
    does where no name is better, but a table is.
    """
    for _ in range(_SWEEPS):
        tables, swapped, moved = _swept(search)
        exchanged = not swapped and search.exchange_for_table()
        if not (swapped or exchanged):
            break
        search.reshape_all()
        search.prune(most=0)
        if moved or exchanged:
            search.go_on()
    if (
        swapped
        or exchanged
        or any(table[0].evidence_nats < needed_nats(table[0].term) for table in tables.values())
    ):
        search.prune(None, most=0)
        tables = {part: _table(search, part) for part in search.fit.causes()}
    return {part: _named(search.fit.beside(part), table) for part, table in tables.items()}


def _swept(search: Search) -> tuple[dict[int, list[Candidate]], bool, bool]:
    """Return the table of each cause, and whether a better name took the place of one.

    And whether such a name is no other form of the same torque.
    """
    tables, swapped, moved = {}, False, False
    for term in [search.fit.parts[part].term for part in search.fit.causes()]:
        part = next((at for at, held in enumerate(search.fit.parts) if held.term is term), None)
        if part is None:
            # a better name made it needless
            continue
        table = tables[part] = _table(search, part)
        own = table[0]
        names = [c for c in table[1:] if not is_table(c.term.cause)]
        for better in sorted(names, key=lambda c: -c.evidence_nats):
            # a line was found before its harmonics were looked at: the likelier name is its first
            lines = is_line(own.term.cause) and is_line(better.term.cause)
            enough = max(own.evidence_nats + (0.0 if lines else RIVAL_NATS), 0.0)
            if better.evidence_nats < enough:
                break
            if search.replace_term(part, own, better):
                search.log.append(
                    f"renamed {own.name} {own.evidence_nats:.1f} -> {better.name} "
                    f"{better.evidence_nats:.1f}"
                )
                moved |= not same_torque(own.term.cause, better.term.cause)
                swapped = True
                break
    return tables, swapped, moved


def _table(search: Search, part: int) -> list[Candidate]:
    """Return the cause itself, then every other name with its evidence beside all other causes."""
    fit = search.fit
    term = fit.term(part)
    beside = search.beside_names(part)
    base = settled(beside, fit)
    # what acts on the whole signal does so before the cause, not after it
    view = on_simulated(fit.without_view(part))
    record = view.record
    own = candidate_of(beside, record, term, fit.parts[part].trials, 0.0)
    own = weighed(beside, record, own, fit.shapes, base)
    if not np.isfinite(own.evidence_nats):
        # beside the others alone its size is a little outside of its limits
        own = replace(own, evidence_nats=search.lost_without(part))
    if is_table(term.cause):
        return [own]
    looks = _looks(search, beside, part)
    best = 0.5 * own.statistic
    table = [own]
    for look in looks:
        # a look at a strong line is less than the line: it is formed first
        start = candidate_of(beside, record, look.term, look.trials, 1.0)
        if is_whole_share(look.term.cause):
            start = of_right_size(beside, record, start)
        if 0.5 * start.statistic < best - _BEHIND_NATS - 0.15 * best:
            continue
        shaped = refined(beside, record, start)
        if _share_of(beside, own, shaped) > _SAME_EFFECT:
            table.append(weighed(beside, record, shaped, fit.shapes, base))
    strong = own.gain_nats * own.loud > 0.5 * STRONG
    return _alike(_with_forms(fit, view, beside, table) if strong else table)


def _alike(table: list[Candidate]) -> list[Candidate]:
    """Return a table in which the noise is as loud for all names as it is for the cause itself."""
    loud = table[0].loud
    return [
        replace(c, evidence_nats=c.plain_nats - (1.0 - 1.0 / loud) * c.gain_nats * c.loud)
        for c in table
    ]


def _with_forms(fit: Fit, view: Fit, beside: Beside, table: list[Candidate]) -> list[Candidate]:
    """Return a table with the evidence that the likeliest names have with their form errors.

    Where one of them is nearly as likely as the cause, both are looked at over their whole domains.
    """
    ranked = sorted(table[1:], key=lambda c: -c.evidence_nats)
    out = _formed(fit, view, beside, [table[0], *ranked[:_FITTED]])
    least = out[0].evidence_nats - RIVAL_NATS
    near = [c for c in out[1:] if c.evidence_nats > least]
    far = [c for c in out[1:] if c.evidence_nats <= least]
    return [*_formed(fit, view, beside, [table[0], *near], wide=True), *far] if near else out


def _formed(
    fit: Fit, view: Fit, beside: Beside, table: list[Candidate], *, wide: bool = False
) -> list[Candidate]:
    """Return the names of a table that can be, each fitted with its form error; the cause first.

    All are put into a view of the fit that is without the cause. What the fit gains over that for
    the cause itself, as its parts were fitted together, any other name would gain, too.
    """
    base, together = value_of(view), 0.0
    out = []
    for found in table:
        new, (term,) = best_joined(view, (found.term,), wide=wide)
        own = found is table[0]
        if own:
            together = max(value_of(fit) - value_of(new), 0.0)
        elif not all_possible(new, 1):
            continue
        loud = loudness_of(new, [len(new.parts) - 1])
        gain = (value_of(new) + together - base) / loud
        cost = found.gain_nats - found.evidence_nats
        moved = found
        if not own and term != found.term:
            moved = candidate_of(beside, view.record, term, found.trials, found.false_alarm)
        out.append(replace(moved, gain_nats=gain, evidence_nats=gain - cost, loud=loud))
    return out


def _looks(search: Search, beside: Beside, part: int) -> list[Look]:
    """Return one look of each other name, the best first."""
    fit = search.fit
    term = fit.term(part)
    others = [p.term.cause for i, p in enumerate(fit.parts) if i != part and p.term is not None]
    others = [cause for cause in others if not is_line(cause)]

    def is_new(cause: Cause) -> bool:
        return cause.name != term.name and is_other_torque(cause, others)

    chosen: dict[str, Look] = {}
    for look in search.names.looks(beside):
        if is_new(look.term.cause) and look.term.name not in chosen:
            chosen[look.term.name] = look
    looks = sorted(chosen.values(), key=lambda x: -x.statistic)[:_NAMES]
    if is_line(term.cause) or term.cause.locked_to in ("motor", "clock"):
        view = fit.without_view(part)
        for look in scan_looks(view, search.scans, search.causes):
            if is_new(look.term.cause) and not is_table(look.term.cause):
                looks.append(look)
    return looks


def _named(beside: Beside, table: list[Candidate]) -> Named:
    """Return group, rivals and probability from a table of evidence; the first is the cause."""
    own = table[0]
    best: dict[str, Candidate] = {}
    for one in table[1:]:
        held = best.get(one.name)
        if one.name != own.name and (held is None or one.evidence_nats > held.evidence_nats):
            best[one.name] = one
    others = [c for c in best.values() if np.isfinite(c.evidence_nats)]
    group = tuple(c for c in others if _is_plain(c, own) or _same_space(beside, own, c))
    names = {c.name for c in group}
    rivals = tuple(
        c
        for c in sorted(others, key=lambda c: -c.evidence_nats)
        if c.name not in names and c.evidence_nats > own.evidence_nats - RIVAL_NATS
    )
    nats = np.array([c.evidence_nats for c in (own, *others)])
    weights = np.exp(nats - nats.max())
    mine = weights[0] + sum(w for w, c in zip(weights[1:], others, strict=True) if c.name in names)
    return Named(own, group, rivals, float(mine / weights.sum()))


def _is_plain(other: Candidate, own: Candidate) -> bool:
    """Return whether a candidate is the common form of a cause and says all but a hundredth of it.

    Or the cause is at the end of its domain, where it is the common form.
    """
    cause = own.term.cause
    at_end = any(own.term.shape[p.name] == p.lower for p in cause.shape)
    as_much = other.evidence_nats > (1.0 - SAME_SPACE) * own.evidence_nats
    return (at_end or as_much) and other.term.cause.common and other.name == cause.form_of


def _same_space(beside: Beside, one: Candidate, other: Candidate) -> bool:
    """Return whether the largest angle between two effects has a sine squared below a hundredth."""
    matrix, _ = beside.project(np.concatenate([one.rows, other.rows]))
    k = len(one.rows)
    a, b, c = matrix[:k, :k], matrix[k:, k:], matrix[:k, k:]
    la, lb = _inverse_root(a), _inverse_root(b)
    if len(la) != len(lb) or not len(la):
        return False
    cosines = np.linalg.svd(la @ c @ lb.T, compute_uv=False)
    return float(1.0 - cosines.min() ** 2) < SAME_SPACE


def _share_of(beside: Beside, one: Candidate, other: Candidate) -> float:
    """Return the share of what one effect explains that another could explain."""
    matrix, against = beside.project(np.concatenate([one.rows, other.rows]))
    k = len(one.rows)
    size = np.linalg.lstsq(matrix[:k, :k], against[:k], rcond=1e-9)[0]
    root = _inverse_root(matrix[k:, k:])
    both = root @ matrix[k:, :k] @ size
    return float(both @ both / max(size @ matrix[:k, :k] @ size, 1e-300))


def _inverse_root(matrix: FloatArray) -> FloatArray:
    value, vector = np.linalg.eigh(matrix)
    kept = value > 1e-6 * max(float(value[-1]), 1e-300)
    return np.asarray((vector[:, kept] / np.sqrt(value[kept])).T)
