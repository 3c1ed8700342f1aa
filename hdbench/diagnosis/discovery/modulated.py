"""Modulated lines: motor orders whose amplitude and phase follow another axis."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdbench.diagnosis.discovery.chance import chi2_tail
from hdbench.diagnosis.discovery.dictionary import Look
from hdbench.diagnosis.discovery.fit import Fit
from hdbench.diagnosis.discovery.lines import Scan, line_norm
from hdbench.diagnosis.discovery.tables import TABLE, Axis, axes_of
from hdbench.diagnosis.discovery.term import Term
from hdbench.model import Cause, Motion, Parameter
from hdbench.records.trace import FloatArray

# knots over the other axis
_KNOTS = 5


def modulated_looks(fit: Fit, scans: tuple[Scan, ...]) -> list[Look]:
    """Return, for each axis, the motor order that explains most with an envelope over it.

    None in a stack of records, each of which has an axis of its own.
    """
    scan = next((s for s in scans if s.domain == "motor-order"), None)
    if scan is None or scan.parts:
        return []
    weighted = fit.bands.inverse(fit.residual * fit.bands.spread(1.0 / fit.spectrum.power))
    weighted = np.where(fit.record.valid, weighted, 0.0)
    axes = axes_of(fit.record)
    found = []
    for axis in axes:
        hats = axis.hats(_KNOTS)
        statistic = np.zeros(len(scan.transform.grid))
        for hat in hats.T:
            norm = line_norm(fit, scan, hat**2)
            sums = np.abs(scan.transform(weighted * hat)) ** 2
            statistic += sums / norm
        at = int(np.argmax(statistic))
        dof = 2 * hats.shape[1]
        # neighbouring hats overlap: half of the sum is counted twice at most
        value = float(statistic[at]) / _OVERLAP
        places = max(2.0, scan.density)
        chance = min(1.0, (chi2_tail(value, dof)) * places * len(axes) * max(1.0, value / dof))
        order = float(scan.transform.grid[at])
        whole = round(order)
        near = abs(order - whole) < scan.cell and whole >= 1
        cause = _cause(axis, hats, len(fit.record))
        found.append(
            Look(
                Term(cause, {"order": float(whole) if near else order}), value, dof, places, chance
            )
        )
    return found


# adjacent hats share a third of their squares
_OVERLAP = 4.0 / 3.0


def _cause(axis: Axis, hats: FloatArray, count: int) -> Cause:
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
    return Cause(
        f"{TABLE}motor-order*{axis.domain}",
        "a line with an envelope",
        (order,),
        knots,
        "motor",
        "",
        "",
        (),
        "",
        "",
        columns,
        False,
    )
