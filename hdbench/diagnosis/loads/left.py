"""What is left of the readings without a name: places that stand apart."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.loads.families import Cell, Family
from hdbench.diagnosis.loads.fit import LoadFit
from hdbench.diagnosis.loads.heldout import levels
from hdbench.diagnosis.loads.null import FamilyLook, look_at_families
from hdbench.diagnosis.loads.space import Space, make_space
from hdbench.diagnosis.loads.table import LoadTable
from hdbench.model import Cause, Motion
from hdbench.records.trace import FloatArray

__all__ = ["Left", "challenge_loads"]

_MOST = 3
# time is looked at in stretches of this many readings
_STRETCH = 4

IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Left:
    """A place in the residual of readings.

    Parameters
    ----------
    domain : str
        ``torque``, ``time`` or ``variance``.
    location : float
        Centre.
    extent : tuple of float
        Ends.
    unit : str
        Unit of the place.
    size_nm : float
        Size, N m.
    variance_nm2 : float
        Mean square over all readings that it explains, (N m)^2.
    false_alarm : float
        Probability of such a place by noise.
    """

    domain: str
    location: float
    extent: tuple[float, float]
    unit: str
    size_nm: float
    variance_nm2: float
    false_alarm: float


def _nameless(name: str, columns: Callable[[Motion, Mapping[str, float]], FloatArray]) -> Cause:
    return Cause(name, "", (), (), "", "", "", (), "", "", columns, False)


def _family(name: str, blocks: list[FloatArray], space: Space) -> Family | None:
    """Return a family of places, one for each block of columns."""
    cause = _nameless(name, lambda motion, shape: np.zeros((len(motion), 0)))
    cells = []
    for index, block in enumerate(blocks):
        directions = space.directions(block)
        if 0 < directions.shape[1] < space.dof:
            cells.append(Cell(Term(cause, {"place": float(index)}), directions))
    return Family(name, tuple(cells)) if cells else None


def _members(numbers: IntArray) -> list[FloatArray]:
    return [np.asarray(numbers == k, dtype=np.float64)[:, None] for k in np.unique(numbers)]


def _blocks(table: LoadTable) -> dict[str, list[FloatArray]]:
    """Return the columns of every place that is looked at, by kind."""
    level = levels(table)
    torque, time = table.torque_nm, table.motion.time_s
    branch = 2 * level + table.falling
    curve = [torque[:, None] ** np.arange(2, 6) / float(np.abs(torque).max()) ** np.arange(1, 5)]
    inside = _members(table.experiment)
    drift = [np.where(one > 0.0, time[:, None], 0.0) for one in inside]
    stretch = np.arange(len(table)) // _STRETCH
    return {
        "level": _members(level),
        "branch": _members(branch),
        "curve": curve,
        "gain": [one * torque[:, None] for one in inside],
        "drift": drift,
        "stretch": _members(stretch),
    }


def challenge_loads(
    fit: LoadFit, space: Space, alpha: float, rng: np.random.Generator
) -> tuple[Left, ...]:
    """Return the places of the residual that noise does not make, strongest first.

    Parameters
    ----------
    fit : LoadFit
        Fit with all causes.
    space : Space
        What it leaves.
    alpha : float
        Probability of any place on readings without an effect.
    rng : Generator
        For the draws of the null.

    Returns
    -------
    tuple of Left
        At most three beside a scatter that changes with the torque.

    Notes
    -----
    Looked at: each load level, each level of each branch, a curve over the torque (powers 2 to 5),
    a gain and a drift of each experiment's own, stretches of four readings; and how the scatter
    goes with the size of the torque. The null is that of the named families.
    """
    table = fit.table
    found: list[Left] = []
    explained = fit.explained
    blocks = _blocks(table)
    for _ in range(_MOST):
        if space.dof < 2:
            return tuple(found)
        families = [f for name, b in blocks.items() if (f := _family(name, b, space)) is not None]
        looks = look_at_families(space, families, rng)
        alarms = [look for look in looks if look.false_alarm < 0.5 * alpha]
        if not alarms:
            break
        best = min(alarms, key=lambda look: look.p_value)
        block = blocks[best.family.name][int(best.cell.term.shape["place"])]
        found.append(_place(best, block, fit, space))
        explained = np.hstack([explained, block])
        space = make_space(explained, table.reading_v, table.used)
    uneven = _uneven_scatter(fit, space, 0.5 * alpha, rng)
    return (*found, *uneven)


def _place(look: FamilyLook, block: FloatArray, fit: LoadFit, space: Space) -> Left:
    table = fit.table
    along = look.cell.directions @ (look.cell.directions.T @ space.residual_v)
    effect = np.abs(space.basis @ along) / abs(fit.slope_v_per_nm)
    variance = float(along @ along) / int(table.used.sum()) / fit.slope_v_per_nm**2
    touched = np.any(block != 0.0, axis=1)
    time_like = look.family.name in ("drift", "stretch")
    if time_like:
        axis = table.motion.time_s[touched]
        unit = "s" if table.time_measured else "reading"
    else:
        axis, unit = table.torque_nm[touched], "N m"
    extent = (float(axis.min()), float(axis.max()))
    centre = 0.5 * (extent[0] + extent[1])
    if look.family.name in ("curve", "gain"):
        centre = float(axis[int(np.argmax(np.abs(axis)))])
    domain = "time" if time_like else "torque"
    chance = look.false_alarm
    return Left(domain, centre, extent, unit, float(effect.max()), variance, chance)


def _uneven_scatter(
    fit: LoadFit, space: Space, alpha: float, rng: np.random.Generator
) -> tuple[Left, ...]:
    """Return the scatter's change with the torque where noise of one size does not make it."""
    from scipy.special import ndtr

    used = fit.table.used
    size = np.abs(fit.table.torque_nm[used])
    if space.dof < 2 or not float(np.ptp(size)) > 0.0:
        return ()
    weight = (size - size.mean()) / float(np.abs(size - size.mean()).max())

    def trend(left: FloatArray) -> FloatArray:
        square = (space.basis @ left) ** 2
        return np.asarray(weight @ square / square.sum(axis=0))

    drawn = trend(rng.standard_normal((space.dof, 2000)))
    seen = float(trend(space.residual_v[:, None])[0])
    # the law of the trend leans to one side: its logarithmic odds are nearer to normal
    odds = np.log1p(drawn) - np.log1p(-drawn)
    place = (np.log1p(seen) - np.log1p(-seen) - odds.mean()) / odds.std()
    # two sides, and twice that: beyond 1e-3 the odds lie up to 1.7 times as often as a normal value
    chance = min(1.0, float(4.0 * ndtr(-abs(place))))
    if not chance < alpha:
        return ()
    left = (space.basis @ space.residual_v) / fit.slope_v_per_nm
    heavy = size >= np.median(size)
    where = size[heavy] if place > 0.0 else size[~heavy]
    chosen = heavy if place > 0.0 else ~heavy
    spread = float(np.sqrt(np.mean(left[chosen] ** 2)))
    extent = (float(where.min()), float(where.max()))
    share = float(np.sum(left[chosen] ** 2) / len(left))
    return (Left("variance", 0.5 * sum(extent), extent, "N m", spread, share, chance),)
