"""Spectrum of the noise: a sum of simple shapes by Whittle's likelihood."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.records.trace import FloatArray

# poles of first and second order over the range of frequencies, and bumps of a third of an octave
_POLES, _BUMPS = 8, 14
_BUMP_WIDTH = 0.35
# no form is exact: up to a hundredth of what is modelled may be off in no stated direction, and
# channels of one log may be this far apart in time, s
_FORM, _DELAY_S = 0.01, 0.010
# steps of the scoring, the shortest one, and the gain at which it has settled: .01 nats
_STEPS, _LEAST_STEP, _SETTLED = 20, 1e-3, 0.02
# noise below this share of the bandwidth is slow: it imitates drifts, steps and laws of the motion
_SLOW_SHARE = 0.01
# form error without a direction begins at this share of what it may be: it grows fast where it is
# seen, and falls slowly where it is not
_FIRST_SHARE = 1e-5


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Power of the noise per coefficient in each band, (N m)^2.

    Parameters
    ----------
    power : ndarray, shape (n_bands,)
        Sum of all shapes.
    amounts : ndarray, shape (n_shapes,)
        Amount of each shape.
    """

    power: FloatArray
    amounts: FloatArray


@dataclass(frozen=True, slots=True)
class Shapes:
    """Shapes of which a spectrum is made.

    Parameters
    ----------
    table : ndarray, shape (n_shapes, n_bands)
        Power of each, largest 1.
    n_smooth : int
        How many fall with frequency; they come first.
    floor : float
        Power that every band has: rounding, (N m)^2.
    timing : ndarray, shape (n_bands,)
        What a delay leaves of a motion, relative to its power.
    slow : ndarray of bool, shape (n_shapes,)
        Shapes of slow noise, which imitate slow effects: 1/f and steeper, slow poles and bumps.
    with_slow : bool
        Whether these are used: slow noise is a hypothesis that has to be accepted.
    """

    table: FloatArray
    n_smooth: int
    floor: float
    timing: FloatArray
    slow: NDArray[np.bool_]
    with_slow: bool = False

    def rising(self) -> Shapes:
        """Return the same with the shapes that rise towards 0 Hz."""
        return replace(self, with_slow=True)

    def with_only(self, exponent: int) -> Shapes:
        """Return the shapes with 1/f to this exponent as the only slow one; 0 for none."""
        kept = ~self.slow
        if exponent:
            kept[exponent] = True
        kept[self.n_smooth :] = False
        return replace(
            self,
            table=self.table[kept],
            slow=self.slow[kept],
            n_smooth=int(kept.sum()),
            with_slow=True,
        )

    def without_bumps(self) -> Shapes:
        """Return the shapes that fall with frequency alone."""
        n = self.n_smooth
        return replace(self, table=self.table[:n], slow=self.slow[:n])

    def even(self, power: FloatArray) -> FloatArray:
        """Return powers of all bands that do not rise towards 0 Hz: what is more there is cut."""
        return np.minimum.accumulate(power[::-1])[::-1]

    def fit(
        self,
        power: FloatArray,
        dof: FloatArray,
        start: FloatArray | None = None,
        model: FloatArray | None = None,
        moving: FloatArray | None = None,
    ) -> Spectrum:
        """Return the most likely sum of shapes.

        Notes
        -----
        Minimises the sum of dof (ln S + P / S) over amounts that are not negative, by Fisher
        scoring: least squares with weights dof / S^2, the step halved until the sum falls.
        """
        used = dof > 0.5
        whole = self.table
        caps = np.where(self.slow & (not self.with_slow), 0.0, np.inf)
        for share, extra in ((_FORM**2, model), (1.0, moving)):
            if extra is not None:
                shape = extra if share < 1.0 else extra * self.timing
                whole = np.vstack([whole, np.maximum(shape, 1e-12 * self.floor)])
                caps = np.append(caps, share)
        p, nu, count = np.maximum(power[used], self.floor), dof[used], len(self.table)
        amounts = np.where(np.isfinite(caps), _FIRST_SHARE * caps, 0.0)
        amounts[:count] = float(np.median(p)) / count if start is None else start
        live = caps > 0.0
        amounts = np.where(live, np.minimum(amounts, caps), 0.0)
        amounts[live] = _scored(whole[live][:, used], p, nu, amounts[live], caps[live], self.floor)
        return Spectrum(amounts @ whole + self.floor, amounts[:count])


def _scored(
    table: FloatArray,
    power: FloatArray,
    dof: FloatArray,
    amounts: FloatArray,
    caps: FloatArray,
    floor: float,
) -> FloatArray:
    """Return the most likely amounts between 0 and their caps, from these on."""

    def loss_of(spectrum: FloatArray) -> float:
        return float(dof @ (np.log(spectrum) + power / spectrum))

    spectrum = amounts @ table + floor
    loss = loss_of(spectrum)
    for _ in range(_STEPS):
        weight = np.sqrt(dof) / spectrum
        wanted = _between(table * weight, (power - floor) * weight, caps)
        share = 1.0
        while share > _LEAST_STEP:
            nearer = amounts + share * (wanted - amounts)
            tried = nearer @ table + floor
            gain = loss - loss_of(tried)
            if gain > 0.0:
                break
            share *= 0.5
        else:
            break
        amounts, spectrum, loss = nearer, tried, loss - gain
        if gain < _SETTLED:
            break
    return amounts


def _between(rows: FloatArray, wanted: FloatArray, caps: FloatArray) -> FloatArray:
    """Return the least squares' coefficients of rows between 0 and their caps."""
    from scipy.optimize import nnls

    size = np.maximum(np.sqrt(np.einsum("sb,sb->s", rows, rows)), 1e-300)
    columns, most = (rows / size[:, None]).T, caps * size
    found = nnls(columns, wanted)[0]
    over = found > most
    if over.any():
        found = np.where(over, most, 0.0)
        left = wanted - columns @ found
        found[~over] = np.minimum(nnls(columns[:, ~over], left)[0], most[~over])
    return np.asarray(found / size)


def make_shapes(frequency_hz: FloatArray, floor: float, passed: FloatArray | float = 1.0) -> Shapes:
    """Return the shapes for bands of these frequencies.

    White noise ahead of the torque channel leaves it with the power that is `passed`.
    """
    f = frequency_hz
    corners = np.geomspace(4.0 * f[1], 0.5 * f[-1], _POLES)
    falling = [np.ones(len(f)), 1.0 / f, f**-2.0, f**-3.0]
    falling += [1.0 / (1.0 + (f / corner) ** power) for power in (2, 4) for corner in corners]
    falling.append(np.minimum.accumulate(passed * np.ones(len(f))))
    centres = np.geomspace(f[1], 0.9 * f[-1], _BUMPS)
    bumps = [np.exp(-0.5 * (np.log(f / centre) / _BUMP_WIDTH) ** 2) for centre in centres]
    table = np.array([shape / shape.max() for shape in (*falling, *bumps)])
    timing = np.minimum(1.0, (2.0 * np.pi * f * _DELAY_S) ** 2)
    edge = _SLOW_SHARE * f[-1]
    slow = np.concatenate(
        [
            [False, True, True, True],
            corners < edge,
            corners < edge,
            [False],
            centres < edge,
        ]
    )
    return Shapes(table, len(falling), floor, timing, slow)
