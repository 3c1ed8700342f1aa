"""Placement tolerances: one rosette off at a time, and all of them by chance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hdbench.errors import UsageError
from hdbench.gauges.errortable import ErrorTable, OneOff, Scatter
from hdbench.gauges.misplacement import (
    Effects,
    GaugedBench,
    closed_form_ripple,
    placement_effects,
)
from hdbench.gauges.offcentre import off_centre
from hdbench.gauges.quantiles import sample_quantile
from hdbench.gauges.strain import PlacementErrors
from hdbench.gauges.tolerance import Tolerance
from hdbench.records.trace import FloatArray

__all__ = ["EFFECTS", "KINDS", "OFF_CENTRE", "tabulate_errors"]

KINDS = ("radial", "circumferential", "angular")
OFF_CENTRE = "off-centre"
EFFECTS = ("gain_change", "zero_nm", "locked_zero_nm", "ripple_2_nm", "ripple_4_nm")
_SHARES = (0.50, 0.90, 0.95, 0.99)


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
        Assemblies drawn per row, 100 to 1 000 000.
    seed : int
        Seed of the draws.

    Returns
    -------
    ErrorTable
        In place, one rosette off, all off by chance.

    Raises
    ------
    UsageError
        If there are too few or too many draws, or a radial tolerance reaches the axis.
    """
    if not 100 <= draws <= 1_000_000:
        raise UsageError(
            f"{draws} draws; needed: 100, or a 99 % quantile cannot be told, to 1000000",
            where="--draws",
            fix="take 10000",
        )
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
    unit = {kind: _unit_draws(tolerance, rng, (draws, count)) for kind in KINDS}
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
            for kind in (*KINDS, OFF_CENTRE, "all")
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


def _row(effects: Effects, index: int) -> dict[str, float]:
    return {name: float(getattr(effects, name)[index]) for name in EFFECTS}


def _one_off(bench: GaugedBench, tolerance: Tolerance) -> tuple[OneOff, ...]:
    rows = []
    count = len(bench.layout.rosettes)
    for kind in KINDS:
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
    return OneOff(0, OFF_CENTRE, _row(effects, int(np.argmax(effects.ripple_2_nm))), None)


def _chosen(
    tolerance: Tolerance, unit: Mapping[str, FloatArray], shifted: PlacementErrors, kind: str
) -> PlacementErrors:
    """Return the errors of one kind, or of all together."""
    zero = np.zeros_like(shifted.radial_mm)
    parts = [tolerance.of(name) * unit[name] if kind in (name, "all") else zero for name in KINDS]
    if kind in (OFF_CENTRE, "all"):
        whole = (shifted.radial_mm, shifted.circumferential_rad, shifted.angular_rad)
        parts = [own + film for own, film in zip(parts, whole, strict=True)]
    return PlacementErrors(*parts)


def _scatter(bench: GaugedBench, kind: str, errors: PlacementErrors) -> Scatter:
    effects = placement_effects(bench, errors)
    return Scatter(
        kind,
        {
            name: tuple(sample_quantile(np.abs(getattr(effects, name)), share) for share in _SHARES)
            for name in EFFECTS
        },
    )
