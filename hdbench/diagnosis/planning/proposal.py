"""Proposed run: blocks chosen by evidence per second, verified, in words."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hdbench.diagnosis.evidence import Told, silent
from hdbench.diagnosis.planning.blocks import blocks, joined
from hdbench.diagnosis.planning.confusability import (
    CONFUSABLE,
    HELD,
    Confusability,
    Grams,
    compare,
    unfit,
)
from hdbench.diagnosis.planning.frame import Noise, make_frame
from hdbench.diagnosis.planning.segments import MotionPlan, plan_stages, planned_motion, program_of
from hdbench.diagnosis.planning.signatures import Effect, fitted_shape, nominal_shape
from hdbench.model import Cause, Motion, catalogue, cause_named
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray
from hdbench.results.diagnosis import NamedCause, ParameterValue

Names = tuple[str, str]
# pairs that each block did most for
_Credit = Mapping[str, list[Names]]

# the full protocol of the built-in profile without loads takes 172 s
DEFAULT_DURATION_S = 180.0
# a block, or a longer protocol, that raises the score of a pair by less than this does not pay
_LEAST_GAIN = 0.02


@dataclass(frozen=True, slots=True)
class Pair:
    """An ordered pair of names: shall the first be told from the second."""

    first: str
    second: str
    before: float | None  # share that the second cannot imitate on the given motion, if seen
    after: float | None  # on the proposed one

    @property
    def separated(self) -> bool:
        """Whether the proposed run tells the first from the second."""
        return self.after is not None and self.after >= CONFUSABLE


@dataclass(frozen=True, slots=True)
class Proposal:
    """The run that tells names apart."""

    plan: MotionPlan | None  # None where no run of this bench tells any of the pairs apart
    pairs: tuple[Pair, ...]  # in question
    words: tuple[str, ...] = ()  # why, one sentence for each block
    after: Confusability | None = None  # how alike the effects are on the run


@dataclass(frozen=True, slots=True)
class _Choice:
    """Blocks, how alike the effects are on them, and the pairs that each block did most for."""

    chosen: tuple[MotionPlan, ...] = ()
    after: Confusability | None = None
    credit: _Credit = field(default_factory=dict)

    def share(self, pair: Names) -> float | None:
        """Return the share of the first that the second cannot imitate."""
        return None if self.after is None else self.after.share(*pair)

    def open(self, pairs: Sequence[Names]) -> tuple[Names, ...]:
        """Return the pairs that are not told apart."""
        return tuple(pair for pair in pairs if not (self.share(pair) or 0.0) >= CONFUSABLE)

    def better(self, other: _Choice, pairs: Sequence[Names]) -> bool:
        """Return whether it tells more apart: shares count up to what is told apart."""
        one, two = (
            sum(min(choice.share(pair) or 0.0, CONFUSABLE) for pair in pairs)
            for choice in (self, other)
        )
        return one > two + _LEAST_GAIN


@dataclass(frozen=True, slots=True)
class _Question:
    """Pairs of effects to be told apart on a bench."""

    effects: tuple[Effect, ...]
    pairs: tuple[Names, ...]
    profile: ProfileData
    noise: Noise | None
    duration_s: float
    told: Told

    def tried(self, chosen: Sequence[MotionPlan], credit: _Credit | None = None) -> _Choice:
        """Return how alike the effects are on blocks."""
        if not chosen:
            return _Choice()
        motion = planned_motion(joined("chosen", chosen), self.profile)
        after = compare(motion, self.effects, self.profile, noise=self.noise)
        return _Choice(tuple(chosen), after, credit or {})

    def answer(self, *, loads: bool) -> _Choice:
        """Return blocks within the budget, with loads or without."""
        choice = self._greedy(loads)
        if choice.open(self.pairs):
            # blocks that help only together are found by none of them alone: all that fit
            whole: list[MotionPlan] = []
            for block in blocks(self.profile, long_s=0.0):
                fits = _seconds([*whole, block]) <= self.duration_s
                if fits and (loads or not block.needs_operator):
                    whole.append(block)
            together = self.tried(whole)
            if together.better(choice, self.pairs):
                return together
        return choice

    def _greedy(self, loads: bool) -> _Choice:
        """Return blocks: what adds most per second is taken until nothing adds or fits any more."""
        # beside the long run half a minute is left for what shows other things
        longest_s = min(self.duration_s, self.profile.limits.duration_s)
        every = blocks(self.profile, long_s=longest_s - 30.0)
        offered = [block for block in every if loads or not block.needs_operator]
        self.told("signatures in every block", 0.0)
        weights = _Weights(self, offered)
        least = _LEAST_GAIN * len(self.pairs)
        chosen: list[int] = []
        rises: dict[int, FloatArray] = {}
        reached = np.zeros(len(self.pairs))
        while reached.min(initial=2.0) < 2.0 - _LEAST_GAIN:
            rises_now: dict[int, FloatArray] = {}
            for index, block in enumerate(offered):
                done = (len(chosen) + index / len(offered)) / len(offered)
                self.told(f"weighing {block.name}", done)
                fits = _seconds(offered[k] for k in (*chosen, index)) <= self.duration_s
                if index not in chosen and fits:
                    rise = weights.score([*chosen, index]) - reached
                    if rise.sum() >= least:
                        rises_now[index] = rise
            if not rises_now:
                break
            best = max(rises_now, key=lambda k: float(rises_now[k].sum()) / offered[k].duration_s)
            rises[best] = rises_now[best]
            chosen.append(best)
            reached = reached + rises[best]
        # those that later ones have made needless go again
        for index in chosen[:-1]:
            rest = [other for other in chosen if other != index]
            if weights.score(rest).sum() > reached.sum() - least:
                chosen = rest
        credit: dict[str, list[Names]] = {}
        for number, pair in enumerate(self.pairs):
            most = max(chosen, key=lambda k: float(rises[k][number]), default=None)
            if most is not None and rises[most][number] >= _LEAST_GAIN:
                credit.setdefault(offered[most].name, []).append(pair)
        return self.tried([offered[index] for index in chosen], credit)


def _seconds(chosen: Iterable[MotionPlan]) -> float:
    return sum(block.duration_s for block in chosen)


class _Weights:
    """Products of all effects in each block that is offered, and how large each is taken to be."""

    def __init__(self, question: _Question, offered: Sequence[MotionPlan]) -> None:
        profile = question.profile
        counts = [
            sum(program_of(stage, profile).n_samples for stage in plan_stages(block))
            for block in offered
        ]
        motion = planned_motion(joined("all blocks", offered), profile)
        edges = [0, *np.cumsum(counts).tolist()]
        # enough rows to weigh blocks; what is chosen is then computed in full
        frame = make_frame(motion, profile, question.noise, n_rows=6_000, edges=edges)
        self.pairs = question.pairs
        self.grams = Grams.of(frame, question.effects, silent)
        beside = self.grams.beside(range(len(offered)))
        self.sigmas: dict[str, float] = {}
        for target in self.grams.targets:
            entry, effect = beside.look(target), target.effect
            # no evidence is counted for what the baseline holds: its share alone is weighed
            sigma = 0.0 if entry.reason == HELD else 1.0
            if not entry.reason and entry.std_nm:
                known = effect.amplitude_nm
                # an effect of which nothing is known is taken to be 20 deviations over all blocks
                size = 20.0 if known is None else known / entry.std_nm
                sigma = size**2 / beside.energy(target)
            self.sigmas[effect.name] = max(sigma, self.sigmas.get(effect.name, 0.0))

    def score(self, chosen: Sequence[int]) -> FloatArray:
        """Return how well blocks tell each pair apart, 0 to 2: by evidence and by share."""
        # a pair counts up to evidence of 43.2 nats: a name is wrong with 1 % at 10.8 nats, that is
        # d sin(gamma) = 4.65, four times that leave room for an effect of half the size; and up
        # to twice the share that is told apart, for what the shapes of names lack
        scores: dict[Names, float] = {}
        # what the baseline holds is compared beside the zero alone
        for held in (False, True):
            beside = self.grams.beside(chosen, zero_only=held)
            seen: dict[str, tuple[float, int]] = {}
            for column, target in enumerate(self.grams.targets):
                name = target.effect.name
                if not (held and self.sigmas[name]) and not beside.look(target).reason:
                    # of the times of a step the one that shows most
                    seen[name] = max(seen.get(name, (0.0, column)), (beside.energy(target), column))
            asked = [pair for pair in self.pairs if pair not in scores and set(pair) <= set(seen)]
            for second in {second for _, second in asked}:
                least = beside.shares(self.grams.families[second]).min(axis=0)
                for first in (a for a, b in asked if b == second):
                    energy, column = seen[first]
                    share = float(least[column])
                    nats = 0.5 * energy * self.sigmas[first] * share
                    by_share = min(1.0, share / (2.0 * CONFUSABLE))
                    scores[first, second] = min(1.0, nats / 43.2) + by_share
        return np.array([scores.get(pair, 0.0) for pair in self.pairs])


def propose(
    effects: Sequence[Effect],
    pairs: Sequence[Names],
    profile: ProfileData,
    *,
    at_hand: Motion | Confusability | None = None,
    duration_s: float = DEFAULT_DURATION_S,
    loads: bool = True,
    noise: Noise | None = None,
    progress: Told = silent,
) -> Proposal:
    """Propose the run of a length that tells pairs of names apart, and say how well it does."""
    if isinstance(at_hand, Motion):
        at_hand = compare(at_hand, effects, profile, noise=noise)
    question = _Question(tuple(effects), tuple(pairs), profile, noise, duration_s, progress)
    choice = question.answer(loads=False)
    # loads are asked for only where motion alone does not do
    open_pairs = choice.open(pairs) if loads else ()
    if open_pairs:
        asked = {name for pair in open_pairs for name in pair}
        loaded = _feeling_loads([e.cause for e in effects if e.name in asked], profile)
        open_pairs = tuple(pair for pair in open_pairs if loaded & set(pair))
    if open_pairs:
        more = replace(question, pairs=open_pairs).answer(loads=True)
        if more.better(choice, open_pairs):
            both = {block.name: block for block in (*choice.chosen, *more.chosen)}
            choice = question.tried(list(both.values()), {**more.credit, **choice.credit})
    before = _Choice(after=at_hand)
    told = tuple(Pair(*pair, before.share(pair), choice.share(pair)) for pair in pairs)
    if not choice.chosen:
        return Proposal(None, told)
    separated = [f"{pair.first} from {pair.second}" for pair in told if pair.separated]
    purpose = "tells " + _listed(separated, 4) if separated else "the best that this bench can do"
    words = []
    for block in choice.chosen:
        apart = [f"{a} from {b}" for a, b in choice.credit.get(block.name, ())]
        helped = f" tells {_listed(apart, 3)}" if apart else " helps"
        words.append(f"{block.name} ({block.duration_s:.0f} s){helped}: {block.purpose}")
    plan = joined("separating", choice.chosen, purpose)
    return Proposal(plan, told, tuple(words), choice.after)


def _feeling_loads(causes: Sequence[Cause], profile: ProfileData) -> set[str]:
    """Return the causes whose effect a load on the output changes."""
    attended = [block for block in blocks(profile, long_s=0.0) if block.needs_operator]
    loaded = planned_motion(joined("loads", attended), profile)
    none = np.zeros(len(loaded))
    with_load, without = (
        make_frame(motion, profile)
        for motion in (loaded, replace(loaded, load_torque_nm=none, load_smooth_nm=none))
    )
    feeling = set()
    for cause in causes:
        if not unfit(cause, with_load):
            bounds = with_load.bounds(cause)
            shape = fitted_shape(nominal_shape(cause), bounds, loaded.time_s)
            one, other = with_load.drawn(cause, shape), without.drawn(cause, shape)
            if not np.array_equal(one, other):
                feeling.add(cause.name)
    return feeling


def _listed(items: Sequence[str], most: int) -> str:
    rest = len(items) - most
    return ", ".join(items[:most]) + (f" and {rest} more" if rest > 0 else "")


def effects_named(names: Iterable[str]) -> tuple[Effect, ...]:
    """Return effects of the catalogue by name with nominal shapes, each once."""
    causes = [cause_named(name, where="cause") for name in dict.fromkeys(names)]
    return tuple(Effect(cause, nominal_shape(cause)) for cause in causes)


def effects_of_causes(
    causes: Sequence[NamedCause], *, extra: Sequence[Cause] = ()
) -> tuple[tuple[Effect, ...], tuple[Names, ...]]:
    """Return what a diagnosis leaves open: effects with the shapes found, and pairs both ways."""
    known = catalogue(extra)
    effects: dict[str, Effect] = {}
    pairs: dict[Names, None] = {}
    for cause in causes:
        alike = dict.fromkeys((cause.name, *cause.group, *cause.rivals))
        names = [name for name in alike if name in known]
        if len(names) < 2:
            continue
        for name in names:
            effects.setdefault(name, _found_effect(known[name], cause.parameters))
        for other in names[1:]:
            pairs |= {(names[0], other): None, (other, names[0]): None}
    return tuple(effects.values()), tuple(pairs)


def _found_effect(cause: Cause, parameters: Mapping[str, ParameterValue]) -> Effect:
    """Return a cause with the shapes and the amplitude that a diagnosis found."""
    shape = nominal_shape(cause)
    for parameter in cause.shape:
        found = parameters.get(parameter.name)
        if found is not None and parameter.contains(found.value):
            shape[parameter.name] = found.value
    amplitude = parameters.get("amplitude_nm")
    return Effect(cause, shape, None if amplitude is None else amplitude.value)


def settled_by(first: Cause, second: Cause) -> str:
    """Return what settles a pair that torque and angle cannot tell apart, in words."""
    ranks = {"mechanical": 0, "kinematic": 1}
    one, other = sorted((first, second), key=lambda cause: ranks.get(cause.channel, 2))
    if one.channel == "mechanical" != other.channel:
        return (
            f"motor_current_a: {one.name} needs motor torque and shows in the current, "
            f"{other.name} does not; or {first.experiment}"
        )
    if one.channel == "kinematic" != other.channel:
        return f"output_angle_rad: {one.name} shows in the angles, {other.name} does not"
    return first.experiment


def plan_for_causes(
    causes: Sequence[NamedCause],
    profile: ProfileData,
    *,
    motion: Motion | None = None,
    extra: Sequence[Cause] = (),
) -> Proposal | None:
    """Return the run that settles what a diagnosis leaves open; None where nothing is."""
    effects, pairs = effects_of_causes(causes, extra=extra)
    return propose(effects, pairs, profile, at_hand=motion) if pairs else None
