"""A calibration of its own: weights on an arm, sparse standing readings, static effects."""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from .bench import Noise
from .build import TIERS, Case, Hidden, Made, described, size_of, truth_of
from .family import TABLE, branch_loop, families, sign_curve, waves
from .geometry import Whitened

_GRAVITY = 9.80650
_ARM_M = 0.5
_MASSES = {"full": (0.0, 2.0, 4.0, 6.0, 8.0), "low": (0.0, 0.5, 1.0, 1.5, 2.0)}
_FULL_NM = 40.0


@dataclass(frozen=True)
class Loading:
    """All readings of a calibration in the order they were taken, as columns."""

    experiment: np.ndarray
    position: np.ndarray
    full: np.ndarray
    cw: np.ndarray
    up: np.ndarray
    mass: np.ndarray
    time: np.ndarray
    noise: object = None

    # the shaft stands
    angle = (0.0,)

    @property
    def seconds(self):
        """When the last reading was taken, s."""
        return float(self.time[-1])

    @property
    def torque(self):
        """Torque written down: mass, gravity and arm, N m; cw positive."""
        return np.where(self.cw, 1.0, -1.0) * self.mass * _GRAVITY * _ARM_M

    def baseline(self):
        """One gain and a zero for each experiment."""
        zeros = (self.experiment[:, None] == np.unique(self.experiment)).astype(float)
        return np.column_stack([self.torque, zeros])

    def by_experiment(self, curve):
        """Apply `curve(rows)` to the rows of each experiment."""
        out = np.empty(len(self.time))
        for number in np.unique(self.experiment):
            rows = np.flatnonzero(self.experiment == number)
            out[rows] = curve(rows)
        return out


def draw_loading(rng):
    """Four positions, both directions, both ranges; a reading every 20 to 40 s."""
    rows, now = [], 0.0
    places = np.arange(4) * np.pi / 2.0 + rng.uniform(-0.05, 0.05, 4)
    pause = rng.uniform(20.0, 40.0)
    kinds = product((True, False), places, (True, False))
    for number, (full, place, cw) in enumerate(kinds):
        masses = _MASSES["full" if full else "low"]
        for k, mass in enumerate((*masses, *masses[-2::-1])):
            now += pause * rng.uniform(0.8, 1.2)
            rows.append((number, place, full, cw, k < len(masses), mass, now))
        now += rng.uniform(120.0, 300.0)
    return Loading(*map(np.array, zip(*rows, strict=True)))


def _loop(loading, shape):
    """Loop of Bouc and Wen on each experiment, from the virgin state."""

    def curve(rows):
        load = np.concatenate([[0.0], loading.torque[rows]])
        # in small steps: the reading is taken after a slow, one-sided change
        fine = np.interp(np.linspace(0, len(rows), 40 * len(rows) + 1), range(len(load)), load)
        return branch_loop(fine, shape["reach"], shape["skew"])[40::40]

    return loading.by_experiment(curve)


def _creep(loading, shape):
    """A first-order state that follows the load while it hangs."""

    def curve(rows):
        state, out, before = 0.0, [], None
        for row in rows:
            hang = 25.0 if before is None else loading.time[row] - loading.time[before]
            pole = np.exp(-hang / shape["constant"])
            state = pole * state + (1.0 - pole) * loading.torque[row]
            before = row
            out.append(state)
        return np.array(out)

    return loading.by_experiment(curve)


def _sag(loading, shape):
    """The arm hangs by `tilt` and bends by `size` rad at full load: torque by its cosine."""
    pull = loading.mass * _GRAVITY * _ARM_M
    bend = np.zeros(len(pull))
    for _ in range(30):
        bend = shape["size"] * pull / _FULL_NM * np.cos(shape["tilt_rad"] + bend)
    true = pull * np.cos(shape["tilt_rad"] + bend)
    return np.where(loading.cw, 1.0, -1.0) * (true - pull * np.cos(shape["tilt_rad"]))


def _knee(loading, shape):
    load = loading.torque
    return load / (1.0 + (load * shape["size"]) ** 4) ** 0.25 - load


def _gain_of_position(loading, shape):
    return loading.torque[:, None] * waves(loading.position)


def _dead_zone(loading, shape):
    return -shape["size"] * sign_curve(loading.torque, shape["size"])


STATIC = families(
    {
        "hysteresis": _loop,
        "cubic-nonlinearity": lambda loading, shape: (loading.torque / _FULL_NM) ** 3,
        "position-dependent-gain": _gain_of_position,
        "direction-asymmetry": lambda loading, shape: np.abs(loading.torque),
        "zero-drift": lambda loading, shape: loading.time / 3600.0,
        "saturation": _knee,
        "creep": _creep,
        "arm-sag": _sag,
        "backlash": _dead_zone,
    },
    TABLE["loads"],
)
_NM_PER_VOLT = 6.6
_STATIC = {family.name: family for family in STATIC}
LOAD_FAMILIES = tuple(_STATIC)
_SAMPLES = 100


def load_cases(base, per_cell=6, clean=300):
    """Return the cases of the calibration part, mixed so that any beginning is a fair sample."""
    tiers = ("d3", "d5", "d7", "d10", "d20", *TIERS)
    cases = [_case(base, f"L-clean-{k:03d}", ()) for k in range(clean)]
    for k, tier, name in product(range(per_cell), tiers, LOAD_FAMILIES):
        if tier not in TIERS or k < 3:
            cases.append(_case(base, f"L-{name}-{tier}-{k}", (Hidden(name, tier),)))
    return sorted(cases, key=lambda case: case.seed)


def _case(base, key, hidden):
    rng = np.random.default_rng([base, 8, *key.encode()])
    sigma = float(rng.choice([0.003, 0.005, 0.02]))
    return Case(key, "L", "loads", "white", sigma, 16, int(rng.integers(2**40)), hidden)


def _readings(case, loading, volts):
    return [
        {
            "experiment": f"e{loading.experiment[k]:02d}",
            "position_rad": float(loading.position[k]),
            "range": "full" if loading.full[k] else "low",
            "direction": "cw" if loading.cw[k] else "ccw",
            "series": "up" if loading.up[k] else "down",
            "torque_nm": float(loading.torque[k]),
            "reading_v": float(volts[k]),
            "mass_kg": float(loading.mass[k]),
            "reading_std_v": case.sigma_nm * _SAMPLES**0.5 / _NM_PER_VOLT,
            "n_samples": _SAMPLES,
            "time_s": float(loading.time[k]),
        }
        for k in range(len(volts))
    ]


def build_loads(case):
    """Make the calibration of `case`; `columns` holds `readings`, a list of rows."""
    rng = np.random.default_rng([case.seed, 1])
    loading = replace(draw_loading(rng), noise=Noise(case.noise, case.sigma_nm))
    count = int(loading.experiment[-1]) + 1
    zeros = rng.uniform(-0.2, 0.2, count)[loading.experiment]
    gain = _NM_PER_VOLT * (1.0 + rng.uniform(-0.02, 0.02))
    torque = loading.torque + zeros + case.sigma_nm * rng.standard_normal(len(zeros))
    effects, torques = [], []
    for hidden in case.hidden:
        family, white = _STATIC[hidden.name], Whitened(loading)
        shape = family.draw(np.random.default_rng([case.seed, 10]), loading)
        size = size_of(family, loading, white, shape, hidden.tier, None)
        truth, effect = described(
            hidden.tier, family, loading, shape, size, None, white, families=STATIC
        )
        effects.append(truth)
        torques.append(effect)
        torque = torque + effect
    columns = {"readings": _readings(case, loading, torque / gain)}
    return Made(columns, truth_of(case, loading, effects), loading, tuple(torques))
