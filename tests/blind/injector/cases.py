"""The grid of cases, parts A to F, T, W and U, and the record of each."""

from collections.abc import Iterator
from itertools import product

import numpy as np

from .build import Case, Hidden, build, build_unseen
from .family import read_table
from .faults import ACQUISITION, FAULTS
from .lines import LINES
from .loads import build_loads
from .many import GROUPS, build_many, groups_in_turn
from .mechanics import MECHANICS
from .outside import OUTSIDE
from .rough import build_pair

PUBLIC_SEED = 20260401
SIGMAS = ("d3", "d5", "d7", "d10", "d20")
TIERS = ("low", "mid", "high")
_RECORDS = {family.name: family.records for family in (*LINES, *MECHANICS, *OUTSIDE, *ACQUISITION)}
_DOMAIN = {family.name: family.domain for family in (*LINES, *MECHANICS)}
_NOISES = (0.01, 0.05, 0.2)


def _seed(base, *words):
    """A seed of its own for every case, from the base seed."""
    text = "/".join(map(str, words)).encode()
    return int(np.random.default_rng([base, *text]).integers(2**40))


def _case(base, key, record, hidden=(), **more):
    """A case whose part is the first letter of its key, with a seed of its own."""
    return Case(key, key[0], record, seed=_seed(base, key), hidden=hidden, **more)


def _record(name, rng):
    """A record that excites `name`: the shorter the more often, for time's sake."""
    allowed = _RECORDS[name]
    kinds = ["compact", "short", "mixed", "protocol", "long"]
    wish = str(rng.choice(kinds, p=[0.73, 0.1, 0.1, 0.05, 0.02]))
    return wish if wish in allowed or wish == "compact" else "compact"


def _bench(rng, coloured=0.25):
    """Noise, its size, the converter; 12 bits only where a step is below the noise."""
    noise = "ar" if rng.random() < coloured else "white"
    sigma = float(rng.choice(_NOISES, p=[0.2, 0.6, 0.2]))
    bits = 12 if sigma > 0.04 and rng.random() < 0.15 else 16
    return {"noise": noise, "sigma_nm": sigma, "bits": bits}


def _draws(base, stream, k, *words):
    return np.random.default_rng([base, stream, k, *"".join(words).encode()])


def _clean(base, scale):
    kinds = ("compact", "short", "mixed", "constant", "protocol")
    for k in range(round(1200 * scale)):
        rng = _draws(base, 1, k)
        bench = _bench(rng, 0.0)
        record = str(rng.choice(kinds, p=[0.68, 0.05, 0.1, 0.15, 0.02]))
        if k % 2:
            bench["noise"] = ("ar", "flicker")[(k // 2) % 2]
        if k % 300 == 7:
            record = "long"
        yield Case(f"A-{k:04d}", "A", record, seed=_seed(base, "A", k), **bench)


def _names():
    return [family.name for family in (*LINES, *MECHANICS)]


def _one(base, stream, part, k, name, tier, **fixed):
    """One effect on a record that shows it."""
    rng = _draws(base, stream, k, name, tier)
    record, bench = _record(name, rng), {**_bench(rng), **fixed}
    return _case(base, f"{part}-{name}-{tier}-{k}", record, (Hidden(name, tier),), **bench)


def _single(base, scale):
    sized = [*_names(), *(fault.name for fault in ACQUISITION if fault.sigmas is not None)]
    for k, tier, name in product(range(round(3 * scale)), SIGMAS, sized):
        yield _one(base, 2, "B", k, name, tier)
    # one speed tells few names apart: these show whether the answer says so
    flat = ("ripple-harmonic", "structural-tone", "motor-unbalance", "tooth-mesh",
            "wave-generator-eccentricity", "bearing-defect", "mains-hum", "angular-misalignment",
            "zero-step", "zero-drift")  # fmt: skip
    for name, k in product(flat, range(round(3 * scale))):
        bench, hidden = _bench(_draws(base, 3, k, name)), (Hidden(name, "d10"),)
        yield _case(base, f"B-{name}-d10-c{k}", "constant", hidden, **bench)


def _physical(base, scale):
    names = [*_names(), *(fault.name for fault in ACQUISITION)]
    for k, tier, name in product(range(round(2 * scale)), TIERS, names):
        yield _one(base, 4, "P", k, name, tier, bits=16)


# pairs that no record of torque and angle tells apart are no two effects
_SAME = (
    {"angular-misalignment", "arm-sag"},
    {"cubic-nonlinearity", "cubic-stiffness"},
    {"zero-drift", "warm-up"},
)


def _pair(rng, same):
    names = _names()
    while True:
        one, two = (str(n) for n in rng.choice(names, 2, replace=False))
        if {one, two} in _SAME:
            continue
        if not same or _DOMAIN[one] == _DOMAIN[two]:
            return one, two


def _doubles(base, scale):
    for tier, count in (("d10", 60), ("d15", 60), ("mid", 30)):
        for k in range(round(count * scale)):
            rng = _draws(base, 5, k, tier)
            pair = _pair(rng, k % 5 == 0)
            record = str(rng.choice(["compact", "short", "protocol"], p=[0.74, 0.2, 0.06]))
            hidden = tuple(Hidden(name, tier) for name in pair)
            yield _case(base, f"C-{tier}-{k:03d}", record, hidden, **_bench(rng))


def _outside(base, scale):
    names = [family.name for family in OUTSIDE]
    for k, tier, name in product(range(round(6 * scale)), ("d10", "d20"), names):
        yield _one(base, 6, "D", k, name, tier)


def _duels(base, scale):
    for k, (pair, duel) in product(range(round(3 * scale)), read_table("pairs")["duels"].items()):
        for name in duel["names"]:
            for word, record, tier in (
                ("poor", duel["record"], duel["size"]), ("good", "compact", "d20")
            ):  # fmt: skip
                alike = duel.get("alike", {}).get(name) if word == "poor" else None
                hidden = (Hidden(name, tier, (tuple(alike),) if alike else ()),)
                note = "|".join((*duel["names"], word))
                yield _case(base, f"E-{pair}-{name}-{word}-{k}", record, hidden, note=note)


def _bad(base, scale):
    for k, fault in product(range(round(10 * scale)), FAULTS):
        kinds = ["compact"] if fault == "noisy-load-cell" else ["compact", "mixed"]
        record = str(_draws(base, 7, k, fault).choice(kinds))
        yield _case(base, f"F-{fault}-{k}", record, fault=fault)


def _many(base, scale):
    """Several strong causes: all pairs of groups in turn."""
    turns = groups_in_turn(np.random.default_rng([base, 21]), round(200 * scale))
    for k, (count, groups) in enumerate(turns):
        rng = _draws(base, 22, k)
        # reserves behind the chosen ones, for what is not seen on this record
        hidden = tuple(Hidden(str(rng.choice(GROUPS[group])), "physical") for group in groups)
        kinds = ["compact", "short", "mixed", "protocol"]
        record = str(rng.choice(kinds, p=[0.7, 0.2, 0.07, 0.03]))
        bench = {**_bench(rng), "bits": 16}
        yield _case(base, f"T-{k:03d}", record, hidden, note=str(count), **bench)


def _wild(base, scale):
    """Pairs of records, with and without the nuisances of real logs."""
    names = _names()
    for k in range(round(300 * scale)):
        rng = _draws(base, 23, k)
        count = int(rng.choice([0, 1, 2], p=[0.3, 0.5, 0.2]))
        pair = _pair(rng, False) if count == 2 else (str(rng.choice(names)),)
        tier = str(rng.choice(["d12", "d20", "d40"]))
        hidden = tuple(Hidden(name, tier) for name in pair[:count])
        record = str(rng.choice(["compact", "short", "mixed"], p=[0.8, 0.1, 0.1]))
        if any(record not in _RECORDS[entry.name] for entry in hidden):
            record = "compact"
        seed, bench = _seed(base, f"W-{k:03d}"), {**_bench(rng), "bits": 16}
        for note in ("plain", "rough"):
            yield Case(f"W-{k:03d}-{note}", "W", record, seed=seed, hidden=hidden, note=note,
                       **bench)  # fmt: skip


def _unseen(base, scale):
    for k in range(round(200 * scale)):
        rng = _draws(base, 24, k)
        record = str(rng.choice(["compact", "short", "mixed"], p=[0.8, 0.1, 0.1]))
        hidden = (Hidden("unseen", ("d10", "d20")[k % 2]),)
        yield _case(base, f"U-{k:03d}", record, hidden, **_bench(rng))


PARTS = {
    "A": _clean, "B": _single, "P": _physical, "C": _doubles, "D": _outside, "E": _duels,
    "F": _bad, "T": _many, "W": _wild, "U": _unseen,
}  # fmt: skip


def grid(base=PUBLIC_SEED, parts="ABPCDEF", scale=1.0) -> Iterator[Case]:
    """Yield the cases of `parts`, mixed so that any beginning of the list is a fair sample.

    Every cell (part, size, noise or kind of record) is spread evenly over the whole list, its
    families in turn: a campaign that ends early has the same share of all figures. A larger
    `scale` has all cases of a smaller one and more.
    """
    cells = {}
    for part in parts:
        for case in PARTS[part](base, scale):
            cells.setdefault(_cell(case), []).append(case)
    placed = []
    for cell, cases in cells.items():
        rounds = {}
        turns = []
        for case in sorted(cases, key=lambda case: _seed(base, "order", case.key)):
            family = "+".join(hidden.name for hidden in case.hidden[:1]) + case.fault
            rounds[family] = rounds.get(family, -1) + 1
            turns.append((rounds[family] if len(case.hidden) == 1 else 0, len(turns), case))
        if cases[0].part == "W":
            # a pair stays together
            turns = [(0, 0, case) for case in sorted(cases, key=lambda case: case.key)]
        offset = np.random.default_rng([base, 9, *cell.encode()]).random()
        for k, (_, _, case) in enumerate(sorted(turns, key=lambda turn: turn[:2])):
            placed.append(((k + offset) / len(cases), case.key, case))
    for _, _, case in sorted(placed, key=lambda entry: entry[:2]):
        yield case


def _cell(case):
    """What a figure is about: records of one cell stand for each other."""
    if case.part in "TW":
        return case.part
    tier = case.hidden[0].tier if case.hidden else ""
    flat = "flat" if case.record == "constant" else "long" if case.record == "long" else ""
    noise = case.noise if case.part == "A" else ""
    return "/".join((case.part, tier, flat, noise, case.note.rpartition("|")[2]))


_BUILDERS = {"L": build_loads, "T": build_many, "W": build_pair, "U": build_unseen}


def make(case):
    """Make the record of `case`."""
    return _BUILDERS.get(case.part, build)(case)
