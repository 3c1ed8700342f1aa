"""Effects with their shapes, and the shapes with which a cause may imitate another."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.planning.frame import Bounds, Frame
from hdbench.model import Cause
from hdbench.records.trace import FloatArray

__all__ = [
    "Axis",
    "Effect",
    "clipped",
    "fitted_shape",
    "line_key",
    "line_places",
    "line_spectrum",
    "nominal_shape",
    "shape_axes",
    "shape_grid",
]

# Shapes of a cause before anything is known of it: an order that the baseline lacks, the bearing of
# a wave generator (23 balls, d/D = 0.1), a motor of 12 pole pairs, the load on a flexspline of
# 16 kN m/rad, mains of 50 Hz, a tone away from it, a warming-up that a run of minutes shows,
# friction of a greased bearing.
_NOMINAL = {
    ("ripple-harmonic", "order"): 6.0,
    ("bearing-defect", "order"): 10.35,
    ("cogging", "order"): 12.0,
    ("torsional-resonance", "resonance_hz"): 153.0,
    ("torsional-resonance", "damping"): 0.03,
    ("mains-hum", "frequency_hz"): 50.0,
    ("structural-tone", "frequency_hz"): 37.3,
    ("warm-up", "time_constant_s"): 60.0,
    ("stribeck-friction", "stribeck_rad_s"): 15.0,
}
# a step in time nearer to the ends than this share is moved where it can be seen, off the middle,
# where a symmetric run turns round
_STEP_SHARE, _STEP_AT = 0.1, 0.45
# a domain with ends this far apart is cut in equal ratios, any other in equal steps
_DECADE = 10.0
# points of a grid along each shape, for one, two and more shapes together, and the same for a cause
# that needs more samples than the rows; places in between are tried afterwards
_POINTS = ({1: 25, 2: 7}, {1: 13, 2: 5}, {1: 9, 2: 3})
_POINTS_MORE = 3
# points of a line's spectrum per resolution cell: between two of them it keeps 81 % of its power
_PER_CELL = 2.0
# places nearer than two cells are sidelobes of one, and what holds less than this share of the
# effect is told apart anyway
_APART_CELLS = 2.0
_LEAST_SHARE = 0.02


@dataclass(frozen=True, slots=True)
class Effect:
    """A cause with its shape, and its peak torque, N m, where it is known from a diagnosis."""

    cause: Cause
    shape: Mapping[str, float]
    amplitude_nm: float | None = None

    @property
    def name(self) -> str:
        """Name of the cause."""
        return self.cause.name


@dataclass(frozen=True, slots=True)
class Axis:
    """Values of one shape parameter; between two of them the next are tried half-way."""

    values: FloatArray
    bands: Bounds
    by_ratio: bool

    def beside(self, value: float, halvings: int) -> list[float]:
        """Return the values on either side, a grid step halved so many times away."""
        if len(self.values) < 2:
            return []
        scale = np.log(self.values) if self.by_ratio else self.values
        here = float(np.log(value)) if self.by_ratio else value
        at = int(np.clip(np.searchsorted(scale, here), 1, len(scale) - 1))
        step = float(scale[at] - scale[at - 1]) / 2.0**halvings
        sides = (here - step, here + step)
        return [clipped(float(np.exp(x)) if self.by_ratio else x, self.bands) for x in sides]


def clipped(value: float, bands: Bounds) -> float:
    """Return the value of the bands that is nearest; the value itself where there is none."""
    near = [float(np.clip(value, low, high)) for low, high in bands]
    return min(near, key=lambda x: abs(x - value)) if near else value


def nominal_shape(cause: Cause) -> dict[str, float]:
    """Return the shape that a cause is given before anything is known of it.

    Each parameter has a value of the literature where there is one, else the middle of its domain
    (of its logarithm where that covers a decade). A time of a step is `fitted_shape`'s to choose.
    """
    shape = {}
    for parameter in cause.shape:
        bands = parameter.bands or ((parameter.lower, parameter.upper),)
        low, high = bands[0][0], bands[-1][1]
        wide = low > 0.0 and high / low >= _DECADE
        middle = float(np.sqrt(low * high)) if wide else 0.5 * (low + high)
        shape[parameter.name] = clipped(_NOMINAL.get((cause.name, parameter.name), middle), bands)
    return shape


def fitted_shape(
    shape: Mapping[str, float], bounds: Mapping[str, Bounds], time_s: FloatArray
) -> dict[str, float] | None:
    """Return a shape moved into its bounds; None where they leave nothing of a domain.

    A step in time gets a tenth of the samples at `time_s` or more on either side.
    """
    fitted = {}
    for name, bands in bounds.items():
        if not bands:
            return None
        value = clipped(shape[name], bands)
        if name == "step_time_s":
            before = float(np.mean(time_s < value))
            if not _STEP_SHARE <= before <= 1.0 - _STEP_SHARE:
                value = float(time_s[int(_STEP_AT * (len(time_s) - 1))])
        fitted[name] = value
    return fitted


def line_key(cause: Cause) -> str | None:
    """Return ``order`` or ``frequency_hz`` for a cause that is lines at one free place."""
    names = [parameter.name for parameter in cause.shape]
    return names[0] if names in (["order"], ["frequency_hz"]) else None


def shape_axes(cause: Cause, frame: Frame, home: int) -> dict[str, Axis]:
    """Return the grid along each shape parameter; of a line its resolution cells."""
    bounds = frame.bounds(cause)
    count = _POINTS[home].get(len(bounds), _POINTS_MORE)
    axes = {}
    for name, bands in bounds.items():
        low, high = (bands[0][0], bands[-1][1]) if bands else (0.0, 0.0)
        by_ratio = low > 0.0 and high / low >= _DECADE
        if name == line_key(cause):
            # as many samples before as a step of the spectrum: places beside it are tried anyway
            axes[name] = Axis(np.array([0.0, _cell(frame, name) / _PER_CELL]), bands, False)
            continue
        if name == "step_time_s":
            # even in samples, not in time: nothing is measured while loads are changed
            each = max(5, count // (len(frame.edges) - 1))
            values, by_ratio = _step_times(frame, each), False
        else:
            spread = np.geomspace if by_ratio else np.linspace
            pieces = [spread(a, b, max(2, count // len(bands))) for a, b in bands]
            values = np.unique(np.concatenate(pieces)) if pieces else np.zeros(0)
        axes[name] = Axis(values, bands, by_ratio)
    return axes


def _step_times(frame: Frame, count: int) -> FloatArray:
    """Return times inside each block, evenly over its rows."""
    ends = np.searchsorted(frame.rows, frame.edges)
    at = [np.linspace(a, b - 1, count + 2)[1:-1] for a, b in itertools.pairwise(ends) if b > a]
    return np.unique(frame.few.time_s[np.concatenate(at).astype(np.intp)])


def shape_grid(axes: Mapping[str, Axis]) -> list[dict[str, float]]:
    """Return every combination of the values along the axes."""
    points = itertools.product(*(axis.values.tolist() for axis in axes.values()))
    return [dict(zip(axes, values, strict=True)) for values in points]


def _position(frame: Frame, key: str) -> FloatArray:
    """Return what places of lines count on at each drawn sample: turns, or seconds of sampling."""
    if key == "order":
        return frame.few.angle_rad / (2.0 * np.pi)
    # without the pauses at load steps: what they add is tried beside each place
    return np.asarray(frame.rows * float(np.median(np.diff(frame.motion.time_s))))


def _cell(frame: Frame, key: str) -> float:
    """Return the width of a resolution cell: 1 / turns, or 1 / duration."""
    on = frame.few.angle_rad / (2.0 * np.pi) if key == "order" else frame.few.time_s
    return 1.0 / max(float(np.ptp(on)), np.finfo(float).tiny)


def line_spectrum(
    frame: Frame, key: str, top: float, left: FloatArray, kept: slice
) -> tuple[float, FloatArray]:
    """Return the spectrum of an effect over angle or time up to an order or frequency.

    `left` is the effect on the drawn samples less the baseline, weighted, its columns in one sum;
    `kept` are those that are looked at. First comes how many points there are per unit of order or
    frequency, then about the share of the effect that a line at each point holds.
    """
    from scipy.fft import next_fast_len, rfft

    position = _position(frame, key)[kept]
    span = float(np.ptp(position)) if len(position) else 0.0
    if not span > 0.0:
        return 1.0, np.zeros(0)
    position, length = position - position.min(), _PER_CELL * span
    n = next_fast_len(int(np.ceil(max(16.0, 2.0 * top * length))), real=True)
    bins = np.minimum((position * (n / length)).astype(np.intp), n - 1)
    weights = frame.weights[kept]
    # the inverse probability of a row: sums over rows are then those over all samples
    line = rfft(np.bincount(bins, left[kept] * weights, n).astype(np.float32))
    whole = 0.5 * float(np.sum(weights**2)) * float(np.sum(left[kept] ** 2))
    return length, (line.real**2 + line.imag**2) / max(whole, np.finfo(float).tiny)


def line_places(
    cause: Cause, bands: Bounds, length: float, share: FloatArray, most: int
) -> list[float]:
    """Return so many places in bands at which lines, one for every pair of columns, hold most."""
    numbers = (p.name.removeprefix("cosine_").partition("_")[0] for p in cause.linear)
    harmonics = [int(number) for number in numbers if number.isdigit()] or [1]
    ends = [(int(low * length), int(np.ceil(high * length))) for low, high in bands]
    index = np.concatenate([np.arange(a, min(b + 1, len(share))) for a, b in ends])
    if not len(index):
        return []
    padded = np.append(share, 0.0)
    rest = np.sum([padded[np.minimum(h * index, len(share))] for h in harmonics], axis=0)
    reach = int(np.ceil(_APART_CELLS * _PER_CELL))
    places = []
    for _ in range(most):
        at = int(np.argmax(rest))
        if not rest[at] > _LEAST_SHARE:
            break
        places.append(clipped(float(index[at]) / length, bands))
        rest[np.abs(index - index[at]) <= reach] = 0.0
    return places
