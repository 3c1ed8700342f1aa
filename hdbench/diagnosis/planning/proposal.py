"""The run that tells names apart: blocks chosen by evidence per second, verified, in words."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hdbench.diagnosis.planning.blocks import Block, blocks, joined
from hdbench.diagnosis.planning.confusability import (
    CONFUSABLE,
    HELD,
    Confusability,
    Grams,
    compare,
)
from hdbench.diagnosis.planning.frame import Noise, make_frame
from hdbench.diagnosis.planning.motion import planned_motion
from hdbench.diagnosis.planning.segments import MotionPlan, Segment
from hdbench.diagnosis.planning.signatures import Effect, fitted_shape, nominal_shape
from hdbench.model import (
    Cause,
    Motion,
    catalogue,
    cause_named,
)
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray

__all__ = [
    "DEFAULT_DURATION_S",
    "Pair",
    "Proposal",
    "effects_named",
    "effects_of_result",
    "plan_for_result",
    "propose",
    "settled_by",
]

Names = tuple[str, str]
Told = Callable[[str, float], None]

# the full protocol of the built-in profile without loads takes 172 s
DEFAULT_DURATION_S = 180.0
# rows on which blocks are weighed; what is chosen is then computed in full
_ROWS = 6_000
# a name is wrong with 1 % where evidence of 10.8 nats is expected, d sin(gamma) = 4.65; four times
# that leaves room for an effect of half the size that is reckoned with
_ENOUGH_NATS = 4.0 * 10.8
# beyond noise, names are confused by what their shapes lack; twice the level of what counts as
# confusable leaves room for that
_ENOUGH_SHARE = 2.0 * CONFUSABLE
# size of an effect of which nothing is known, in standard deviations over all blocks together
_UNKNOWN_SIGMAS = 20.0
# time that a budget leaves beside the long run, for what shows other things
_BESIDE_LONG_S = 30.0
# a block, or a longer protocol, that raises the score of a pair by less than this does not pay
_LEAST_GAIN = 0.02


@dataclass(frozen=True, slots=True)
class Pair:
    """An ordered pair of names: shall the first be told from the second.

    `before` and `after` are the share of the first that the second cannot imitate, on the given
    motion and on the proposed one; None where either cannot be seen there.
    """

    first: str
    second: str
    before: float | None
    after: float | None

    @property
    def separated(self) -> bool:
        """Whether the proposed run tells the first from the second."""
        return self.after is not None and self.after >= CONFUSABLE


@dataclass(frozen=True, slots=True)
class Proposal:
    """A run, and what it is good for.

    Parameters
    ----------
    plan : MotionPlan or None
        The run; None where no run of this bench tells any of the pairs apart.
    chosen : tuple of Block
        Blocks of which it is made.
    pairs : tuple of Pair
        Pairs in question.
    words : tuple of str
        Why, one sentence for each block.
    after : Confusability or None
        How alike the effects are on the run.
    """

    plan: MotionPlan | None
    chosen: tuple[Block, ...]
    pairs: tuple[Pair, ...]
    words: tuple[str, ...]
    after: Confusability | None = None


@dataclass(frozen=True, slots=True)
class _Question:
    """Pairs of effects to be told apart on a bench."""

    effects: tuple[Effect, ...]
    pairs: tuple[Names, ...]
    profile: ProfileData
    noise: Noise | None
    duration_s: float
    told: Told

    def on(self, chosen: tuple[Block, ...]) -> Confusability | None:
        """Return how alike the effects are on blocks."""
        if not chosen:
            return None
        motion = planned_motion(joined("chosen", chosen), self.profile)
        return compare(motion, self.effects, self.profile, noise=self.noise)

    def worth(self, found: Confusability | None) -> float:
        """Return the sum of the pairs' shares, each up to what counts as told apart."""
        shares = [] if found is None else [found.share(*pair) for pair in self.pairs]
        return sum(min(share, CONFUSABLE) for share in shares if share is not None)

    def open(self, found: Confusability | None) -> tuple[Names, ...]:
        """Return the pairs that are not told apart."""
        if found is None:
            return self.pairs
        return tuple(pair for pair in self.pairs if not (found.share(*pair) or 0.0) >= CONFUSABLE)


@dataclass(frozen=True, slots=True)
class _Weights:
    """Products of all effects in each block that is offered, and how large each is taken to be."""

    grams: Grams
    pairs: tuple[Names, ...]
    sigmas: dict[str, float]

    def score(self, chosen: Sequence[int]) -> dict[Names, float]:
        """Return how well blocks tell each pair apart, 0 to 2: by evidence and by share."""
        found = self._on(chosen, self.pairs)
        missing = [pair for pair in self.pairs if pair not in found]
        # what the baseline holds is compared beside the zero alone
        if missing and any(sigma == 0.0 for sigma in self.sigmas.values()):
            found |= self._on(chosen, missing, held=True)
        return {
            pair: min(1.0, nats / _ENOUGH_NATS) + min(1.0, left / _ENOUGH_SHARE)
            for pair, (left, nats) in found.items()
        }

    def _on(
        self, chosen: Sequence[int], pairs: Sequence[Names], *, held: bool = False
    ) -> dict[Names, tuple[float, float]]:
        """Return share and evidence in nats of the pairs that can be compared."""
        beside = self.grams.beside(chosen, zero_only=held)
        seen: dict[str, tuple[float, int]] = {}
        for column, target in enumerate(self.grams.targets):
            name = target.effect.name
            if held and self.sigmas[name] != 0.0:
                continue
            if self.grams.look(target, beside).visible:
                energy = float(np.trace(beside.left[target.rows, target.rows]))
                # of the times of a step the one that shows most
                seen[name] = max(seen.get(name, (0.0, column)), (energy, column))
        found = {}
        for second in {b for _, b in pairs} & set(seen):
            least: FloatArray = self.grams.families[second].left(self.grams, beside).min(axis=0)
            for first in (a for a, b in pairs if b == second and a in seen):
                energy, column = seen[first]
                left = float(least[column])
                found[first, second] = (left, 0.5 * energy * self.sigmas[first] * left)
        return found


def _weights(question: _Question, offered: tuple[Block, ...]) -> _Weights:
    """Return one motion of all blocks with everything that weighs parts of it."""
    profile = question.profile
    period = profile.daq.sample_period_s
    counts = [
        sum(max(1, round(s.duration_s / period)) for s in block.steps if isinstance(s, Segment))
        for block in offered
    ]
    edges = np.concatenate([[0], np.cumsum(counts)])
    motion = planned_motion(joined("all blocks", offered), profile)
    frame = make_frame(motion, profile, question.noise, n_rows=_ROWS, edges=edges.tolist())
    grams = Grams.of(frame, question.effects, lambda _what, _share: None)
    beside = grams.beside(range(len(offered)))
    sigmas: dict[str, float] = {}
    for target in grams.targets:
        entry, effect = grams.look(target, beside), target.effect
        # no evidence is counted for what the baseline holds: its share alone is weighed
        sigma = 0.0 if entry.reason == HELD else 1.0
        if entry.visible and entry.std_nm:
            known = effect.amplitude_nm
            size = _UNKNOWN_SIGMAS if known is None else known / entry.std_nm
            sigma = size**2 / float(np.trace(beside.left[target.rows, target.rows]))
        sigmas[effect.name] = max(sigma, sigmas.get(effect.name, 0.0))
    return _Weights(grams, question.pairs, sigmas)


def _choose(
    question: _Question, loads: bool
) -> tuple[tuple[Block, ...], dict[str, tuple[Names, ...]]]:
    """Return blocks that tell pairs apart, and the pairs that each did most for.

    The block that adds most per second is taken until none adds anything or the budget is spent. A
    pair counts up to its expected evidence, half the squared size times its share, of 43 nats (a
    wrong name in 1 of 100 for an effect of half the size) and up to a share of 0.5.
    """
    pairs, budget = question.pairs, question.duration_s
    long_s = min(budget, question.profile.limits.duration_s) - _BESIDE_LONG_S
    every = blocks(question.profile, long_s=long_s)
    offered = tuple(b for b in every if loads or not b.needs_operator)
    question.told("signatures in every block", 0.0)
    weights = _weights(question, offered)
    chosen: list[int] = []
    rises: dict[str, dict[Names, float]] = {}
    reached: dict[Names, float] = {}
    spent, least = 0.0, _LEAST_GAIN * len(pairs)
    for turn in range(len(offered)):
        best: tuple[float, int, dict[Names, float]] | None = None
        for index, block in enumerate(offered):
            question.told(f"weighing {block.name}", (turn + index / len(offered)) / len(offered))
            if index in chosen or not spent + block.duration_s <= budget:
                continue
            score = weights.score([*chosen, index])
            gain = sum(score.values()) - sum(reached.values())
            rate = gain / block.duration_s
            if gain >= least and (best is None or rate > best[0]):
                best = (rate, index, score)
        if best is None:
            break
        _, index, score = best
        rises[offered[index].name] = {p: score[p] - reached.get(p, 0.0) for p in score}
        chosen.append(index)
        reached = score
        spent += offered[index].duration_s
        if all(reached.get(pair, 0.0) >= 2.0 - _LEAST_GAIN for pair in pairs):
            break
    # those that later ones have made needless go again
    whole = sum(weights.score(chosen).values()) if chosen else 0.0
    for index in chosen[:-1]:
        rest = [other for other in chosen if other != index]
        if sum(weights.score(rest).values()) > whole - least:
            chosen = rest
    kept = tuple(offered[index] for index in chosen)
    credit: dict[str, tuple[Names, ...]] = {block.name: () for block in kept}
    for pair in pairs:
        name = max(credit, key=lambda n: rises[n].get(pair, 0.0), default="")
        if name and rises[name].get(pair, 0.0) >= _LEAST_GAIN:
            credit[name] = (*credit[name], pair)
    return kept, credit


def _chosen(
    question: _Question, loads: bool
) -> tuple[tuple[Block, ...], dict[str, tuple[Names, ...]], Confusability | None]:
    """Return blocks within the budget, with loads or without, credit, and what they do."""
    chosen, credit = _choose(question, loads)
    after = question.on(chosen)
    if not question.open(after):
        return chosen, credit, after
    # blocks that help only together are found by none of them alone: all that fit the budget
    whole: tuple[Block, ...] = ()
    for block in blocks(question.profile, long_s=0.0):
        spent = sum(b.duration_s for b in whole)
        if (loads or not block.needs_operator) and spent + block.duration_s <= question.duration_s:
            whole = (*whole, block)
    then = question.on(whole)
    if question.worth(then) > question.worth(after) + _LEAST_GAIN:
        return whole, {}, then
    return chosen, credit, after


def propose(
    effects: Sequence[Effect],
    pairs: Sequence[Names],
    profile: ProfileData,
    *,
    at_hand: Motion | Confusability | None = None,
    duration_s: float = DEFAULT_DURATION_S,
    loads: bool = True,
    noise: Noise | None = None,
    progress: Told | None = None,
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
    at_hand : Motion, Confusability or None
        Motion of the run at hand, or how alike the effects are there.
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
    told = progress or (lambda _what, _share: None)
    if isinstance(at_hand, Motion):
        at_hand = compare(at_hand, effects, profile, noise=noise)
    question = _Question(tuple(effects), tuple(pairs), profile, noise, duration_s, told)
    chosen, credit, after = _chosen(question, loads=False)
    open_pairs = question.open(after)
    if open_pairs and loads:
        asked = {name for pair in open_pairs for name in pair}
        loaded = _feeling_loads([e.cause for e in effects if e.name in asked], profile)
        open_pairs = tuple(pair for pair in open_pairs if loaded & set(pair))
    if open_pairs and loads:
        rest = replace(question, pairs=open_pairs)
        more, attended, now = _chosen(rest, loads=True)
        if rest.worth(now) > rest.worth(after) + _LEAST_GAIN:
            chosen = tuple({block.name: block for block in (*chosen, *more)}.values())
            credit = {**attended, **credit}
            after = question.on(chosen)
    before = at_hand.share if at_hand else _unknown
    then = after.share if after else _unknown
    result = tuple(Pair(a, b, before(a, b), then(a, b)) for a, b in pairs)
    if not chosen:
        return Proposal(None, (), result, ())
    separated = [f"{p.first} from {p.second}" for p in result if p.separated]
    purpose = "tells " + _listed(separated, 4) if separated else "the best that this bench can do"
    words = []
    for block in chosen:
        told_apart = [f"{a} from {b}" for a, b in credit.get(block.name, ())]
        helped = f" tells {_listed(told_apart, 3)}" if told_apart else " helps"
        words.append(f"{block.name} ({block.duration_s:.0f} s){helped}: {block.shows}")
    plan = joined("separating", chosen, purpose)
    return Proposal(plan, chosen, result, tuple(words), after)


def _unknown(_first: str, _second: str) -> None:
    return None


def _feeling_loads(causes: Sequence[Cause], profile: ProfileData) -> set[str]:
    """Return the causes whose effect a load on the output changes."""
    attended = tuple(b for b in blocks(profile, long_s=0.0) if b.needs_operator)
    loaded = planned_motion(joined("loads", attended), profile)
    none = np.zeros(len(loaded))
    frames = [
        make_frame(motion, profile)
        for motion in (loaded, replace(loaded, load_torque_nm=none, load_smooth_nm=none))
    ]
    found = set()
    for cause in causes:
        if cause.additive and cause.applicable(loaded) is None:
            shape = fitted_shape(nominal_shape(cause), frames[0].bounds(cause), loaded.time_s)
            if shape is not None:
                one, other = (frame.drawn(cause, shape) for frame in frames)
                found |= {cause.name} if one.shape != other.shape or np.any(one != other) else set()
    return found


def _listed(items: Sequence[str], most: int) -> str:
    rest = len(items) - most
    return ", ".join(items[:most]) + (f" and {rest} more" if rest > 0 else "")


def effects_named(names: Iterable[str], *, extra: Sequence[Cause] = ()) -> tuple[Effect, ...]:
    """Return effects of the catalogue, or of `extra`, by name with nominal shapes, each once.

    Parameters
    ----------
    names : iterable of str
        Names of causes.
    extra : sequence of Cause
        Causes beside the catalogue.

    Returns
    -------
    tuple of Effect
    """
    causes = [cause_named(name, where="cause", extra=extra) for name in dict.fromkeys(names)]
    return tuple(Effect(cause, nominal_shape(cause)) for cause in causes)


def effects_of_result(
    result: Mapping[str, Any], *, extra: Sequence[Cause] = ()
) -> tuple[tuple[Effect, ...], tuple[Names, ...]]:
    """Return what a diagnosis result leaves open: effects with the shapes found, and pairs.

    The pairs are both orders of each cause's name with every other name of its group and rivals.
    """
    known = catalogue(extra)
    effects: dict[str, Effect] = {}
    pairs: dict[Names, None] = {}
    for entry in result.get("causes", ()):
        names = [str(name) for name in (entry["name"], *entry["group"], *entry["rivals"])]
        names = [name for name in dict.fromkeys(names) if name in known]
        if len(names) < 2:
            continue
        for name in names:
            effects.setdefault(name, _found_effect(known[name], entry["parameters"]))
        for other in names[1:]:
            pairs |= {(names[0], other): None, (other, names[0]): None}
    return tuple(effects.values()), tuple(pairs)


def _found_effect(cause: Cause, parameters: Mapping[str, Any]) -> Effect:
    """Return a cause with the shapes and the amplitude that a diagnosis found."""
    shape = nominal_shape(cause)
    for parameter in cause.shape:
        value = parameters.get(parameter.name, {}).get("value")
        if isinstance(value, int | float) and parameter.contains(float(value)):
            shape[parameter.name] = float(value)
    amplitude = parameters.get("amplitude_nm", {}).get("value")
    return Effect(cause, shape, float(amplitude) if isinstance(amplitude, int | float) else None)


def settled_by(first: Cause, second: Cause) -> str:
    """Return what settles a pair that torque and angle cannot tell apart, in words.

    The channel that decides where they arise in different ones, else the catalogue's experiment.

    Parameters
    ----------
    first, second : Cause
        The pair.

    Returns
    -------
    str
    """
    kinds = {first.channel, second.channel}
    told = {cause.channel: cause.name for cause in (first, second)}
    if len(kinds) == 2 and "mechanical" in kinds:
        return (
            f"motor_current_a: {told['mechanical']} needs motor torque and shows in the current, "
            f"{told[(kinds - {'mechanical'}).pop()]} does not; or {first.experiment}"
        )
    if len(kinds) == 2 and "kinematic" in kinds:
        other = told[(kinds - {"kinematic"}).pop()]
        return f"output_angle_rad: {told['kinematic']} shows in the angles, {other} does not"
    return first.experiment


def plan_for_result(
    result: Mapping[str, Any],
    profile: ProfileData,
    *,
    motion: Motion | None = None,
    extra: Sequence[Cause] = (),
    duration_s: float = DEFAULT_DURATION_S,
    loads: bool = True,
) -> Proposal | None:
    """Return the run that settles what a diagnosis leaves open; None where nothing is.

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
        Longest run, s.
    loads : bool
        Whether the run may hold loads.

    Returns
    -------
    Proposal or None
    """
    effects, pairs = effects_of_result(result, extra=extra)
    if not pairs:
        return None
    return propose(effects, pairs, profile, at_hand=motion, duration_s=duration_s, loads=loads)
