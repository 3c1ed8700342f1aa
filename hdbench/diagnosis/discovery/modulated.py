"""Modulated lines: motor orders whose amplitude and phase follow another axis."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.discovery.chance import chi2_tail
from hdbench.diagnosis.discovery.dictionary import Look
from hdbench.diagnosis.discovery.fit import Fit
from hdbench.diagnosis.discovery.lines import Scan, line_norms
from hdbench.diagnosis.discovery.stack import glances
from hdbench.diagnosis.discovery.tables import TABLE, Axis, Table, axes_of
from hdbench.diagnosis.discovery.term import Term
from hdbench.diagnosis.evidence import SAME_SPACE, scaled
from hdbench.model import Cause, Motion, Parameter
from hdbench.records.trace import FloatArray

# knots over the other axis, and over a turn, where an envelope may have several waves
_KNOTS, _TURN_KNOTS = 5, 24


def modulated_looks(fit: Fit, scans: tuple[Scan, ...]) -> list[Look]:
    """Return, for each axis, the motor order that explains most with an envelope over it.

    None in a stack of records, each of which has an axis of its own.
    """
    scan = next((s for s in scans if s.domain == "motor-order"), None)
    if scan is None or scan.parts:
        return []
    (glance,) = glances(fit)
    weighted = fit.bands.inverse(glance.residual * fit.bands.spread(1.0 / glance.noise))
    weighted = np.where(fit.record.valid, weighted, 0.0)
    axes = axes_of(fit.record)
    found = []
    for axis in axes:
        count = _TURN_KNOTS if axis.period else _KNOTS
        hats = axis.hats(count)
        waves = np.stack([scan.transform(weighted * hat) for hat in hats.T])
        mixes = [*axis.levels(count), np.eye(hats.shape[1])]
        envelopes = [hats @ mix for mix in mixes]
        norms = line_norms(glance, scan, np.hstack(envelopes).T ** 2)
        ends = np.cumsum([mix.shape[1] for mix in mixes])[:-1]
        tried = [
            _strongest(hat, norm, mix.T @ waves)
            for hat, norm, mix in zip(envelopes, np.split(norms, ends), mixes, strict=True)
        ]
        value, dof, at = max(tried, key=lambda found: found[0] - 4.0 * found[1])
        places = max(2.0, scan.density)
        chance = min(1.0, (chi2_tail(value, dof)) * places * len(axes) * max(1.0, value / dof))
        order = float(scan.transform.grid[at])
        whole = round(order)
        near = abs(order - whole) < scan.cell and whole >= 1
        cause = _cause(axis, hats, axis.levels(count), len(fit.record))
        found.append(
            Look(
                Term(cause, {"order": float(whole) if near else order}), value, dof, places, chance
            )
        )
    return found


def _strongest(
    hats: FloatArray, norms: FloatArray, waves: NDArray[np.complexfloating]
) -> tuple[float, int, int]:
    """Return what envelopes explain at the best order, their directions, and its place."""
    unit = scaled(hats)[0]
    value, vector = np.linalg.eigh(unit.T @ unit)
    kept = value > SAME_SPACE * value[-1]
    apart = vector[:, kept] / np.sqrt(value[kept])
    statistic = np.sum(np.abs(apart.T @ (waves / np.sqrt(norms))) ** 2, axis=0)
    at = int(np.argmax(statistic))
    return float(statistic[at]), 2 * apart.shape[1], at


def _cause(axis: Axis, hats: FloatArray, levels: list[FloatArray], count: int) -> Cause:
    """Return a motor order with an envelope over an axis, as a cause without a name."""

    def columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        angle = shape["order"] * motion.angle_rad
        envelope = hats if len(motion) == count else np.ones((len(motion), hats.shape[1]))
        return np.hstack([envelope * np.cos(angle)[:, None], envelope * np.sin(angle)[:, None]])

    knots = tuple(
        Parameter(f"knot_{k}_nm", "N m", -1e6, 1e6, "torque at one knot")
        for k in range(2 * hats.shape[1])
    )
    order = Parameter("order", "1", 0.05, 1e3, "cycles per turn of the motor")
    name = f"{TABLE}motor-order*{axis.domain}"
    held = (name, "a line with an envelope", (order,), knots, "motor", "", "", (), "", "")
    two = np.eye(2)
    subsets: list[FloatArray] = [np.asarray(np.kron(two, level), dtype=float) for level in levels]
    return Table(*held, columns, False, subsets=tuple(subsets))
