"""The loop between loading and unloading: its width, area, shape and closing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdbench.records.trace import FloatArray

__all__ = ["Loop", "loading_loop"]


@dataclass(frozen=True, slots=True)
class Loop:
    """Unloading less loading of one series, in torque by the series' own gain.

    Parameters
    ----------
    largest_nm, at_nm : float
        Largest difference at equal torque, with its sign, N m; the torque where it is, N m.
    relative : float
        Its size over the largest torque.
    largest_torque_nm : float
        Largest torque of the series, N m.
    area_v_nm, area_relative : float
        Area between the branches, V N m; over largest torque times largest deflection.
    zero_return_nm : float or None
        Zero after less zero before the series, N m; None without both.
    constant_nm, lens_nm : float or None
        Parts of the width: constant, as friction makes it, and a lens that is zero at both ends,
        as material makes it, N m; None for fewer than three common torques.
    """

    largest_nm: float
    at_nm: float
    relative: float
    largest_torque_nm: float
    area_v_nm: float
    area_relative: float
    zero_return_nm: float | None
    constant_nm: float | None
    lens_nm: float | None

    def to_dict(self) -> dict[str, object]:
        """Return the loop as results store it."""
        zero = self.zero_return_nm
        return {
            "largest_nm": self.largest_nm,
            "at_torque_nm": self.at_nm,
            "relative": self.relative,
            "largest_torque_nm": self.largest_torque_nm,
            "area_v_nm": self.area_v_nm,
            "area_relative": self.area_relative,
            "zero_return_nm": zero,
            "zero_return_relative": None if zero is None else zero / self.largest_torque_nm,
            "constant_nm": self.constant_nm,
            "lens_nm": self.lens_nm,
        }


def loading_loop(
    up: tuple[FloatArray, FloatArray],
    down: tuple[FloatArray, FloatArray],
    gain: float,
    zero_nm: float,
) -> Loop | None:
    """Compare unloading with loading at equal torque.

    Parameters
    ----------
    up, down : tuple of ndarray
        Torque, N m, at least 0, and reading, V, of each branch, in the order of the readings.
    gain : float
        N m/V of the series.
    zero_nm : float
        Torque up to which a reading is one of the zero, N m.

    Returns
    -------
    Loop or None
        None where the branches have no torque in common or nothing was loaded.

    Notes
    -----
    Between its readings a branch is a straight line. Both are compared where either has a
    reading and the other reaches; between these points the difference is straight as well. The
    parts are least squares of ``h0 + 4 h1 t (1 - t)``, t the torque over its largest.
    """
    (t_up, v_up), (t_down, v_down) = _sorted(up), _sorted(down)
    if not (len(t_up) and len(t_down)):
        return None
    low, high = max(t_up[0], t_down[0]), min(t_up[-1], t_down[-1])
    top = float(max(t_up[-1], t_down[-1]))
    if not (high >= low and top > 0.0 and gain != 0.0):
        return None
    points = np.unique(np.concatenate([t_up, t_down]))
    points = points[(points >= low) & (points <= high)]
    apart = np.interp(points, t_down, v_down) - np.interp(points, t_up, v_up)
    far = int(np.argmax(np.abs(apart)))
    area = float(np.trapezoid(apart, points)) if len(points) > 1 else 0.0
    zero = _zero_return(up, down, zero_nm)
    constant, lens = _shape(points, apart, top, zero_nm)
    return Loop(
        largest_nm=float(apart[far]) * gain,
        at_nm=float(points[far]),
        relative=abs(float(apart[far]) * gain) / top,
        largest_torque_nm=top,
        area_v_nm=area,
        area_relative=abs(area * gain) / top**2,
        zero_return_nm=None if zero is None else zero * gain,
        constant_nm=None if constant is None else constant * gain,
        lens_nm=None if lens is None else lens * gain,
    )


def _sorted(branch: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return a branch by rising torque, readings of one torque averaged."""
    torque, volts = branch
    steps, places = np.unique(torque, return_inverse=True)
    count = np.bincount(places, minlength=len(steps))
    return steps, np.bincount(places, weights=volts, minlength=len(steps)) / np.maximum(count, 1)


def _zero_return(
    up: tuple[FloatArray, FloatArray], down: tuple[FloatArray, FloatArray], zero_nm: float
) -> float | None:
    before, after = up[1][up[0] <= zero_nm], down[1][down[0] <= zero_nm]
    if not (len(before) and len(after)):
        return None
    return float(after[-1] - before[0])


def _shape(
    points: FloatArray, apart: FloatArray, top: float, zero_nm: float
) -> tuple[float | None, float | None]:
    loaded = points > zero_nm
    if int(loaded.sum()) < 3:
        return None, None
    share = points[loaded] / top
    design = np.column_stack([np.ones(len(share)), 4.0 * share * (1.0 - share)])
    found = np.linalg.lstsq(design, apart[loaded], rcond=None)[0]
    return float(found[0]), float(found[1])
