"""The oracle: it knows which effects are hidden and their shapes, and fits their sizes.

Motion without error, noise whitened by its true law, shapes to first order about the truth; held
out are every fifth of twenty blocks in turn. No search, no name to find: nobody can do better.
"""

import numpy as np
from injector.bench import LOAD_INERTIA
from injector.build import family_of
from injector.family import effect, slopes
from injector.motion import RATIO

_BLOCKS = 20
_FOLDS = 5


def measured_rest(made):
    """Measured torque less what the contract fixes: expected torque and load, N m."""
    scene = made.scene
    torque = 6.6 * made.columns["torque_v"]
    known = LOAD_INERTIA / RATIO * scene.path.accel
    return torque - known - made.columns.get("load_torque_nm", 0.0)


def _columns(scene, entry):
    family = family_of(entry["name"])
    shape, size = dict(entry["shape"]), entry["size"]
    out = []
    if family.linear:
        out.append(family.columns(scene, shape))
    else:
        base = effect(family, scene, shape, size)
        more = effect(family, scene, shape, 1.01 * size)
        out += [base[:, None], (more - base)[:, None] / (0.01 * size)]
    return np.column_stack([*out, *slopes(family, scene, shape, size)])


def _sums(matrix):
    """Products of all columns, block by block: (blocks, k, k)."""
    return np.array([part.T @ part for part in np.array_split(matrix, _BLOCKS)])


def _held_out(white, raw, use):
    """Mean square of what `use` columns, fitted elsewhere, leave of the last column."""
    total = 0.0
    folds = np.arange(_BLOCKS) % _FOLDS
    for fold in range(_FOLDS):
        train, test = white[folds != fold].sum(axis=0), raw[folds == fold].sum(axis=0)
        scale = np.sqrt(np.diag(train)[use])
        scale[scale == 0.0] = 1.0
        gram = train[np.ix_(use, use)] / np.outer(scale, scale)
        fit = np.linalg.lstsq(gram, train[use, -1] / scale, rcond=1e-11)[0] / scale
        total += test[-1, -1] - 2.0 * fit @ test[use, -1] + fit @ test[np.ix_(use, use)] @ fit
    return float(total)


def oracle(made):
    """Return held-out RMS before and after, N m, or None where the fault is not additive."""
    entries = made.truth["hidden"]
    if len(made.torques) != len(entries):
        return None
    scene = made.scene
    first = scene.baseline()
    acting = [(family_of(entry["name"]), dict(entry["shape"]), entry["size"]) for entry in entries]
    hidden = [_columns(scene.before(one[0], acting), entry)
              for one, entry in zip(acting, entries, strict=True)]  # fmt: skip
    matrix = np.column_stack([first, *hidden, measured_rest(made)])
    raw, white = _sums(matrix), _sums(scene.noise.whiten(matrix))
    count, before = len(matrix), list(range(first.shape[1]))
    after = list(range(matrix.shape[1] - 1))
    return {
        "before_nm": float(np.sqrt(_held_out(white, raw, before) / count)),
        "after_nm": float(np.sqrt(_held_out(white, raw, after) / count)),
    }
