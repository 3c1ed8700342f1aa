"""A calibration of its own: weights on an arm, sparse standing readings, static effects."""

from dataclasses import dataclass

import numpy as np

from .build import Case, Hidden, Made, reach
from .family import branch_loop, sign_curve

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
    rows = []
    now, number = 0.0, 0
    places = np.arange(4) * np.pi / 2.0 + rng.uniform(-0.05, 0.05, 4)
    pause = rng.uniform(20.0, 40.0)
    for full in (1, 0):
        for place in places:
            for cw in (1, 0):
                masses = _MASSES["full" if full else "low"]
                for k, mass in enumerate((*masses, *masses[-2::-1])):
                    now += pause * rng.uniform(0.8, 1.2)
                    rows.append((number, place, full, cw, k < len(masses), mass, now))
                now += rng.uniform(120.0, 300.0)
                number += 1
    columns = np.array(rows).T
    return Loading(
        columns[0].astype(int), columns[1], columns[2] > 0.5, columns[3] > 0.5,
        columns[4] > 0.5, columns[5], columns[6],
    )  # fmt: skip


@dataclass(frozen=True)
class StaticFamily:
    """A static effect: `torque(loading, shape, size)`, N m; `draw(rng)` its shape."""

    name: str
    torque: object
    draw: object
    physical: tuple
    grid: tuple = ({},)
    mixes: int = 1
    steps: tuple = ()

    def tangents(self, loading, shape, size):
        """Derivatives over the shape parameters that a fitter has to find, (n, k)."""
        out = np.empty((len(loading.time), len(self.steps)))
        for k, (name, step) in enumerate(self.steps):
            ahead = self.torque(loading, {**shape, name: shape[name] + step}, size)
            out[:, k] = ahead - self.torque(loading, {**shape, name: shape[name] - step}, size)
        return out


def _wave(order):
    def torque(loading, shape, size):
        angle = order * loading.position + shape.get("phase_rad", 0.0)
        return size * loading.torque * np.cos(angle)

    return torque


def _loop(loading, shape, size):
    """Loop of Bouc and Wen on each experiment, from the virgin state."""

    def curve(rows):
        load = np.concatenate([[0.0], loading.torque[rows]])
        # in small steps: the reading is taken after a slow, one-sided change
        fine = np.interp(np.linspace(0, len(rows), 40 * len(rows) + 1), range(len(load)), load)
        return branch_loop(fine, shape["reach"], shape["skew"])[40::40]

    return size * loading.by_experiment(curve)


def _creep(loading, shape, size):
    """A first-order state that follows the load while it hangs."""

    def curve(rows):
        state, out, before = 0.0, [], None
        for row in rows:
            hang = 25.0 if before is None else loading.time[row] - loading.time[before]
            pole = np.exp(-hang / shape["constant_s"])
            state = pole * state + (1.0 - pole) * loading.torque[row]
            before = row
            out.append(state)
        return np.array(out)

    return size * loading.by_experiment(curve)


def _sag(loading, shape, size):
    """The arm hangs by `tilt` and bends by `size` rad at full load: torque by its cosine."""
    pull = loading.mass * _GRAVITY * _ARM_M
    bend = np.zeros(len(pull))
    for _ in range(30):
        bend = size * pull / _FULL_NM * np.cos(shape["tilt_rad"] + bend)
    true = pull * np.cos(shape["tilt_rad"] + bend)
    return np.where(loading.cw, 1.0, -1.0) * (true - pull * np.cos(shape["tilt_rad"]))


def _knee(loading, shape, size):
    load = loading.torque
    return load / (1.0 + (load * size) ** 4) ** 0.25 - load


STATIC = (
    StaticFamily(
        "hysteresis", _loop,
        lambda rng: {"reach": float(rng.uniform(1.5, 8.0)), "skew": float(rng.uniform(0.0, 0.35))},
        (0.02, 0.1, 0.4), tuple({"reach": r, "skew": 0.0} for r in (1.5, 4.0, 8.0)),
        steps=(("reach", 0.01),),
    ),
    StaticFamily(
        "cubic-nonlinearity",
        lambda loading, shape, size: size * (loading.torque / _FULL_NM) ** 3,
        lambda rng: {}, (0.02, 0.1, 0.4),
    ),
    StaticFamily(
        "position-dependent-gain", _wave(1.0),
        lambda rng: {"phase_rad": float(rng.uniform(-np.pi, np.pi))}, (0.002, 0.007, 0.02),
        ({"phase_rad": 0.0}, {"phase_rad": 1.5708}), 2, (("phase_rad", 1e-3),),
    ),
    StaticFamily(
        "direction-asymmetry",
        lambda loading, shape, size: size * np.abs(loading.torque),
        lambda rng: {}, (0.001, 0.004, 0.015),
    ),
    StaticFamily(
        "zero-drift",
        lambda loading, shape, size: size * loading.time / 3600.0,
        lambda rng: {}, (0.05, 0.2, 0.6),
    ),
    StaticFamily("saturation", _knee, lambda rng: {}, (1 / 90, 1 / 65, 1 / 45),
                 ({}, {})),
    StaticFamily(
        "creep", _creep, lambda rng: {"constant_s": float(rng.uniform(60.0, 400.0))},
        (0.0005, 0.002, 0.006), tuple({"constant_s": c} for c in (60.0, 150.0, 400.0)),
        steps=(("constant_s", 0.1),),
    ),
    StaticFamily(
        "arm-sag", _sag,
        lambda rng: {"tilt_rad": float(rng.uniform(0.03, 0.12) * rng.choice([-1.0, 1.0]))},
        (0.01, 0.03, 0.08), ({"tilt_rad": 0.08},),
    ),
    StaticFamily(
        "backlash",
        lambda loading, shape, size: -size * sign_curve(loading.torque, size),
        lambda rng: {}, (0.03, 0.15, 0.6),
    ),
)  # fmt: skip


_NM_PER_VOLT = 6.6
_STATIC = {family.name: family for family in STATIC}
LOAD_FAMILIES = tuple(_STATIC)
_TIERS = ("low", "mid", "high")
_SAMPLES = 100


def load_cases(base, per_cell=6, clean=300):
    """Return the cases of the calibration part, mixed so that any beginning is a fair sample."""
    cases = list(_cases(base, per_cell, clean))
    order = np.argsort([case.seed for case in cases])
    return [cases[k] for k in order]


def _cases(base, per_cell, clean):
    for k in range(per_cell):
        for tier in ("d3", "d5", "d7", "d10", "d20", "low", "mid", "high"):
            for name in LOAD_FAMILIES:
                if tier in _TIERS and k >= 3:
                    continue
                yield _case(base, f"L-{name}-{tier}-{k}", (Hidden(name, tier),))
    for k in range(clean):
        yield _case(base, f"L-clean-{k:03d}", ())


def _case(base, key, hidden):
    rng = np.random.default_rng([base, 8, *key.encode()])
    sigma = float(rng.choice([0.003, 0.005, 0.02]))
    return Case(key, "L", "loads", "white", sigma, 16, int(rng.integers(2**40)), hidden)


def _rest(loading, columns):
    first = loading.baseline()
    fit = np.linalg.lstsq(first, columns, rcond=None)[0]
    return columns - first @ fit


def _alike(loading, torque, hidden):
    """Share of the effect, by name, that other names leave; group of the hidden name is 0."""
    left = _rest(loading, torque)
    out = {}
    for family in STATIC:
        members = [
            family.torque(loading, {**shape}, size)
            for shape in family.grid
            for size in (family.physical[0], family.physical[2])
        ]
        stacks = [np.column_stack(members)] if family.mixes > 1 else [m[:, None] for m in members]
        for stack in stacks:
            basis = (
                np.linalg.qr(_rest(loading, stack))[0]
                if family.mixes == 1
                else _span(_rest(loading, stack))
            )
            along = basis.T @ left
            share = max(0.0, 1.0 - float(along @ along) / float(left @ left))
            out[family.name] = min(out.get(family.name, 1.0), share)
    out[hidden] = 0.0
    out["side-force"] = out["direction-asymmetry"]
    return {name: round(value, 5) for name, value in out.items() if value < 0.25}


def _span(columns):
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    return u[:, s > 1e-9 * s[0]]


def _bounds(family, loading, shape, size, sigma):
    """Standard deviations (Cramer-Rao) of size and shape parameters, by name."""
    step = 1e-3 * size
    ahead = family.torque(loading, shape, size + step)
    slope = (ahead - family.torque(loading, shape, size - step)) / (2.0 * step)
    widths = np.array([1.0, *(2.0 * width for _, width in family.steps)])
    matrix = np.column_stack([slope, family.tangents(loading, shape, size)]) / widths
    left = _rest(loading, matrix)
    scale = np.linalg.norm(left, axis=0)
    spread = np.sqrt(np.diag(np.linalg.pinv((left / scale).T @ (left / scale)))) / scale
    return dict(zip(["size", *dict(family.steps)], map(float, sigma * spread), strict=True))


def _effect(case, loading, rng):
    hidden = case.hidden[0]
    family = _STATIC[hidden.name]
    shape = family.draw(rng)

    def measure(size):
        left = _rest(loading, family.torque(loading, shape, size))
        if family.steps and family.name != "position-dependent-gain":
            basis = _span(_rest(loading, family.tangents(loading, shape, size)))
            left = left - basis @ (basis.T @ left)
        return float(np.linalg.norm(left)) / case.sigma_nm

    if hidden.tier in _TIERS:
        size = family.physical[_TIERS.index(hidden.tier)]
    else:
        size = reach(measure, family.physical[1], float(hidden.tier[1:]))
    torque = family.torque(loading, shape, size)
    truth = {
        "name": hidden.name, "tier": hidden.tier, "size": size, "shape": shape,
        "d": measure(size), "rms_nm": float(torque.std()), "domain": "torque",
        "alike": _alike(loading, torque, hidden.name), "reported": {},
        "bounds": _bounds(family, loading, shape, size, case.sigma_nm),
        "values": {"size": size, **shape}, "agrees": True, "outside": False,
    }  # fmt: skip
    return truth, torque


def _readings(case, loading, volts):
    out = []
    for k in range(len(volts)):
        out.append(
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
        )
    return out


def build_loads(case):
    """Make the calibration of `case`; `columns` holds `readings`, a list of rows."""
    rng = np.random.default_rng([case.seed, 1])
    loading = draw_loading(rng)
    count = int(loading.experiment[-1]) + 1
    zeros = rng.uniform(-0.2, 0.2, count)[loading.experiment]
    gain = _NM_PER_VOLT * (1.0 + rng.uniform(-0.02, 0.02))
    torque = loading.torque + zeros + case.sigma_nm * rng.standard_normal(len(zeros))
    effects, torques = [], []
    if case.hidden:
        truth, effect = _effect(case, loading, np.random.default_rng([case.seed, 10]))
        effects.append(truth)
        torques.append(effect)
        torque = torque + effect
    truth = {
        "key": case.key, "part": case.part, "record": case.record, "noise": case.noise,
        "sigma_nm": case.sigma_nm, "bits": case.bits, "seconds": float(loading.time[-1]),
        "turns": 0.0, "hidden": effects, "fault": "", "fault_truth": {}, "note": case.note,
    }  # fmt: skip
    columns = {"readings": _readings(case, loading, torque / gain)}
    return Made(columns, truth, loading, tuple(torques))
