"""Distances in whitened space: how visible an effect is, and which names span the same."""

import numpy as np

from .family import effect, slopes, waves


class Whitened:
    """Whitening by the true noise, and what is left beside the baseline."""

    def __init__(self, scene, pick=slice(None)):
        self.noise, self.pick = scene.noise, pick
        explained = self.noise.whiten(scene.baseline())
        self._basis = np.linalg.qr(explained[pick])[0]

    def rest(self, columns, beside=None):
        """Whitened `columns` without what baseline (and `beside`, already a rest) explain."""
        white = self.noise.whiten(columns)[self.pick]
        left = white - self._basis @ (self._basis.T @ white)
        if beside is not None and beside.size:
            basis = _orthonormal(beside)
            left = left - basis @ (basis.T @ left)
        return left

    def tangents(self, scene, family, shape, size):
        """Rests of the derivatives over the shape parameters that a fitter has to find."""
        out = [self.rest(slope) for slope in slopes(family, scene, shape, size)]
        return np.column_stack(out) if out else self._basis[:, :0]

    def detectability(self, scene, family, shape, size, others=None):
        """Sigmas of the effect that baseline, shape tangents and `others` (rests) leave."""
        taken = self.tangents(scene, family, shape, size)
        if others is not None:
            taken = np.column_stack([taken, others])
        left = self.rest(effect(family, scene, shape, size), taken)
        return float(np.sqrt(left @ left))

    def bounds(self, scene, family, shape, size):
        """Standard deviations (Cramer-Rao) of size and shape parameters, by name."""
        first = self._slope(scene, family, shape, size)
        tangents = self.tangents(scene, family, shape, size)
        extra = self._quadratures(scene, family, shape, size)
        matrix = np.column_stack([first, tangents, *extra])
        scale = np.sqrt((matrix**2).sum(axis=0))
        scale[scale == 0.0] = 1.0
        information = (matrix / scale).T @ (matrix / scale)
        spread = np.sqrt(np.abs(np.diag(np.linalg.pinv(information)))) / scale
        return dict(zip(("size", *family.steps), map(float, spread), strict=False))

    def _slope(self, scene, family, shape, size):
        step = 1e-3 * size
        ahead = effect(family, scene, shape, size + step)
        back = effect(family, scene, shape, size - step)
        return self.rest((ahead - back) / (2.0 * step))

    def _quadratures(self, scene, family, shape, size):
        """Directions of the phases: linear parameters that a fitter estimates beside the size."""
        weights = np.asarray(shape.get("weights", (1.0,)))
        if not family.linear or len(weights) == 1:
            return []
        left = self.rest(family.columns(scene, shape)) * size
        turned = []
        for k in range(0, len(weights), 2):
            a, b = weights[k], weights[k + 1]
            turned.append(left[:, k + 1] * a - left[:, k] * b)
        return turned


def _orthonormal(columns):
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    return u[:, s > 1e-9 * s[0]] if len(s) and s[0] > 0.0 else columns[:, :0]


def places_of(scene, shape):
    """Order and frequency at which a line of `shape` may be named as well."""
    order, hertz = shape.get("order"), shape.get("frequency_hz")
    if order is None and hertz is None:
        return None, None
    speed = float(np.median(np.abs(scene.path.speed)))
    if order is None and hertz is not None and speed > 1.0:
        order = 2.0 * np.pi * hertz / speed
    elif hertz is None and order is not None:
        hertz = order * speed / (2.0 * np.pi)
        hertz = abs(hertz - 1000.0 * round(hertz / 1000.0))
    return order, hertz


def _is_mains(hertz):
    return min(abs(hertz - 50.0), abs(hertz - 60.0)) < 0.1


def candidates(scene, families, shape):
    """(name, columns) of everything that may span the effect."""
    order, hertz = places_of(scene, shape)
    for family in families:
        grid = [dict(entry) for entry in family.grid(scene)]
        known = {k: v for k, v in shape.items() if k != "weights"}
        for entry in list(grid[:1]):
            shared = {k: known[k] for k in entry if k in known}
            if shared and (family.name != "mains-hum" or _is_mains(shared["frequency_hz"])):
                grid.append({**entry, **shared})
        for entry in grid:
            yield family.name, family.columns(scene, entry)
        if family.name in ("ripple-harmonic", "bearing-defect") and order:
            yield family.name, waves(order * scene.path.angle)
        if family.name == "structural-tone" and hertz and "order" in shape:
            for offset in np.linspace(-0.5, 0.5, 5) / scene.path.seconds:
                yield family.name, waves(2.0 * np.pi * (hertz + offset) * scene.path.time)


def sine_squares(scene, families, shape, torque, beside=None):
    """Share of the effect, by name, that the family of that name cannot imitate here.

    `beside` are columns, N m, that are in the model already: other effects of the record.
    """
    count = len(torque)
    # 40 000 samples at random give a sine squared of 0.01 to a few per cent of itself
    pick = np.sort(np.random.default_rng(count).permutation(count)[:40000])
    white = Whitened(scene, pick)
    others = None if beside is None else white.rest(beside)
    left = white.rest(torque, others)
    energy = float(left @ left)
    out = {}
    for name, columns in candidates(scene, families, shape):
        rest = white.rest(columns, others)
        scale = np.sqrt((rest**2).sum(axis=0))
        if scale.max() <= 0.0:
            continue
        unit = rest / np.where(scale > 0.0, scale, 1.0)
        along = unit.T @ left
        taken = float(along @ np.linalg.pinv(unit.T @ unit, rcond=1e-9) @ along)
        # what does not show at all on a run can be anything
        share = max(0.0, 1.0 - taken / energy) if energy > 0.0 else 0.0
        out[name] = min(out.get(name, 1.0), share)
    if "direction-asymmetry" in out:
        out["side-force"] = out["direction-asymmetry"]
    return out
