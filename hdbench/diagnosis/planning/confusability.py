"""Which effects a motion shows, how large they must be, and which of them look alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.planning.imitation import Imitator, Target
from hdbench.diagnosis.planning.lines import LineSpectra
from hdbench.diagnosis.planning.signatures import Effect
from hdbench.diagnosis.planning.sketch import SKETCH_ROWS, Noise, Sketch, make_sketch
from hdbench.diagnosis.planning.visibility import (
    HELD,
    SAME_SPACE,
    Visibility,
    line_tops,
    look_at,
    with_simulated,
)
from hdbench.model import BenchModel, Motion
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray

__all__ = ["CONFUSABLE", "Confusability", "compare"]

# the literature's line between what is told apart and what is not, by share of the effect
CONFUSABLE = 0.25
# one name contains another where this little of it is left: the rounding of projections
_CONTAINED = 1e-6


@dataclass(frozen=True, slots=True)
class Confusability:
    """How alike effects are on a motion.

    Parameters
    ----------
    names : tuple of str
        Effects that were compared, in the order of `sin2`.
    sin2 : ndarray, shape (n, n)
        Entry (i, j): share of effect i that effect j with any shape, and the baseline, cannot
        imitate; NaN where either cannot be seen and on the diagonal.
    visibility : tuple of Visibility
        One for each name.
    duration_s : float
        Length of the motion, s.
    """

    names: tuple[str, ...]
    sin2: FloatArray
    visibility: tuple[Visibility, ...]
    duration_s: float

    def share(self, first: str, second: str) -> float | None:
        """Return the share of the first that the second cannot imitate; None if not compared."""
        if first not in self.names or second not in self.names:
            return None
        value = float(self.sin2[self.names.index(first), self.names.index(second)])
        return value if np.isfinite(value) else None

    def contained(self) -> tuple[tuple[str, str], ...]:
        """Return pairs (i, j) where i is a special case of j: j imitates it, not the reverse."""
        return tuple(
            (a, b)
            for a, b, one, back in self._pairs()
            if one <= _CONTAINED and not back <= SAME_SPACE
        )

    def confusable(self, below: float = CONFUSABLE) -> tuple[tuple[str, str, float], ...]:
        """Return ordered pairs below a level, contained ones left out, nearest first."""
        inside = set(self.contained())
        found = [(a, b, s) for a, b, s, _ in self._pairs() if s < below and (a, b) not in inside]
        return tuple(sorted(found, key=lambda pair: pair[2]))

    def inseparable(self) -> tuple[tuple[str, ...], ...]:
        """Return groups of names that imitate each other within `SAME_SPACE`, both ways."""
        groups: list[set[str]] = []
        for a, b, one, back in self._pairs():
            if not (one < SAME_SPACE and back < SAME_SPACE):
                continue
            joined = [group for group in groups if a in group or b in group]
            groups = [group for group in groups if group not in joined]
            groups.append(set().union({a, b}, *joined))
        order = self.names.index
        return tuple(tuple(sorted(group, key=order)) for group in groups)

    def invisible(self) -> tuple[Visibility, ...]:
        """Return what cannot be seen."""
        return tuple(entry for entry in self.visibility if not entry.visible)

    def _pairs(self) -> list[tuple[str, str, float, float]]:
        """Return (i, j, sin^2, sin^2 of the reverse) for all pairs that were compared."""
        n = len(self.names)
        return [
            (self.names[i], self.names[j], float(self.sin2[i, j]), float(self.sin2[j, i]))
            for i in range(n)
            for j in range(n)
            if i != j and np.isfinite(self.sin2[i, j])
        ]


def compare(
    motion: Motion,
    effects: Sequence[Effect],
    profile: ProfileData,
    *,
    noise: Noise | None = None,
    n_rows: int = SKETCH_ROWS,
    progress: Callable[[str, float], None] | None = None,
) -> Confusability:
    r"""Compare effects on a motion.

    Parameters
    ----------
    motion : Motion
        Motion of a record or of a plan.
    effects : sequence of Effect
        Effects, each name once; `nominal_shape` gives shapes where nothing is known.
    profile : ProfileData
        Bench.
    noise : Noise or None
        Noise of the torque; white with the profile's standard deviation where None.
    n_rows : int
        Rows of the sketch.
    progress : callable or None
        Told what is going on and the share done.

    Returns
    -------
    Confusability

    Notes
    -----
    With S_i the whitened columns of effect i less what the baseline explains, and P_j(q) the
    projection onto those of effect j with shape q,

    .. math:: \sin^2 \gamma_{ij} = \min_q 1 - \|P_j(q) S_i\|_F^2 / \|S_i\|_F^2 ,

    the share of the expected evidence for i that is left against j, phases of i being equally
    likely. An effect of d standard deviations then brings :math:`(d^2/2) \sin^2 \gamma` nats for
    its name over the other one.
    """
    told = progress or (lambda _what, _share: None)
    white = noise or Noise.white(max(profile.sensor.noise_nm, np.finfo(float).tiny))
    model = BenchModel.from_profile(profile)
    motion = with_simulated(motion, model)
    sketch = make_sketch(motion, profile, white, n_rows=n_rows)
    visibility, sin2 = _compared(effects, sketch, told)
    held = [i for i, entry in enumerate(visibility) if entry.reason == HELD]
    if len(held) > 1:
        told("what the baseline holds", 0.95)
        plain = make_sketch(motion, profile, white, n_rows=n_rows, zero_only=True)
        chosen = [effects[i] for i in held]
        _, among = _compared(chosen, plain, lambda _what, _share: None)
        sin2[np.ix_(held, held)] = among
    names = tuple(effect.name for effect in effects)
    span = float(motion.time_s[-1] - motion.time_s[0])
    return Confusability(names, sin2, tuple(visibility), span)


def _compared(
    effects: Sequence[Effect], sketch: Sketch, told: Callable[[str, float], None]
) -> tuple[list[Visibility], FloatArray]:
    """Return what each effect shows on a sketch, and the shares, shape (n, n)."""
    spectra = LineSpectra(sketch, line_tops(effects, sketch.motion))
    seen: list[tuple[int, Target, Imitator]] = []
    visibility = []
    for index, effect in enumerate(effects):
        told(f"signature of {effect.name}", 0.2 * index / len(effects))
        entry, found = look_at(effect, sketch, spectra, len(effects))
        visibility.append(entry)
        if found is not None:
            seen.append((index, *found))
    starts = {j: target.effect.shape for j, target, _ in seen}
    sin2 = np.full((len(effects), len(effects)), np.nan)
    for number, (j, _, imitator) in enumerate(seen):
        told(f"what {imitator.cause.name} can imitate", 0.2 + 0.7 * number / len(seen))
        others = [(i, target) for i, target, _ in seen if i != j]
        targets = tuple(target for _, target in others)
        shares = imitator.shares_left(targets, starts[j])
        for (i, _), (left, _) in zip(others, shares, strict=True):
            sin2[i, j] = left
    return visibility, sin2
