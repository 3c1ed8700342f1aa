"""Which stretches of motion tell names apart: chosen one after the other by evidence per second."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.planning.blockparts import Block
from hdbench.diagnosis.planning.candidates import blocks, joined
from hdbench.diagnosis.planning.confusability import CONFUSABLE
from hdbench.diagnosis.planning.lines import LineSpectra
from hdbench.diagnosis.planning.motion import planned_motion
from hdbench.diagnosis.planning.segments import MotionPlan, Segment
from hdbench.diagnosis.planning.signatures import Effect
from hdbench.diagnosis.planning.sketch import Noise, Sketch, make_sketch, part_of
from hdbench.diagnosis.planning.visibility import HELD, line_tops, look_at, with_simulated
from hdbench.model import BenchModel
from hdbench.profile.schema import ProfileData

__all__ = ["Pair", "Proposal", "choose_blocks"]

# rows of the sketch on which blocks are weighed; what is chosen is then computed in full
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
# a block that raises the score of a pair by less than this does not pay
_LEAST_GAIN = 0.02


@dataclass(frozen=True, slots=True)
class Pair:
    """An ordered pair of names: shall `first` be told from `second`.

    Parameters
    ----------
    first, second : str
        Names.
    before, after : float or None
        Share of `first` that `second` cannot imitate, on the given motion and on the proposed one;
        None where either cannot be seen there.
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
    """

    plan: MotionPlan | None
    chosen: tuple[Block, ...]
    pairs: tuple[Pair, ...]
    words: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Bench:
    """Everything from which the worth of blocks is computed."""

    effects: tuple[Effect, ...]
    pairs: tuple[tuple[str, str], ...]
    sketch: Sketch
    plain: Sketch
    owner: NDArray[np.intp]
    sigmas: dict[str, float]

    def shares(self, chosen: Sequence[int]) -> dict[tuple[str, str], tuple[float, float]]:
        """Return sin^2 and evidence in nats of every pair on some of the blocks."""
        kept = np.isin(self.owner, np.asarray(chosen, dtype=np.intp))
        found = self._on(part_of(self.sketch, kept), self.pairs)
        missing = tuple(pair for pair in self.pairs if pair not in found)
        if missing:
            found |= self._on(part_of(self.plain, kept), missing, held_only=True)
        return found

    def _on(
        self, sketch: Sketch, pairs: tuple[tuple[str, str], ...], *, held_only: bool = False
    ) -> dict[tuple[str, str], tuple[float, float]]:
        """Return the pairs that a sketch can compare."""
        spectra = LineSpectra(sketch, line_tops(self.effects, sketch.motion))
        seen = {}
        for effect in self.effects:
            if held_only and self.sigmas.get(effect.name) != 0.0:
                continue
            _, looked = look_at(effect, sketch, spectra, len(self.effects))
            if looked is not None:
                seen[effect.name] = looked
        found = {}
        for second in {b for _, b in pairs} & set(seen):
            firsts = [a for a, b in pairs if b == second and a in seen]
            targets = tuple(seen[a][0] for a in firsts)
            start = seen[second][0].effect.shape
            # what remembers costs too much between the points of its grid, for a first choice
            imitator = replace(seen[second][1], refine=not seen[second][1].remembers)
            for name, (left, _) in zip(firsts, imitator.shares_left(targets, start), strict=True):
                target = seen[name][0]
                squared = target.energy * target.share * self.sigmas.get(name, 0.0)
                found[name, second] = (left, 0.5 * squared * left)
        return found


def _score(found: dict[tuple[str, str], tuple[float, float]]) -> dict[tuple[str, str], float]:
    """Return how well each pair is told apart, 0 to 2: by evidence and by share."""
    return {
        pair: min(1.0, nats / _ENOUGH_NATS) + min(1.0, left / _ENOUGH_SHARE)
        for pair, (left, nats) in found.items()
    }


def choose_blocks(
    effects: Sequence[Effect],
    pairs: Sequence[tuple[str, str]],
    profile: ProfileData,
    *,
    duration_s: float,
    loads: bool,
    noise: Noise | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> tuple[tuple[Block, ...], dict[str, tuple[tuple[str, str], ...]]]:
    r"""Choose blocks that tell pairs of names apart.

    Parameters
    ----------
    effects : sequence of Effect
        Effects with their shapes.
    pairs : sequence of (str, str)
        Ordered pairs of their names.
    profile : ProfileData
        Bench.
    duration_s : float
        Budget of sampled time, s, above 0.
    loads : bool
        Whether an operator can put loads on.
    noise : Noise or None
        Noise; white with the profile's standard deviation where None.
    progress : callable or None
        Told what is going on and the share done.

    Returns
    -------
    chosen : tuple of Block
        In the order in which they were chosen; empty where none helps.
    credit : dict
        Name of each block to the pairs that it did most for.

    Notes
    -----
    The block that adds most per second is taken until none adds anything or the budget is spent. A
    pair counts up to its expected evidence :math:`D_{ij} = (d^2/2) \sin^2 \gamma_{ij}` of 43 nats
    (a wrong name in 1 of 100 for an effect of half the size) and up to a share of 0.5.
    """
    told = progress or (lambda _what, _share: None)
    long_s = min(duration_s, profile.limits.duration_s) - _BESIDE_LONG_S
    every = blocks(profile, long_s=long_s)
    offered = tuple(block for block in every if loads or not block.needs_operator)
    bench = _bench(tuple(effects), tuple(pairs), offered, profile, noise)
    chosen: list[int] = []
    rises: list[tuple[str, dict[tuple[str, str], float]]] = []
    reached: dict[tuple[str, str], float] = {}
    spent = 0.0
    for turn in range(len(offered)):
        best: tuple[float, int, dict[tuple[str, str], float]] | None = None
        for index, block in enumerate(offered):
            told(f"weighing {block.name}", (turn + index / len(offered)) / len(offered))
            if index in chosen or not spent + block.duration_s <= duration_s:
                continue
            score = _score(bench.shares([*chosen, index]))
            gain = sum(score.values()) - sum(reached.values())
            rate = gain / block.duration_s
            if gain >= _LEAST_GAIN * len(pairs) and (best is None or rate > best[0]):
                best = (rate, index, score)
        if best is None:
            break
        _, index, score = best
        rises.append((offered[index].name, {p: score[p] - reached.get(p, 0.0) for p in score}))
        chosen.append(index)
        reached = score
        spent += offered[index].duration_s
        if all(reached.get(pair, 0.0) >= 2.0 - _LEAST_GAIN for pair in pairs):
            break
    kept = _pruned(bench, chosen, _LEAST_GAIN * len(pairs))
    return tuple(offered[index] for index in kept), _credit(
        rises, pairs, {offered[index].name for index in kept}
    )


def _pruned(bench: _Bench, chosen: Sequence[int], least: float) -> list[int]:
    """Return the blocks without those that later ones have made needless."""
    kept = list(chosen)
    whole = sum(_score(bench.shares(kept)).values()) if kept else 0.0
    for index in chosen[:-1]:
        rest = [other for other in kept if other != index]
        if sum(_score(bench.shares(rest)).values()) > whole - least:
            kept = rest
    return kept


def _credit(
    rises: Sequence[tuple[str, dict[tuple[str, str], float]]],
    pairs: Sequence[tuple[str, str]],
    names: set[str],
) -> dict[str, tuple[tuple[str, str], ...]]:
    """Return the pairs that each block told apart more than any other block did."""
    credit: dict[str, tuple[tuple[str, str], ...]] = dict.fromkeys(names, ())
    for pair in pairs:
        gains = [(rise.get(pair, 0.0), name) for name, rise in rises if name in names]
        most, name = max(gains, default=(0.0, ""), key=lambda entry: entry[0])
        if most >= _LEAST_GAIN:
            credit[name] = (*credit[name], pair)
    return credit


def _bench(
    effects: tuple[Effect, ...],
    pairs: tuple[tuple[str, str], ...],
    offered: tuple[Block, ...],
    profile: ProfileData,
    noise: Noise | None,
) -> _Bench:
    """Return one motion of all blocks with everything that weighs parts of it."""
    everything = joined("all blocks", offered)
    motion = with_simulated(planned_motion(everything, profile), BenchModel.from_profile(profile))
    white = noise or Noise.white(max(profile.sensor.noise_nm, np.finfo(float).tiny))
    sketch = make_sketch(motion, profile, white, n_rows=_ROWS)
    plain = make_sketch(motion, profile, white, n_rows=_ROWS, zero_only=True)
    owner = _owner(offered, profile)[sketch.rows]
    spectra = LineSpectra(sketch, line_tops(effects, motion))
    sigmas = {}
    for effect in effects:
        entry, looked = look_at(effect, sketch, spectra, len(effects))
        if looked is None:
            # no evidence is counted for what the baseline holds: its share alone is weighed
            sigmas[effect.name] = 0.0 if entry.reason == HELD else 1.0
            continue
        target = looked[0]
        whole = target.energy * target.share
        known = effect.amplitude_nm
        size = _UNKNOWN_SIGMAS
        if known is not None and entry.std_nm:
            size = known / entry.std_nm
        sigmas[effect.name] = size**2 / whole
    return _Bench(effects, pairs, sketch, plain, owner, sigmas)


def _owner(offered: tuple[Block, ...], profile: ProfileData) -> NDArray[np.intp]:
    """Return which block every sample of all blocks joined belongs to."""
    period = profile.daq.sample_period_s
    order = [i for i, b in enumerate(offered) if not b.needs_operator]
    order += [i for i, b in enumerate(offered) if b.needs_operator]
    pieces = []
    for index in order:
        for step in offered[index].steps:
            if isinstance(step, Segment):
                pieces.append(np.full(max(1, round(step.duration_s / period)), index))
    return np.concatenate(pieces)
