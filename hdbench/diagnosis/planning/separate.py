"""The run that separates names: proposed, verified on its own motion, and put in words."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from hdbench.diagnosis.planning.blockparts import Block
from hdbench.diagnosis.planning.candidates import blocks, joined
from hdbench.diagnosis.planning.confusability import (
    CONFUSABLE,
    Confusability,
    compare,
)
from hdbench.diagnosis.planning.motion import planned_motion, planned_trace
from hdbench.diagnosis.planning.propose import Pair, Proposal, choose_blocks
from hdbench.diagnosis.planning.questions import effects_named, effects_of_result
from hdbench.diagnosis.planning.segments import MotionPlan
from hdbench.diagnosis.planning.signatures import (
    Effect,
    effect_columns,
    fitted_shape,
    nominal_shape,
)
from hdbench.diagnosis.planning.sketch import Noise
from hdbench.diagnosis.planning.visibility import with_simulated
from hdbench.model import BenchModel, Cause, Motion, motion_from_trace
from hdbench.profile.schema import ProfileData

__all__ = ["DEFAULT_DURATION_S", "plan_for_result", "propose", "separating_plan"]

# the full protocol of the built-in profile without loads takes 172 s
DEFAULT_DURATION_S = 180.0
# a longer protocol has to add this much to the sum of shares
_LEAST_GAIN = 0.02


def propose(
    effects: Sequence[Effect],
    pairs: Sequence[tuple[str, str]],
    profile: ProfileData,
    *,
    motion: Motion | None = None,
    duration_s: float = DEFAULT_DURATION_S,
    loads: bool = True,
    noise: Noise | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> Proposal:
    """Propose the run that tells pairs of names apart, and compute how well it does.

    Parameters
    ----------
    effects : sequence of Effect
        Effects with their shapes.
    pairs : sequence of (str, str)
        Ordered pairs of their names.
    profile : ProfileData
        Bench.
    motion : Motion or None
        Motion of the run at hand.
    duration_s : float
        Budget of sampled time, s.
    loads : bool
        Whether an operator can put loads on; asked for only where motion alone does not do.
    noise : Noise or None
        Noise; white with the profile's standard deviation where None.
    progress : callable or None
        Told what is going on and the share done.

    Returns
    -------
    Proposal
    """
    before = None if motion is None else compare(motion, effects, profile, noise=noise)
    chosen, credit, after = _chosen(
        effects, pairs, profile, (duration_s, False), noise=noise, progress=progress
    )
    open_pairs = tuple(pair for pair in pairs if not _told_apart(after, pair))
    if open_pairs and loads:
        asked = {name for pair in open_pairs for name in pair}
        loaded = {e.name for e in effects if e.name in asked and _feels_load(e.cause, profile)}
        open_pairs = tuple(pair for pair in open_pairs if loaded & set(pair))
    if open_pairs and loads:
        more, attended, now = _chosen(
            effects, open_pairs, profile, (duration_s, True), noise=noise, progress=progress
        )
        if _worth(now, open_pairs) > _worth(after, open_pairs) + _LEAST_GAIN:
            names = {block.name for block in chosen}
            chosen = (*chosen, *(block for block in more if block.name not in names))
            credit = {**attended, **credit}
            after = _on_plan(joined("both", chosen), effects, profile, noise)
    result = tuple(
        Pair(a, b, before.share(a, b) if before else None, after.share(a, b) if after else None)
        for a, b in pairs
    )
    if not chosen:
        return Proposal(None, (), result, ())
    separated = [f"{p.first} from {p.second}" for p in result if p.separated]
    purpose = "tells " + _listed(separated, 4) if separated else "the best that this bench can do"
    plan = joined("separating", chosen, purpose)
    return Proposal(plan, chosen, result, _words(chosen, credit))


def _feels_load(cause: Cause, profile: ProfileData) -> bool:
    """Return whether a load on the output changes the effect of a cause."""
    if not cause.additive:
        return False
    attended = tuple(b for b in blocks(profile, long_s=0.0) if b.needs_operator)
    trace = planned_trace(joined("loads", attended), profile)
    free = trace.with_columns(load_torque_nm=np.zeros(len(trace)))
    model = BenchModel.from_profile(profile)
    with_load, without = (
        with_simulated(motion_from_trace(record, profile), model) for record in (trace, free)
    )
    shape = fitted_shape(cause, nominal_shape(cause), with_load, with_load.time_s)
    if shape is None or cause.applicable(with_load) is not None:
        return False
    loaded, unloaded = (
        np.nan_to_num(effect_columns(cause, shape, motion)) for motion in (with_load, without)
    )
    return bool(np.abs(loaded - unloaded).max(initial=0.0) > 0.0)


def _chosen(
    effects: Sequence[Effect],
    pairs: Sequence[tuple[str, str]],
    profile: ProfileData,
    budget: tuple[float, bool],
    *,
    noise: Noise | None,
    progress: Callable[[str, float], None] | None,
) -> tuple[tuple[Block, ...], dict[str, tuple[tuple[str, str], ...]], Confusability | None]:
    """Return blocks within a budget (seconds, loads allowed), credit, and what they do."""
    duration_s, loads = budget
    chosen, credit = choose_blocks(
        effects, pairs, profile, duration_s=duration_s, loads=loads, noise=noise, progress=progress
    )
    after = _on_plan(joined("chosen", chosen), effects, profile, noise) if chosen else None
    if all(_told_apart(after, pair) for pair in pairs):
        return chosen, credit, after
    # blocks that help only together are found by none of them alone: all that fit the budget
    whole = _fitting(profile, duration_s, loads)
    then = _on_plan(joined("all", whole), effects, profile, noise)
    if _worth(then, pairs) > _worth(after, pairs) + _LEAST_GAIN:
        return whole, {}, then
    return chosen, credit, after


def _fitting(profile: ProfileData, duration_s: float, loads: bool) -> tuple[Block, ...]:
    """Return the blocks of the full protocol, in order, as far as a budget goes."""
    kept: list[Block] = []
    for block in blocks(profile, long_s=0.0):
        spent = sum(b.duration_s for b in kept)
        if (loads or not block.needs_operator) and spent + block.duration_s <= duration_s:
            kept.append(block)
    return tuple(kept)


def _worth(found: Confusability | None, pairs: Sequence[tuple[str, str]]) -> float:
    """Return the sum of the pairs' shares, each up to what counts as told apart."""
    shares = [] if found is None else [found.share(*pair) for pair in pairs]
    return sum(min(share, CONFUSABLE) for share in shares if share is not None)


def _on_plan(
    plan: MotionPlan, effects: Sequence[Effect], profile: ProfileData, noise: Noise | None
) -> Confusability:
    """Return how alike the effects are on the motion of a plan."""
    return compare(planned_motion(plan, profile), effects, profile, noise=noise)


def _told_apart(after: Confusability | None, pair: tuple[str, str]) -> bool:
    share = None if after is None else after.share(*pair)
    return share is not None and share >= CONFUSABLE


def _words(
    chosen: tuple[Block, ...], credit: Mapping[str, tuple[tuple[str, str], ...]]
) -> tuple[str, ...]:
    """Return why each block is there."""
    lines = []
    for block in chosen:
        pairs = [f"{a} from {b}" for a, b in credit.get(block.name, ())]
        helped = f" tells {_listed(pairs, 3)}" if pairs else " helps"
        lines.append(f"{block.name} ({block.duration_s:.0f} s){helped}: {block.shows}")
    return tuple(lines)


def _listed(items: Sequence[str], most: int) -> str:
    rest = len(items) - most
    return ", ".join(items[:most]) + (f" and {rest} more" if rest > 0 else "")


def separating_plan(
    names: Iterable[str],
    profile: ProfileData,
    motion: Motion | None = None,
    *,
    extra: Sequence[Cause] = (),
    duration_s: float = DEFAULT_DURATION_S,
    loads: bool = True,
) -> MotionPlan | None:
    """Return the run that tells names apart from each other.

    Parameters
    ----------
    names : iterable of str
        Names of the catalogue, at least two.
    profile : ProfileData
        Bench.
    motion : Motion or None
        Motion of the run at hand.
    extra : sequence of Cause
        Causes beside the catalogue.
    duration_s : float
        Budget of sampled time, s.
    loads : bool
        Whether an operator can put loads on.

    Returns
    -------
    MotionPlan or None
        None where no run of this bench tells any of them apart.

    Raises
    ------
    DataError
        If a name is unknown.
    """
    known = tuple(dict.fromkeys(names))
    effects = effects_named(known, extra=extra)
    pairs = tuple((a, b) for a in known for b in known if a != b)
    found = propose(effects, pairs, profile, motion=motion, duration_s=duration_s, loads=loads)
    return found.plan if any(pair.separated for pair in found.pairs) else None


def plan_for_result(
    result: Mapping[str, Any],
    profile: ProfileData,
    *,
    motion: Motion | None = None,
    extra: Sequence[Cause] = (),
    duration_s: float = DEFAULT_DURATION_S,
    loads: bool = True,
) -> Proposal | None:
    """Return the run that settles what a diagnosis leaves open.

    Parameters
    ----------
    result : mapping
        A diagnosis result (``hdbench/diagnosis/1``).
    profile : ProfileData
        Bench.
    motion : Motion or None
        Motion of the diagnosed record.
    extra : sequence of Cause
        Causes beside the catalogue.
    duration_s : float
        Budget of sampled time, s.
    loads : bool
        Whether an operator can put loads on.

    Returns
    -------
    Proposal or None
        None where every cause has one name.
    """
    effects, pairs = effects_of_result(result, extra=extra)
    if not pairs:
        return None
    return propose(effects, pairs, profile, motion=motion, duration_s=duration_s, loads=loads)
