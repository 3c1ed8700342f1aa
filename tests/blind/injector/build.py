"""From a case to what a user would hold in hand, and to the truth that the scorer opens."""

from dataclasses import dataclass

import numpy as np

from .bench import Noise, channels_of, convert, draw_scene, drop, optional
from .family import effect
from .faults import ACQUISITION, FAULTS
from .geometry import Whitened, sine_squares
from .lines import LINES
from .mechanics import MECHANICS
from .outside import ACCEPTED, OUTSIDE
from .unseen import UNSEEN

_FAMILIES = {family.name: family for family in (*LINES, *MECHANICS, *OUTSIDE, UNSEEN)}
_FAULTS = {fault.name: fault for fault in ACQUISITION}
TIERS = ("low", "mid", "high")


@dataclass(frozen=True)
class Hidden:
    """One effect: a name and a size, sigmas as `d10` or a physical tier `low`, `mid`, `high`.

    `fixed` are shape parameters, (name, value), that are given instead of drawn.
    """

    name: str
    tier: str
    fixed: tuple = ()


@dataclass(frozen=True)
class Case:
    """Everything that decides a record."""

    key: str
    part: str
    record: str
    noise: str = "white"
    sigma_nm: float = 0.05
    bits: int = 16
    seed: int = 0
    hidden: tuple = ()
    fault: str = ""
    note: str = ""


@dataclass(frozen=True)
class Made:
    """Channels for the diagnosis, truth for the scorer, scene for the oracle."""

    columns: dict
    truth: dict
    scene: object
    torques: tuple


def family_of(name):
    """Return the family of an additive effect."""
    return _FAMILIES[name]


def known_families():
    """Return the families of the catalogue that are additive."""
    return [*LINES, *MECHANICS]


def reach(measure, start, target):
    """Size at which `measure(size)` is `target`, by the secant on the logarithms."""
    size, slope = start, 1.0
    value = measure(size)
    for _ in range(14):
        if abs(value / target - 1.0) < 2e-3:
            break
        step = np.clip(np.log(target / value) / slope, -3.0, 3.0)
        after = size * float(np.exp(step))
        now = measure(after)
        moved = np.log(now / value) / step
        slope = float(np.clip(moved, 0.2, 12.0)) if np.isfinite(moved) else 1.0
        size, value = after, now
    return size


def size_of(family, scene, white, shape, tier, others):
    """Size of an effect by its tier."""
    if tier in TIERS:
        return family.physical[TIERS.index(tier)]

    def measure(size):
        return white.detectability(scene, family, shape, size, others)

    middle = family.physical[1]
    target = float(tier[1:])
    if family.linear:
        return middle * target / measure(middle)
    return reach(measure, middle, target)


def drawn_effect(case, which, scene):
    """Family and shape of one of the hidden effects."""
    hidden = case.hidden[which]
    family = _FAMILIES[hidden.name]
    rng = np.random.default_rng([case.seed, 10 + which])
    return family, {**family.draw(rng, scene), **dict(hidden.fixed)}


def _others(case, which, scene, white):
    """Rests of the other effects: of two, each has its sigmas beside the other, not alone."""
    rests = []
    for k in range(len(case.hidden)):
        if k != which:
            family, shape = drawn_effect(case, k, scene)
            rests.append(white.rest(effect(family, scene, shape, family.physical[1])))
    return np.column_stack(rests) if rests else None


def _stage(hidden):
    return 0 if hidden.name in _FAULTS else _FAMILIES[hidden.name].stage


def _torque_effect(case, which, scene, white, entries):
    """(truth, torque) of one effect; `entries` are those that act before it, and it joins them."""
    hidden = case.hidden[which]
    family, shape = drawn_effect(case, which, scene)
    others = _others(case, which, scene, white)
    scene = scene.before(family, entries)
    size = size_of(family, scene, white, shape, hidden.tier, others)
    entries.append((family, shape, size))
    return described(hidden.tier, family, scene, shape, size, others, white)


def described(tier, family, scene, shape, size, others, white, beside=None, families=None):
    """(truth, torque) of one effect; names alike are judged beside the columns `beside`, if any."""
    torque, name = effect(family, scene, shape, size), family.name
    alike = sine_squares(scene, families or known_families(), shape, torque, beside)
    imitated = min((v for n, v in alike.items() if n != name), default=1.0)
    outside = family in OUTSIDE or family is UNSEEN
    if not outside:
        alike[name] = 0.0
    weights = shape["weights"]
    sign = weights[0] if len(weights) == 1 else 1.0
    fitted = {"size": sign * size, **{k: v for k, v in shape.items() if isinstance(v, float)}}
    truth = {
        "name": name,
        "tier": tier,
        "size": size,
        "shape": {k: list(v) if isinstance(v, tuple) else v for k, v in shape.items()},
        "d": white.detectability(scene, family, shape, size, others),
        "perpendicular": float(np.sqrt(imitated)),
        "rms_nm": float(torque.std()),
        "domain": family.domain,
        "alike": {name: round(value, 5) for name, value in alike.items() if value < 0.25},
        "bounds": white.bounds(scene, family, shape, size),
        "values": fitted,
        "agrees": family.agrees,
        "outside": outside,
        "accept": ACCEPTED.get(name, []),
    }
    return truth, torque


def _fault_effect(hidden, scene, white, rng, channels):
    fault = _FAULTS[hidden.name]
    shape = fault.draw(rng, scene)
    detectability = None
    if hidden.tier in TIERS:
        size = fault.physical[TIERS.index(hidden.tier)]
    else:
        size = (float(hidden.tier[1:]) / fault.sigmas(scene, white, shape)) ** (1.0 / fault.power)
    if fault.name == "encoder-slip":
        size = max(1.0, float(round(size)))
    if fault.sigmas is not None:
        detectability = fault.sigmas(scene, white, shape) * size**fault.power
    fault.apply(channels, scene, shape, size, rng)
    return {
        "name": hidden.name, "tier": hidden.tier, "size": size, "shape": shape,
        "d": detectability, "rms_nm": 0.0, "domain": fault.domain, "alike": {hidden.name: 0.0},
        "bounds": {}, "values": {}, "agrees": False, "outside": False,
    }  # fmt: skip


def scene_of(case):
    """Draw the bench and the motion of `case`."""
    rng = np.random.default_rng([case.seed, 1])
    noise = Noise(case.noise, case.sigma_nm)
    # twist in the angles would tell a bent spring from a bent sensor: not in these records
    bent = any("stiffness" in hidden.name or "cubic" in hidden.name for hidden in case.hidden)
    second = not bent and np.random.default_rng([case.seed, 5]).random() < 0.2
    return draw_scene(case.record, noise, case.bits, rng, second_encoder=second)


def build(case, scene=None, tell=None):
    """Make the record of `case`, on a scene that was drawn before where one is given.

    `tell(which)` gives truth and torque of an effect whose size is set by its neighbours.
    """
    scene = scene or scene_of(case)
    white = Whitened(scene) if case.hidden else None
    channels = channels_of(scene, np.random.default_rng([case.seed, 2]))
    optional_rng = np.random.default_rng([case.seed, 3])
    names = {hidden.name for hidden in case.hidden}
    extra = optional(scene, optional_rng, "crosstalk" in names)
    effects, torques, entries = {}, {}, []
    for k in sorted(range(len(case.hidden)), key=lambda k: _stage(case.hidden[k])):
        hidden = case.hidden[k]
        if hidden.name in _FAULTS:
            draw = np.random.default_rng([case.seed, 10 + k])
            effects[k] = _fault_effect(hidden, scene, white, draw, channels)
        else:
            found = tell(k) if tell else _torque_effect(case, k, scene, white, entries)
            effects[k], torques[k] = found
            channels["torque"] += torques[k]
    effects, torques = ([by[k] for k in sorted(by)] for by in (effects, torques))
    # a shaft at rest stands anywhere within a count: at 0.01 N m of noise the ripple's error of
    # 1 mN m would show, so that these benches have an interpolated encoder
    fine = case.sigma_nm < 0.02 or optional_rng.random() < 0.3
    columns = {**convert(scene, channels, fine), **extra}
    if "lost" in channels:
        columns = drop(columns, *channels["lost"])
    if case.fault:
        columns = FAULTS[case.fault](columns, np.random.default_rng([case.seed, 4]))
    return Made(columns, truth_of(case, scene.path, effects), scene, tuple(torques))


def truth_of(case, path, hidden, **more):
    """The truth of a record that holds the effects `hidden`."""
    names = ("key", "part", "record", "noise", "sigma_nm", "bits", "fault", "note")
    head = {name: getattr(case, name) for name in names}
    turns = float(np.ptp(path.angle)) / (2.0 * np.pi)
    return {**head, "seconds": path.seconds, "turns": turns, "hidden": hidden, **more}


# sine squared below which a name is a right answer to an unseen effect: it spans .95 of it
_NAMED = 0.05


def _strongest(torque):
    """Share of the strongest of separate bursts in their square."""
    edges = np.flatnonzero(np.diff((np.abs(torque) > 0.0).astype(int))) + 1
    parts = np.split(torque**2, edges)
    return max(float(part.sum()) for part in parts) / float(torque @ torque)


def build_unseen(case):
    """Make a record of part U.

    What no name imitates has the sigmas, unless a name spans it all; of bursts the strongest has
    them, for nobody knows where they are.
    """
    scene = scene_of(case)
    white = Whitened(scene)
    family, shape = drawn_effect(case, 0, scene)
    size = size_of(family, scene, white, shape, case.hidden[0].tier, None)
    torque = effect(family, scene, shape, size)
    free = min(sine_squares(scene, known_families(), shape, torque).values())
    if shape["recipe"] == "bursts":
        free = _strongest(torque)
    if free > _NAMED:
        size /= float(np.sqrt(free))
    told = described(case.hidden[0].tier, family, scene, shape, size, None, white)
    return build(case, scene, lambda which: told)
