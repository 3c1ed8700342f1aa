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
# rounds of the multiplicative update, from nothing and from a neighbouring spectrum
_ROUNDS, _FEW_ROUNDS = 200, 30
# noise below this share of the bandwidth is slow: it imitates drifts, steps and laws of the motion
_SLOW_SHARE = 0.01
# form error without a direction begins at this share of what it may be: it grows fast where it is
# seen, and falls slowly where it is not
_FIRST_SHARE = 1e-5
# a shape that was at zero may come back from this share of the median power
_RESERVE = 1e-5


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
        Minimises the sum of dof (ln S + P / S) over amounts that are not negative, by the
        multiplicative update of the Itakura-Saito divergence.

        References
        ----------
        .. [1] C. Fevotte, N. Bertin, J.-L. Durrieu, Neural Comput. 21 (2009) 793,
           doi:10.1162/neco.2008.04-08-771.
        """
        used = dof > 0.5
        whole = self.table
        caps = np.where(self.slow & (not self.with_slow), 0.0, np.inf)
        for share, extra in ((_FORM**2, model), (1.0, moving)):
            if extra is not None:
                shape = extra if share < 1.0 else extra * self.timing
                whole = np.vstack([whole, np.maximum(shape, 1e-12 * self.floor)])
                caps = np.append(caps, share)
        table, p, nu = whole[:, used], np.maximum(power[used], self.floor), dof[used]
        typical = float(np.median(p))
        count = len(self.table)
        amounts = np.where(np.isfinite(caps), _FIRST_SHARE * caps, 0.0)
        if start is None:
            amounts[:count], rounds = typical / count, _ROUNDS
        else:
            amounts[:count], rounds = np.maximum(start, _RESERVE * typical), _FEW_ROUNDS
        amounts = np.minimum(amounts, caps)
        nup = nu * p
        for _ in range(rounds):
            inverse = 1.0 / (amounts @ table + self.floor)
            rise = (table @ (nup * inverse * inverse)) / (table @ (nu * inverse))
            amounts = np.minimum(amounts * np.sqrt(rise), caps)
        return Spectrum(amounts @ whole + self.floor, amounts[:count])


def make_shapes(frequency_hz: FloatArray, floor: float) -> Shapes:
    """Return the shapes for bands of these frequencies."""
    f = frequency_hz
    corners = np.geomspace(4.0 * f[1], 0.5 * f[-1], _POLES)
    falling = [np.ones(len(f)), 1.0 / f, f**-2.0, f**-3.0]
    falling += [1.0 / (1.0 + (f / corner) ** power) for power in (2, 4) for corner in corners]
    centres = np.geomspace(f[1], 0.9 * f[-1], _BUMPS)
    bumps = [np.exp(-0.5 * (np.log(f / centre) / _BUMP_WIDTH) ** 2) for centre in centres]
    table = np.array([shape / shape.max() for shape in (*falling, *bumps)])
    timing = np.minimum(1.0, (2.0 * np.pi * f * _DELAY_S) ** 2)
    edge = _SLOW_SHARE * f[-1]
    slow = np.concatenate(
        [[False, True, True, True], corners < edge, corners < edge, centres < edge]
    )
    return Shapes(table, len(falling), floor, timing, slow)
