"""Forms of causes on standing readings, and places that have no name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.loads.table import LoadTable, levels
from hdbench.model import Cause, Motion, Parameter, catalogue, shape_bounds
from hdbench.model.statics import preloaded_motion
from hdbench.records.trace import FloatArray

__all__ = ["DISCRETE", "NAMES", "Form", "Term", "form_named", "load_forms", "outliers", "places"]

Columns = Callable[[Motion, Mapping[str, float]], FloatArray]

# names that static readings can show; what moves, sounds or turns the motor is not among them
NAMES = (
    "cubic-nonlinearity", "hysteresis", "backlash", "saturation", "arm-sag",
    "direction-asymmetry", "side-force", "position-dependent-gain", "creep", "zero-step",
    "zero-drift", "warm-up",
)  # fmt: skip
# shape parameters that have values but no slope
DISCRETE = ("step_time_s", "place")
# readings at a few levels do not give a sharpness of their own: the limiter is tanh itself, has a
# knee, is within 2 % of a hard stop, or is one
_SHARPNESS = {"": 1.0, "with a knee": 2.0, "with a sharp knee": 6.0, "with a hard stop": 64.0}
# points of a grid over one shape parameter, and over each of more: neighbours are alike
_POINTS, _POINTS_OF_TWO = 24, 10
# bounds further apart than this ratio are stepped in equal ratios
_WIDE = 5.0
# other values of a shape beside a fitted one, as its ratios
_RATIOS = (0.35, 0.6, 1.6, 3.0)
# an arm that bends so far that it loses lever arm is one in twenty that sag
_RARE_NATS = 3.0
# a soft limit far above the torque bends as a cube: at this much less the cube is the name
_SOFT_NATS = 1.0
# time is looked at in stretches of this many readings
_STRETCH = 4


@dataclass(frozen=True, slots=True)
class Form:
    """One form in which a cause is looked for."""

    cause: Cause
    columns: Columns  # for `linear` of the cause, then `beside`
    linear: tuple[int, ...]
    label: str = ""  # empty for the catalogue's own
    fixed: Mapping[str, float] = field(default_factory=dict)  # shapes that it holds
    whole: bool = False  # its share is 1
    beside: tuple[Cause, ...] = ()  # causes that go with it, never positive
    axes: Mapping[str, FloatArray] = field(default_factory=dict)  # values of discrete shapes

    @property
    def name(self) -> str:
        """Name of the cause."""
        return self.cause.name

    @property
    def prior_nats(self) -> float:
        """What this form costs beside its parameters."""
        if self.beside:
            return _RARE_NATS
        return _SOFT_NATS if self.fixed.get("sharpness") == 1.0 else 0.0

    @property
    def shape(self) -> tuple[Parameter, ...]:
        """Shape parameters that are free."""
        return tuple(p for p in self.cause.shape if p.name not in self.fixed)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Linear parameters."""
        return tuple(self.cause.linear[i] for i in self.linear)

    @property
    def discrete(self) -> int:
        """Shape parameters without a slope."""
        return sum(p.name in DISCRETE for p in self.shape)

    def grid(self, table: LoadTable) -> list[Term]:
        """Return the members of the family on these readings."""
        smooth = sum(p.name not in DISCRETE for p in self.shape)
        points = _POINTS if smooth < 2 else _POINTS_OF_TWO
        axes = [self._axis(p, table, points) for p in self.shape]
        names = [p.name for p in self.shape]
        return [Term(self, dict(zip(names, map(float, v), strict=True))) for v in product(*axes)]

    def _axis(self, parameter: Parameter, table: LoadTable, points: int) -> FloatArray:
        if parameter.name in self.axes:
            return self.axes[parameter.name]
        if parameter.name == "step_time_s":
            time = np.unique(table.motion.time_s)
            return np.asarray(0.5 * (time[1:] + time[:-1]))
        parts = []
        for low, high in self.bounds(parameter, table):
            wide = low > 0.0 and high > _WIDE * low
            parts.append((np.geomspace if wide else np.linspace)(low, high, points))
        return np.concatenate(parts) if parts else np.zeros(0)

    def bounds(self, parameter: Parameter, table: LoadTable) -> list[tuple[float, float]]:
        """Return the bands of a smooth shape parameter on these readings.

        Beyond twice the largest torque and ten times the record nothing of a shape is left to see;
        a limit of less than half of the torque is a gain, one of 30 times takes a thousandth.
        """
        top, span = table.top_nm, float(np.ptp(table.motion.time_s))
        least, most = {"N m": (0.0, 2.0 * top), "s": (0.0, 10.0 * span)}.get(
            parameter.unit, (-np.inf, np.inf)
        )
        if parameter.name == "limit_nm":
            bands: Sequence[tuple[float, float]] = ((parameter.lower, parameter.upper),)
            least, most = 0.5 * top, 30.0 * top
        else:
            bands = shape_bounds(self.cause, table.motion)[parameter.name]
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

    def neighbours(self) -> list[Term]:
        """Return the term at other values of each smooth shape parameter."""
        moved = []
        for p in self.form.cause.shape:
            if p.name in DISCRETE:
                continue
            values = ({**self.shape, **self.form.fixed}[p.name] * ratio for ratio in _RATIOS)
            inside = (value for value in values if p.contains(value))
            moved += [Term(self.form, {**self.shape, p.name: value}) for value in inside]
        return moved

    def columns(self, table: LoadTable) -> FloatArray:
        """Return N m per unit of each linear parameter, shape (n_readings, n_linear)."""
        shape = {**self.form.fixed, **self.shape}
        return np.asarray(self.form.columns(table.motion, shape), dtype=np.float64)


def _part(columns: Columns, index: Sequence[int]) -> Columns:
    return lambda motion, shape: columns(motion, shape)[:, index]


def _forms(cause: Cause, beside: Mapping[str, Cause]) -> tuple[Form, ...]:
    """Return the forms in which a cause is looked for.

    Hysteresis from rest, after a preload, and then with one branch straight, as where a gain was
    set by the readings of the other; its second column is a gain, which readings have anyway.
    Saturation of four sharpnesses. A gain with its first harmonic over the position, its second or
    both. An arm that sags without and with a tilt under no load, and one that bends so far that it
    loses lever arm: a cube that is never positive. Any other cause as it is.
    """
    every = tuple(range(len(cause.linear)))
    own = Form(cause, cause.columns, every, whole=cause.name in ("saturation", "backlash"))
    if cause.name == "hysteresis":
        loop = _part(cause.columns, (0,))
        after = _preloaded(loop)
        labels = {"after a preload, loading straight": True}
        labels["after a preload, unloading straight"] = False
        sided = (Form(cause, _one_sided(after, down), (0,), k) for k, down in labels.items())
        return (Form(cause, loop, (0,)), Form(cause, after, (0,), "after a preload"), *sided)
    if cause.name == "saturation":
        return tuple(
            Form(cause, cause.columns, every, label, {"sharpness": power}, whole=True)
            for label, power in _SHARPNESS.items()
        )
    if cause.name == "position-dependent-gain":
        return (*(Form(cause, _part(cause.columns, i), i) for i in ((0, 1), (2, 3))), own)
    if cause.name == "arm-sag":
        level, cube = _part(cause.columns, (0,)), beside["cubic-nonlinearity"]

        def bent(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
            return np.hstack((level(motion, shape), cube.columns(motion, {})))

        return (Form(cause, level, (0,)), own, Form(cause, bent, (0,), beside=(cube,)))
    return (own,)


def load_forms(table: LoadTable, extra: Sequence[Cause]) -> tuple[Form, ...]:
    """Return every form in which these readings are searched, causes of the user's own last."""
    known = catalogue()
    chosen = [form for name in NAMES for form in _forms(known[name], known)]
    chosen += [Form(c, c.columns, tuple(range(len(c.linear)))) for c in extra if c.additive]
    return tuple(form for form in chosen if form.cause.applicable(table.motion) is None)


def form_named(cause: Cause, label: str, shape: Mapping[str, float]) -> Form:
    """Return the form in which a model file holds a cause."""
    if cause.name == "hysteresis":
        forms = _forms(cause, catalogue())
        return next((form for form in forms if form.label == label), forms[0])
    held = {name: value for name, value in shape.items() if name == "sharpness"}
    whole = cause.name in ("saturation", "backlash")
    return Form(cause, cause.columns, tuple(range(len(cause.linear))), label, held, whole)


def _place(name: str, blocks: Sequence[FloatArray]) -> Form:
    """Return places of one kind: one block of columns for each value of ``place``."""
    width = blocks[0].shape[1]
    which = Parameter("place", "1", 0.0, 1e9, "index of the place")
    sizes = tuple(Parameter("offset_nm", "N m", -np.inf, np.inf, "size") for _ in range(width))

    def columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        return blocks[round(shape["place"])]

    cause = Cause(name, "", (which,), sizes, "", "", "", (), "", "", columns, False)
    axes = {"place": np.arange(len(blocks), dtype=np.float64)}
    return Form(cause, columns, tuple(range(width)), axes=axes)


def outliers(table: LoadTable) -> Form:
    """Return every used reading as one that stands apart."""
    form = _place("outlier", list(np.eye(len(table))[:, :, None]))
    return Form(
        form.cause, form.columns, form.linear,
        axes={"place": np.flatnonzero(table.used).astype(np.float64)},
    )  # fmt: skip


def _members(numbers: NDArray[np.int64]) -> list[FloatArray]:
    return [np.asarray(numbers == k, dtype=np.float64)[:, None] for k in np.unique(numbers)]


def places(table: LoadTable) -> tuple[Form, ...]:
    """Return the places without a name.

    Each load level, each level of each branch, a curve over the torque (powers 2 to 5), a gain and
    a drift of each experiment, stretches of four readings.
    """
    level, torque = levels(table), table.torque_nm
    inside = _members(table.experiment)
    blocks = {
        "level": _members(level),
        "branch": _members(2 * level + table.falling),
        "curve": [torque[:, None] ** np.arange(2, 6) / table.top_nm ** np.arange(1, 5)],
        "gain": [one * torque[:, None] for one in inside],
        "drift": [np.where(one > 0.0, table.motion.time_s[:, None], 0.0) for one in inside],
        "stretch": _members(np.arange(len(table)) // _STRETCH),
    }
    return tuple(_place(name, some) for name, some in blocks.items())


def _preloaded(columns: Columns) -> Columns:
    def after(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        longer, readings = preloaded_motion(motion)
        return columns(longer, shape)[readings]

    return after


def _one_sided(columns: Columns, falling: bool) -> Columns:
    """Return the columns of a loop whose `falling` branch, or the other, holds all of it."""

    def one(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        torque = motion.applied_nm
        begun = np.zeros(len(motion), dtype=bool) if motion.starts is None else motion.starts
        ends = np.flatnonzero(begun[1:]) + 1
        parts = zip(
            np.split(columns(motion, shape)[:, 0], ends), np.split(torque, ends), strict=True
        )
        return np.concatenate([_branch(loop, load, falling) for loop, load in parts])[:, None]

    return one


def _branch(loop: FloatArray, torque: FloatArray, falling: bool) -> FloatArray:
    """Return twice the distance of one branch of an experiment from the chord of its loop.

    Zero where the torque changes its sign: there the loop has no such chord.
    """
    size = np.abs(torque)
    least, most = float(size.min()), float(size.max())
    if not most > least or float(torque.min()) * float(torque.max()) < 0.0:
        return np.zeros(len(loop))
    low, high = (float(loop[size == end].mean()) for end in (least, most))
    chord = low + (high - low) / (most - least) * (size - least)
    change = np.diff(size, prepend=size[0])
    # a load that is read twice belongs to the branch before
    at = np.maximum.accumulate(np.where(change != 0.0, np.arange(len(size)), 0))
    return np.asarray(np.where((change[at] < 0.0) == falling, 2.0 * (loop - chord), 0.0))
