"""From a case of the calibration part to readings and truth."""

import numpy as np

from .build import Case, Hidden, Made, reach
from .loads import STATIC, draw_loading

__all__ = ["LOAD_FAMILIES", "build_loads", "load_cases"]

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
