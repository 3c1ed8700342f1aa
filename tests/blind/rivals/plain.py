"""Simpler methods on the same records: greedy BIC, SINDy's thresholding, FROLS.

All are handed the exact motion and the families' own columns, and take the noise for white:
that is how they are commonly used. Their terms are given the names they stand for.
"""

import numpy as np
from injector.build import known_families
from injector.family import waves

from .installed import INSTALLED, terms_of
from .oracle import measured_rest

_ORDERS = (1.0, 3.0, 5.0, 6.0, 7.0, 8.0, 10.0)
_MOST = 5


def library(made):
    """(name, columns) of everything that the simple methods choose from."""
    scene = made.scene
    out = []
    for family in known_families():
        if family.loaded and not scene.path.loaded:
            continue
        if family.name == "crosstalk" and "motor_current_a" not in made.columns:
            continue
        if family.name == "ripple-harmonic":
            out += [(family.name, waves(o * scene.path.angle)) for o in _ORDERS]
            continue
        out += [(family.name, family.columns(scene, shape)) for shape in family.grid(scene)]
    return out


def _prepared(made):
    scene = made.scene
    basis = np.linalg.qr(scene.baseline())[0]
    rest = measured_rest(made)
    rest = rest - basis @ (basis.T @ rest)
    names, blocks = [], []
    for name, columns in library(made):
        left = columns - basis @ (basis.T @ columns)
        if np.linalg.norm(left) > 1e-9 * np.linalg.norm(columns):
            names.append(name)
            blocks.append(left)
    return rest, names, blocks


def _greedy_bic(rest, names, blocks):
    """Add the family that lowers BIC most, until none does."""
    count, chosen = len(rest), []
    left = rest
    basis = np.empty((count, 0))
    for _ in range(_MOST):
        best, gain = None, 0.0
        for k, block in enumerate(blocks):
            free = block - basis @ (basis.T @ block)
            q = np.linalg.qr(free)[0]
            taken = float(((q.T @ left) ** 2).sum())
            now = -count * np.log1p(-taken / float(left @ left)) - block.shape[1] * np.log(count)
            if now > gain:
                best, gain, kept = k, now, q
        if best is None:
            break
        chosen.append(names[best])
        left = left - kept @ (kept.T @ left)
        basis = np.column_stack([basis, kept])
    return chosen


def _sindy(rest, names, blocks):
    """Sequentially thresholded least squares; threshold 5 of the noise's standard deviations."""
    matrix, owners = terms_of(names, blocks)
    gram, right = matrix.T @ matrix, matrix.T @ rest
    keep = np.ones(len(owners), dtype=bool)
    for _ in range(10):
        fit = np.zeros(len(owners))
        inner = gram[np.ix_(keep, keep)] + 1e-6 * np.eye(keep.sum())
        fit[keep] = np.linalg.solve(inner, right[keep])
        large = np.abs(fit) > 5.0 * rest.std()
        if np.array_equal(large, keep):
            break
        keep = large
        if not keep.any():
            break
    return [owners[k] for k in np.flatnonzero(keep)]


def _frols(rest, names, blocks):
    """Forward regression orthogonal least squares: error reduction ratios until BIC rises."""
    matrix, owners = terms_of(names, blocks)
    count, chosen = len(rest), []
    left, energy = matrix.copy(), float(rest @ rest)
    unexplained = energy
    for _ in range(_MOST):
        norms = np.einsum("ij,ij->j", left, left)
        ratio = np.where(norms > 1e-8, (left.T @ rest) ** 2 / np.maximum(norms, 1e-8), 0.0) / energy
        best = int(np.argmax(ratio))
        after = unexplained - ratio[best] * energy
        if count * np.log(unexplained / after) < np.log(count):
            break
        chosen.append(owners[best])
        unexplained = after
        w = left[:, best] / np.sqrt(norms[best])
        left = left - np.outer(w, w @ left)
    return chosen


METHODS = {"plain BIC": _greedy_bic, "SINDy (STLSQ)": _sindy, "FROLS (ERR, BIC)": _frols}


def rival_answer(method, made):
    """Answer of a simple method in the form of the contract."""
    names = {**METHODS, **INSTALLED}[method](*_prepared(made))
    causes = [
        {"name": name, "group": [name], "rivals": [], "parameters": {}}
        for name in dict.fromkeys(names)
    ]
    return {"verdict": "named" if causes else "nothing-found", "causes": causes,
            "unexplained": [], "minor": [], "minor_unexplained": [], "data_flags": []}  # fmt: skip
