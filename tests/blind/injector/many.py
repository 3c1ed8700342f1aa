"""Part T: three to five causes of physical size on one record, each of 10 sigma beside the rest."""

from dataclasses import replace

import numpy as np

from .build import Hidden, build, described, drawn_effect, family_of, scene_of
from .family import effect, read_table
from .geometry import Whitened, sine_squares

_LEAST = 10.0
# sine squared below which two names are one group on a record (contract, section 5)
_GROUP = 0.01
GROUPS = read_table("pairs")["groups"]


def groups_in_turn(rng, count):
    """Lists of all groups, `count` of them: the first ones of each are pairs that came least."""
    names = list(GROUPS)
    seen = {}
    for _ in range(count):
        size = int(rng.integers(3, 6))
        order = [str(name) for name in rng.permutation(names)]
        chosen = [order[0]]
        while len(chosen) < size:
            rest = [name for name in order if name not in chosen]
            chosen.append(min(rest, key=lambda n: sum(seen.get(frozenset((n, c)), 0)
                                                      for c in chosen)))  # fmt: skip
        for k, one in enumerate(chosen):
            for two in chosen[:k]:
                seen[frozenset((one, two))] = seen.get(frozenset((one, two)), 0) + 1
        yield size, [*chosen, *(name for name in order if name not in chosen)]


def _columns(family, scene, shape, size):
    if family.linear:
        return family.columns(scene, shape)
    return effect(family, scene, shape, size)[:, None]


class _Record:
    """The effects of one record as they are chosen one by one."""

    def __init__(self, scene):
        self.scene, self.white, self.chosen = scene, Whitened(scene), []
        self._kept = {}

    def _seen(self, which, entries):
        """(family, scene at its stage of the channel, shape, size) of one of them."""
        _, family, shape, size = entries[which]
        return family, self.scene.before(family, [entry[1:] for entry in entries]), shape, size

    def raw_beside(self, which, entries):
        """Columns and tangents of all but one."""
        others = [_columns(*self._seen(k, entries)) for k in range(len(entries)) if k != which]
        return np.column_stack(others) if others else None

    def _rests(self, which, entries):
        """Whitened columns of an effect and of its shape's tangents, kept for the next question."""
        family, scene, shape, size = self._seen(which, entries)
        key = (family.name, size, tuple((before.name, much) for before, _, much in scene.acting))
        if key not in self._kept:
            columns = self.white.rest(_columns(family, scene, shape, size))
            slopes = self.white.tangents(scene, family, shape, size)
            self._kept[key] = np.column_stack([columns, slopes])
        return self._kept[key]

    def sigmas(self, which, entries):
        """Sigmas of one beside the baseline, its own shape and all others with theirs."""
        family, scene, shape, size = self._seen(which, entries)
        parts = [self._rests(k, entries) for k in range(len(entries)) if k != which]
        beside = np.column_stack(parts) if parts else None
        return self.white.detectability(scene, family, shape, size, beside)

    def _one_group(self, entries):
        """Whether one of the effects is what another's name spans beside the rest."""
        families = [entry[1] for entry in entries]
        for k in range(len(entries)):
            family, scene, shape, size = self._seen(k, entries)
            torque = effect(family, scene, shape, size)
            beside = self.raw_beside(k, entries)
            alike = sine_squares(scene, families, shape, torque, beside)
            if any(value < _GROUP for other, value in alike.items() if other != family.name):
                return True
        return False

    def told(self, which):
        """(truth, torque) of one effect, its sigmas and its group beside all others."""
        family, scene, shape, size = self._seen(which, self.chosen)
        beside = self.raw_beside(which, self.chosen)
        truth, torque = described("physical", family, scene, shape, size, None, self.white, beside)
        return {**truth, "d": self.sigmas(which, self.chosen)}, torque

    def take(self, name, family, shape, size):
        """Add the effect if all then keep their sigmas and stand in groups of their own."""
        for larger in (size, family.physical[2]):
            entries = [*self.chosen, (name, family, shape, larger)]
            if all(self.sigmas(k, entries) >= _LEAST for k in range(len(entries))):
                break
        else:
            return False
        if self._one_group(entries):
            return False
        self.chosen = entries
        return True


def build_many(case):
    """Make a record of the first causes of `case.hidden` that go together, `case.note` of them."""
    scene = scene_of(case)
    record = _Record(scene)
    rng = np.random.default_rng([case.seed, 40])
    for hidden in case.hidden:
        if len(record.chosen) == int(case.note):
            break
        if family_of(hidden.name).loaded and not scene.path.loaded:
            continue
        trial = replace(case, hidden=(*(Hidden(c[0], "mid") for c in record.chosen), hidden))
        family, shape = drawn_effect(trial, len(record.chosen), scene)
        low, _, high = family.physical
        low, high = sorted((low, high))
        record.take(hidden.name, family, shape, float(low * (high / low) ** rng.random()))
    fixed = tuple(Hidden(entry[0], "physical") for entry in record.chosen)
    return build(replace(case, hidden=fixed), scene, record.told)
