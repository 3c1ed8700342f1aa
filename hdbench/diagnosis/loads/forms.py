"""Forms of causes on standing readings, and places that have no name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from hdbench.diagnosis.loads.table import IntArray, LoadTable, levels, one_hot
from hdbench.model import Cause, Motion, Parameter, catalogue, shape_bounds
from hdbench.model.statics import preloaded_motion
from hdbench.records.trace import FloatArray

Columns = Callable[[Motion, Mapping[str, float]], FloatArray]

# names that static readings can show; what moves, sounds or turns the motor is not among them
NAMES = (
    "cubic-nonlinearity", "hysteresis", "backlash", "saturation", "arm-sag",
    "direction-asymmetry", "side-force", "position-dependent-gain", "creep", "zero-step",
    "zero-drift", "warm-up",
)  # fmt: skip
# shape parameters that have values but no slope
_DISCRETE = ("step_time_s", "place")


@dataclass(frozen=True, slots=True)
class Form:
    """One form in which a cause is looked for."""

    cause: Cause
    columns: Columns  # for `parameters`, then `beside`
    parameters: tuple[Parameter, ...]  # linear ones
    label: str = ""  # empty for the catalogue's own
    fixed: Mapping[str, float] = field(default_factory=dict)  # shapes that it holds
    beside: tuple[Cause, ...] = ()  # causes that go with it, never positive
    prior_nats: float = 0.0  # what it costs beside its parameters
    places: Sequence[int] = ()  # values of the shape ``place``

    @property
    def name(self) -> str:
        """Name of the cause."""
        return self.cause.name

    @property
    def whole(self) -> bool:
        """Whether its share is 1: it takes all of what is beyond or inside its shape."""
        return self.name in ("saturation", "backlash")

    @property
    def shape(self) -> tuple[Parameter, ...]:
        """Shape parameters that are free."""
        return tuple(p for p in self.cause.shape if p.name not in self.fixed)

    @property
    def smooth(self) -> tuple[Parameter, ...]:
        """Free shape parameters that have a slope."""
        return tuple(p for p in self.shape if p.name not in _DISCRETE)

    def grid(self, table: LoadTable) -> list[Term]:
        """Return the members of the family on these readings."""
        # so fine that neighbours are alike
        points = 24 if len(self.smooth) < 2 else 10
        axes = [self._axis(p, table, points) for p in self.shape]
        names = [p.name for p in self.shape]
        return [Term(self, dict(zip(names, map(float, v), strict=True))) for v in product(*axes)]

    def _axis(self, parameter: Parameter, table: LoadTable, points: int) -> Sequence[float]:
        if parameter.name == "place":
            return self.places
        if parameter.name == "step_time_s":
            time = np.unique(table.motion.time_s)
            return list(0.5 * (time[1:] + time[:-1]))
        values: list[float] = []
        for low, high in self.bounds(parameter, table):
            # bounds further apart than this ratio are stepped in equal ratios
            wide = low > 0.0 and high > 5.0 * low
            values += list((np.geomspace if wide else np.linspace)(low, high, points))
        return values

    def bounds(self, parameter: Parameter, table: LoadTable) -> list[tuple[float, float]]:
        """Return the bands of a smooth shape parameter on these readings."""
        # beyond twice the largest torque and ten times the record nothing of a shape is left to
        # see; a limit of less than half of the torque is a gain, one of 30 times takes a thousandth
        top = table.top_nm
        if parameter.name == "limit_nm":
            bands: Sequence[tuple[float, float]] = ((parameter.lower, parameter.upper),)
            least, most = 0.5 * top, 30.0 * top
        else:
            bands = shape_bounds(self.cause, table.motion)[parameter.name]
            span = float(np.ptp(table.motion.time_s))
            ends = {"N m": (0.0, 2.0 * top), "s": (0.0, 10.0 * span)}
            least, most = ends.get(parameter.unit, (-np.inf, np.inf))
        cut = [(max(low, least), min(high, most)) for low, high in bands]
        return [(low, high) for low, high in cut if low < high]


@dataclass(frozen=True, slots=True)
class Term:
    """A form with its shape, as it stands in a fit; `known` where the given model held it."""

    form: Form
    shape: Mapping[str, float]
    known: bool = False

    @property
    def name(self) -> str:
        """Name of the cause."""
        return self.form.name

    @property
    def unnamed(self) -> bool:
        """Whether it is a place without a name."""
        return "place" in self.shape

    def neighbours(self) -> list[Term]:
        """Return the term at other values of each smooth shape parameter, held ones too."""
        held = {**self.shape, **self.form.fixed}
        # other values of a shape beside a fitted one, as its ratios
        return [
            Term(self.form, {**self.shape, p.name: held[p.name] * ratio})
            for p in self.form.cause.shape
            if p.name not in _DISCRETE
            for ratio in (0.35, 0.6, 1.6, 3.0)
            if p.contains(held[p.name] * ratio)
        ]

    def columns(self, table: LoadTable) -> FloatArray:
        """Return N m per unit of each linear parameter, shape (n_readings, n_linear)."""
        shape = {**self.form.fixed, **self.shape}
        return np.asarray(self.form.columns(table.motion, shape), dtype=np.float64)


def load_forms(table: LoadTable, extra: Sequence[Cause]) -> tuple[Form, ...]:
    """Return every form in which these readings are searched, causes of the user's own last."""
    known = catalogue()
    chosen = [form for name in NAMES for form in _forms(known[name], known)]
    chosen += [Form(cause, cause.columns, cause.linear) for cause in extra if cause.additive]
    return tuple(form for form in chosen if form.cause.applicable(table.motion) is None)


def form_named(cause: Cause, label: str, shape: Mapping[str, float]) -> Form:
    """Return the form in which a model file holds a cause."""
    if cause.name == "hysteresis":
        forms = _forms(cause, catalogue())
        return next((form for form in forms if form.label == label), forms[0])
    held = {name: value for name, value in shape.items() if name == "sharpness"}
    return Form(cause, cause.columns, cause.linear, label, held)


def _forms(cause: Cause, known: Mapping[str, Cause]) -> tuple[Form, ...]:
    """Return the forms in which a cause is looked for: variants of some, any other as it is."""
    own = Form(cause, cause.columns, cause.linear)
    if cause.name == "hysteresis":
        loop = _part(cause, slice(1))
        after = replace(loop, columns=_preloaded(loop.columns), label="after a preload")
        sided = (
            replace(after, columns=_branch(after.columns, falling), label=f"{after.label}, {words}")
            for falling, words in ((True, "loading straight"), (False, "unloading straight"))
        )
        return loop, after, *sided
    if cause.name == "saturation":
        # readings at a few levels do not give a sharpness of their own: the limiter is tanh itself,
        # has a knee, is within 2 % of a hard stop, or is one; tanh far above the torque bends as a
        # cube: at 1 nat less the cube is the name
        return tuple(
            replace(own, label=label, fixed={"sharpness": power}, prior_nats=nats)
            for label, power, nats in (
                ("", 1.0, 1.0),
                ("with a knee", 2.0, 0.0),
                ("with a sharp knee", 6.0, 0.0),
                ("with a hard stop", 64.0, 0.0),
            )
        )
    if cause.name == "position-dependent-gain":
        return _part(cause, slice(2)), _part(cause, slice(2, 4)), own
    if cause.name == "arm-sag":
        level, cube = _part(cause, slice(1)), known["cubic-nonlinearity"]

        def bent(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
            return np.hstack((level.columns(motion, shape), cube.columns(motion, {})))

        # an arm that bends so far that it loses lever arm is one in twenty that sag
        return level, own, replace(level, columns=bent, beside=(cube,), prior_nats=3.0)
    return (own,)


def _part(cause: Cause, which: slice) -> Form:
    """Return the form of a cause with some of its linear parameters."""

    def columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        return cause.columns(motion, shape)[:, which]

    return Form(cause, columns, cause.linear[which])


def _preloaded(columns: Columns) -> Columns:
    def after(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        longer, readings = preloaded_motion(motion)
        return columns(longer, shape)[readings]

    return after


def _branch(columns: Columns, falling: bool) -> Columns:
    """Return twice a loop's distance from its chord on one branch, zero on the other."""

    def one(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        loop, size = columns(motion, shape)[:, 0], np.abs(motion.applied_nm)
        starts = np.arange(len(motion)) == 0 if motion.starts is None else motion.starts
        number, first = np.cumsum(starts) - 1, np.flatnonzero(starts)
        signs = np.sign(motion.applied_nm)
        turns = np.minimum.reduceat(signs, first) * np.maximum.reduceat(signs, first) < 0.0
        least, most = np.minimum.reduceat(size, first), np.maximum.reduceat(size, first)

        def mean_at(load: FloatArray) -> FloatArray:
            there = (size == load[number]).astype(float)
            return np.asarray(np.bincount(number, loop * there) / np.bincount(number, there))

        low, width = mean_at(least), np.where(most > least, most - least, np.inf)
        slope = (mean_at(most) - low) / width
        chord = low[number] + slope[number] * (size - least[number])
        change = np.where(starts, 0.0, np.diff(size, prepend=size[0]))
        # a load that is read twice belongs to the branch before
        at = np.maximum.accumulate(np.where(starts | (change != 0.0), np.arange(len(size)), 0))
        inside = ((change[at] < 0.0) == falling) & (~turns & (most > least))[number]
        return np.where(inside, 2.0 * (loop - chord), 0.0)[:, None]

    return one


def _place(name: str, blocks: Mapping[int, FloatArray]) -> Form:
    """Return places of one kind: one block of columns for each value of ``place``."""
    which = Parameter("place", "1", 0.0, 1e9, "index of the place")
    size = Parameter("offset_nm", "N m", -np.inf, np.inf, "size")
    sizes = (size,) * next(iter(blocks.values())).shape[1]

    def columns(_motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        return blocks[round(shape["place"])]

    cause = Cause(name, "", (which,), sizes, "", "", "", (), "", "", columns, False)
    return Form(cause, columns, sizes, places=tuple(blocks))


def outliers(table: LoadTable) -> Form:
    """Return every used reading as one that stands apart."""
    apart = np.eye(len(table))
    return _place("outlier", {int(i): apart[:, [i]] for i in np.flatnonzero(table.used)})


def places(table: LoadTable) -> tuple[Form, ...]:
    """Return the places without a name: levels, branches, a curve, gains, drifts and stretches."""
    level, torque = levels(table), table.torque_nm

    def each(numbers: IntArray, values: FloatArray | float = 1.0) -> dict[int, FloatArray]:
        columns = (one_hot(numbers).T * values).T
        return {i: columns[:, [i]] for i in range(columns.shape[1])}

    # time is looked at in stretches of this many readings
    return (
        _place("level", each(level)),
        _place("branch", each(2 * level + table.falling)),
        _place("curve", {0: torque[:, None] ** np.arange(2, 6) / table.top_nm ** np.arange(1, 5)}),
        _place("gain", each(table.experiment, torque)),
        _place("drift", each(table.experiment, table.motion.time_s)),
        _place("stretch", each(np.arange(len(table)) // 4)),
    )
