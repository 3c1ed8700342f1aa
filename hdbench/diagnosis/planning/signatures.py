"""Effects with their shapes, and the shapes with which a cause may imitate another."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from itertools import pairwise, product

import numpy as np

from hdbench.diagnosis.planning.frame import Bounds, Frame
from hdbench.model import Cause
from hdbench.records.trace import FloatArray

Shape = Mapping[str, float]

_NOMINAL: dict[str, dict[str, float]] = tomllib.loads(
    (resources.files(__package__) / "nominal.toml").read_text(encoding="utf-8")
)
# points of a line's spectrum per resolution cell: between two of them it keeps 81 % of its power
_PER_CELL = 2.0


@dataclass(frozen=True, slots=True)
class Effect:
    """A cause with its shape, and its peak torque, N m, where it is known from a diagnosis."""

    cause: Cause
    shape: Shape
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
        scale = np.log(self.values) if self.by_ratio else self.values
        here = float(np.log(value)) if self.by_ratio else value
        at = int(np.clip(np.searchsorted(scale, here), 1, len(scale) - 1))
        step = float(scale[at] - scale[at - 1]) / 2.0**halvings
        sides = (here - step, here + step)
        return [_clipped(float(np.exp(x)) if self.by_ratio else x, self.bands) for x in sides]


def _clipped(value: float, bands: Bounds) -> float:
    """Return the value of the bands that is nearest."""
    near = [float(np.clip(value, low, high)) for low, high in bands]
    return min(near, key=lambda x: abs(x - value))


def _by_ratio(bands: Bounds) -> bool:
    """Return whether bands that cover a decade are cut in equal ratios, not in equal steps."""
    return bands[0][0] > 0.0 and bands[-1][1] / bands[0][0] >= 10.0


def nominal_shape(cause: Cause) -> dict[str, float]:
    """Return a shape of the literature, else the middle of the domain (of its logarithm)."""
    shape, known = {}, _NOMINAL.get(cause.name, {})
    for parameter in cause.shape:
        bands = parameter.bands or ((parameter.lower, parameter.upper),)
        low, high = bands[0][0], bands[-1][1]
        middle = float(np.sqrt(low * high)) if _by_ratio(bands) else 0.5 * (low + high)
        shape[parameter.name] = _clipped(known.get(parameter.name, middle), bands)
    return shape


def fitted_shape(shape: Shape, bounds: Mapping[str, Bounds], time_s: FloatArray) -> Shape:
    """Return a shape moved into its bounds; a step has a tenth of the times on either side."""
    fitted = {name: _clipped(shape[name], bands) for name, bands in bounds.items()}
    if "step_time_s" in fitted:
        before = float(np.mean(time_s < fitted["step_time_s"]))
        if not 0.1 <= before <= 0.9:
            # where it can be seen, off the middle, where a symmetric run turns round
            fitted["step_time_s"] = float(time_s[int(0.45 * (len(time_s) - 1))])
    return fitted


def shape_axes(cause: Cause, frame: Frame, home: int) -> dict[str, Axis]:
    """Return the grid along each shape parameter; of a line a step of its spectrum."""
    bounds = frame.bounds(cause)
    # points along each shape, for one, two and more shapes together, fewer for causes that need
    # more samples; places in between are tried afterwards
    points = ((25, 7, 3), (13, 5, 3), (9, 3, 3))[home]
    count = points[min(len(bounds), 3) - 1]
    axes = {}
    for name, bands in bounds.items():
        by_ratio = False
        if name == line_key(cause):
            values = np.array([0.0, 1.0 / (_PER_CELL * line_length(frame, name))])
        elif name == "step_time_s":
            values = _step_times(frame, max(5, count // (len(frame.edges) - 1)))
        else:
            by_ratio = _by_ratio(bands)
            spread = np.geomspace if by_ratio else np.linspace
            pieces = [spread(low, high, max(2, count // len(bands))) for low, high in bands]
            values = np.unique(np.concatenate(pieces))
        axes[name] = Axis(values, bands, by_ratio)
    return axes


def _step_times(frame: Frame, count: int) -> FloatArray:
    """Return times inside each block, evenly over its rows: no row is in a change of load."""
    at = [np.linspace(a, b - 1, count + 2)[1:-1] for a, b in pairwise(frame.ends) if b > a]
    return np.unique(frame.few.time_s[np.concatenate(at).astype(np.intp)])


def shape_grid(axes: Mapping[str, Axis]) -> list[Shape]:
    """Return every combination of the values along the axes."""
    points = product(*(axis.values.tolist() for axis in axes.values()))
    return [dict(zip(axes, values, strict=True)) for values in points]


def line_key(cause: Cause) -> str | None:
    """Return ``order`` or ``frequency_hz`` for a cause that is lines at one free place."""
    names = [parameter.name for parameter in cause.shape]
    return names[0] if names in (["order"], ["frequency_hz"]) else None


def line_length(frame: Frame, key: str) -> float:
    """Return the turns, or the time in s, of a motion: one over a line's resolution cell."""
    on = frame.few.angle_rad / (2.0 * np.pi) if key == "order" else frame.few.time_s
    return max(float(np.ptp(on)), np.finfo(float).tiny)


def line_shapes(
    frame: Frame, lines: Mapping[str, Cause], effects: Sequence[Effect]
) -> dict[str, list[Shape]]:
    """Return where lines may imitate effects: on all blocks together and on each."""
    tops: dict[str, float] = {}
    for cause in lines.values():
        for key, bands in frame.bounds(cause).items():
            tops[key] = max(tops.get(key, 0.0), bands[-1][1])
    base: FloatArray = np.zeros((len(frame.rows), 0))
    if frame.noise.is_white:
        base = np.linalg.qr(frame.base.T)[0].astype(np.float64)
    stretches = dict.fromkeys([(0, len(frame.rows)), *pairwise(frame.ends.tolist())])
    # places of lines that are tried for each effect on a motion; one on each of several blocks
    most = 3 if len(stretches) == 1 else 1
    shapes: dict[str, list[Shape]] = {name: [] for name in lines}
    mixed = np.random.default_rng(0)
    for effect in effects:
        rows = frame.drawn(effect.cause, effect.shape)
        # all columns in one sum, each with a weight of its own so that none cancels another
        left = mixed.normal(size=len(rows)) @ rows
        left = left - base @ (base.T @ left)
        spectra = {
            key: [_line_spectrum(frame, key, top, left, slice(*stretch)) for stretch in stretches]
            for key, top in tops.items()
        }
        for name, cause in lines.items():
            if name != effect.name:
                ((key, bands),) = frame.bounds(cause).items()
                here = effect.shape.get(key, np.nan)
                places = [here] if any(low <= here <= high for low, high in bands) else []
                for length, share in spectra[key]:
                    places += _line_places(cause, bands, length, share, most)
                shapes[name] += [{key: place} for place in places]
    return shapes


def _line_spectrum(
    frame: Frame, key: str, top: float, left: FloatArray, kept: slice
) -> tuple[float, FloatArray]:
    """Return points per unit of order or frequency, and the share that a line at each one holds."""
    from scipy.fft import next_fast_len, rfft

    # time without the pauses at load steps: what they add is tried beside each place
    position = frame.rows[kept] * float(np.median(np.diff(frame.motion.time_s)))
    if key == "order":
        position = frame.few.angle_rad[kept] / (2.0 * np.pi)
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


def _line_places(
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
    places = []
    for _ in range(most):
        at = int(np.argmax(rest))
        # what holds less of an effect is told apart anyway
        if not rest[at] > 0.02:
            break
        places.append(_clipped(float(index[at]) / length, bands))
        # places nearer than two cells are sidelobes of one
        rest[np.abs(index - index[at]) <= 2.0 * _PER_CELL] = 0.0
    return places
