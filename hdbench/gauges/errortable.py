"""Error table: what rosettes do that are off, one at a time and all by chance, as data and CSV."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np

from hdbench.errors import UsageError
from hdbench.gauges.layout import cancellation
from hdbench.gauges.misplacement import closed_form_ripple, placement_effects
from hdbench.gauges.strain import GaugedBench, PlacementErrors, off_centre
from hdbench.records import FloatArray
from hdbench.records.csvtext import csv_text
from hdbench.records.quantity import coverage_factor

_KINDS = ("radial", "circumferential", "angular")
_OFF_CENTRE = "off-centre"
_SHARES = (0.50, 0.90, 0.95, 0.99)
_HEAD = ("case", "kind", "rosette", "quantity", "share_below", "value", "low", "high")


@dataclass(frozen=True, slots=True)
class Tolerance:
    """How far a rosette may be from its place.

    Parameters
    ----------
    radial_mm : float
        Along the radius, +- mm.
    circumferential_deg, angular_deg : float
        Along the circumference, and turned about its own centre, +- degrees.
    off_centre_mm : float
        The film with all rosettes on it, from the axis in any direction, mm.
    distribution : {"uniform", "normal"}
        Uniform within the tolerance, or normal with the tolerance as two standard deviations.
    """

    radial_mm: float
    circumferential_deg: float
    angular_deg: float
    off_centre_mm: float = 0.0
    distribution: Literal["uniform", "normal"] = "uniform"

    def of(self, kind: str) -> float:
        """Return the tolerance of one kind: mm, else rad."""
        if kind == "radial":
            return self.radial_mm
        return math.radians(getattr(self, f"{kind}_deg"))


@dataclass(frozen=True, slots=True)
class Quantile:
    """Value below which a share of the draws lies, with a 95 % interval from their number."""

    share: float
    value: float
    low: float
    high: float


def sample_quantile(values: FloatArray, share: float) -> Quantile:
    """Return a quantile of draws and its 95 % interval."""
    ordered = np.sort(values)
    n = len(ordered)
    half = coverage_factor(None) * math.sqrt(n * share * (1.0 - share))
    low = min(max(math.floor(n * share - half) - 1, 0), n - 1)
    high = min(math.ceil(n * share + half), n - 1)
    value = float(np.quantile(ordered, share))
    return Quantile(share, value, float(ordered[low]), float(ordered[high]))


@dataclass(frozen=True, slots=True)
class OneOff:
    """One rosette at the edge of one tolerance (0: all, film off centre), all else in place."""

    rosette: int
    kind: str
    effects: Mapping[str, float]
    closed_form_2_nm: float | None


@dataclass(frozen=True, slots=True)
class Scatter:
    """Quantiles of the size of each effect with all rosettes off by chance."""

    kind: str
    effects: Mapping[str, tuple[Quantile, ...]]


@dataclass(frozen=True, slots=True)
class ErrorTable:
    """What placement does to the torque shown."""

    # flexspline, gauges, sensor
    bench: GaugedBench
    # how far rosettes may be off
    tolerance: Tolerance
    # size and seed of the simulation
    draws: int
    seed: int
    # effects that stay with every rosette in place
    in_place: Mapping[str, float]
    # every rosette and kind in turn
    one_off: tuple[OneOff, ...]
    # each kind alone, then all
    scatter: tuple[Scatter, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the table as ``--json`` prints it."""
        bench = self.bench
        return {
            "layout": {
                "name": bench.layout.name,
                "words": bench.layout.words,
                "rosettes": [asdict(rosette) for rosette in bench.layout.rosettes],
                **asdict(bench.geometry),
            },
            "strain": asdict(bench.field),
            "sensor": bench.sensor.model_dump(),
            "uncancelled_nm": [
                {
                    "order": wave.order,
                    "amplitude_nm": bench.uncancelled_nm(wave),
                    "left_by_layout": cancellation(bench.layout, wave.order),
                }
                for wave in bench.field.waves
            ],
            "tolerance": asdict(self.tolerance),
            "draws": self.draws,
            "seed": self.seed,
            "in_place": dict(self.in_place),
            "one_off": [asdict(row) for row in self.one_off],
            "scatter": [asdict(row) for row in self.scatter],
        }


def tabulate_errors(
    bench: GaugedBench, tolerance: Tolerance, *, draws: int = 10_000, seed: int = 0
) -> ErrorTable:
    """Tabulate what radial, circumferential and angular errors do.

    Parameters
    ----------
    bench : GaugedBench
        Flexspline, gauges, sensor.
    tolerance : Tolerance
        How far rosettes may be off.
    draws : int
        Assemblies drawn per row; with fewer than 100 a 99 % quantile cannot be told.
    seed : int
        Seed of the draws.

    Returns
    -------
    ErrorTable
        In place, one rosette off, all off by chance.

    Raises
    ------
    UsageError
        If a radial tolerance reaches the axis.
    """
    inner = bench.geometry.radius_mm - 0.5 * bench.geometry.spacing_mm
    reach = tolerance.radial_mm + tolerance.off_centre_mm
    if not reach < 0.25 * inner:
        raise UsageError(
            f"radial tolerance and film off centre add up to {reach:g} mm with the inner grids at "
            f"{inner:g} mm; needed: less than a quarter of that radius",
            where="--radial",
            fix="give a smaller tolerance or a larger --radius",
        )
    count = len(bench.layout.rosettes)
    placed = placement_effects(bench, PlacementErrors.none(1, count))
    rng = np.random.default_rng(seed)
    unit = {kind: _unit_draws(tolerance, rng, (draws, count)) for kind in _KINDS}
    shifted = _shifted(bench, tolerance, rng, draws)
    return ErrorTable(
        bench,
        tolerance,
        draws,
        seed,
        _row(placed, 0),
        (*_one_off(bench, tolerance), _film_off(bench, tolerance)),
        tuple(
            _scatter(bench, kind, _chosen(tolerance, unit, shifted, kind))
            for kind in (*_KINDS, _OFF_CENTRE, "all")
        ),
    )


def _unit_draws(
    tolerance: Tolerance, rng: np.random.Generator, shape: tuple[int, int]
) -> FloatArray:
    """Return draws for a tolerance of 1."""
    if tolerance.distribution == "normal":
        # beyond four standard deviations nobody would leave a rosette where it is
        return np.clip(0.5 * rng.standard_normal(shape), -2.0, 2.0)
    return rng.uniform(-1.0, 1.0, shape)


def _shifted(
    bench: GaugedBench, tolerance: Tolerance, rng: np.random.Generator, draws: int
) -> PlacementErrors:
    """Return films off centre: uniform over a disc, or normal in both directions."""
    if tolerance.distribution == "normal":
        x, y = np.clip(0.5 * rng.standard_normal((2, draws)), -2.0, 2.0)
        shift, towards = np.hypot(x, y), np.arctan2(y, x)
    else:
        shift, towards = np.sqrt(rng.uniform(size=draws)), rng.uniform(0.0, 2.0 * np.pi, draws)
    return off_centre(bench.layout, bench.geometry, tolerance.off_centre_mm * shift, towards)


def _row(effects: Mapping[str, FloatArray], index: int) -> dict[str, float]:
    return {name: float(values[index]) for name, values in effects.items()}


def _one_off(bench: GaugedBench, tolerance: Tolerance) -> tuple[OneOff, ...]:
    rows = []
    count = len(bench.layout.rosettes)
    for kind in _KINDS:
        size = tolerance.of(kind)
        parts = {f"{kind}_{'mm' if kind == 'radial' else 'rad'}": size * np.eye(count)}
        effects = placement_effects(bench, replace(PlacementErrors.none(count, count), **parts))
        for index, rosette in enumerate(bench.layout.rosettes):
            closed = None
            if kind == "circumferential":
                closed = closed_form_ripple(bench, bench.field.waves[0], size)
            rows.append(OneOff(rosette.number, kind, _row(effects, index), closed))
    return tuple(rows)


def _film_off(bench: GaugedBench, tolerance: Tolerance) -> OneOff:
    """Return the worst of 24 directions in which the film may be off, by its ripple at order 2."""
    towards: FloatArray = np.arange(24, dtype=np.float64) * (2.0 * np.pi / 24)
    shift = np.full(24, tolerance.off_centre_mm)
    effects = placement_effects(bench, off_centre(bench.layout, bench.geometry, shift, towards))
    return OneOff(0, _OFF_CENTRE, _row(effects, int(np.argmax(effects["ripple_2_nm"]))), None)


def _chosen(
    tolerance: Tolerance, unit: Mapping[str, FloatArray], shifted: PlacementErrors, kind: str
) -> PlacementErrors:
    """Return the errors of one kind, or of all together."""
    zero = np.zeros_like(shifted.radial_mm)
    parts = [tolerance.of(name) * unit[name] if kind in (name, "all") else zero for name in _KINDS]
    if kind in (_OFF_CENTRE, "all"):
        whole = (shifted.radial_mm, shifted.circumferential_rad, shifted.angular_rad)
        parts = [own + film for own, film in zip(parts, whole, strict=True)]
    return PlacementErrors(*parts)


def _scatter(bench: GaugedBench, kind: str, errors: PlacementErrors) -> Scatter:
    effects = placement_effects(bench, errors)
    return Scatter(
        kind,
        {
            name: tuple(sample_quantile(np.abs(values), share) for share in _SHARES)
            for name, values in effects.items()
        },
    )


def table_as_csv(table: ErrorTable) -> str:
    """Return the table as CSV, one number per row.

    Parameters
    ----------
    table : ErrorTable
        What `tabulate_errors` found.

    Returns
    -------
    str
        Columns case, kind, rosette, quantity, share_below, value, low, high; units as in
        `placement_effects`.
    """
    return csv_text(_HEAD, _rows(table))


def _rows(table: ErrorTable) -> Iterator[tuple[object, ...]]:
    for name, value in table.in_place.items():
        yield "in-place", "none", "", name, "", value, "", ""
    for one in table.one_off:
        for name, value in one.effects.items():
            yield "one-off", one.kind, one.rosette, name, "", value, "", ""
    for scatter in table.scatter:
        for name, quantiles in scatter.effects.items():
            for q in quantiles:
                yield "scatter", scatter.kind, "", name, q.share, q.value, q.low, q.high
