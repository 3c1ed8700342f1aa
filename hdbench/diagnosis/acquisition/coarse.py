"""Coarse steps of the torque channel as a cause."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.acquisition.codes import Comb, nominal_step_nm
from hdbench.diagnosis.acquisition.collect import Cost
from hdbench.diagnosis.acquisition.flags import flag_samples
from hdbench.diagnosis.acquisition.measure import Residual, gain_of
from hdbench.diagnosis.acquisition.named import Acquired, Tail, acquired_cause, entry
from hdbench.diagnosis.measured.record import Record
from hdbench.model import CauseTerm
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray

__all__ = ["comb_matters", "quantised"]

# steps of converters with whole bits, and of numbers written with a fixed number of decimals, are
# met within this part
_WHOLE = 0.01
# converters for a bench have 12 bits at least
_FEWEST_BITS = 12
# noise ahead of the converter, in steps, over which the best is taken; half a step hides the comb
_DITHERS = np.array([0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5])


def comb_matters(comb: Comb | None, profile: ProfileData, scatter_nm: float) -> bool:
    """Return whether the steps of a channel are a fault.

    Parameters
    ----------
    comb : Comb or None
        Grid of its values.
    profile : ProfileData
        Converter of the bench.
    scatter_nm : float
        Scatter of the baseline's residual, N m.

    Returns
    -------
    bool
        True for steps more than one and a half times the profile's that are above the residual's
        scatter, or that neither a converter of 12 bits or more nor fixed decimals would make.
    """
    if comb is None or not comb.step_nm > 1.5 * nominal_step_nm(profile):
        return False
    if comb.step_nm > scatter_nm:
        return True
    bits = np.log2(2.0 * profile.daq.range_v * profile.sensor.gain_nm_per_v / comb.step_nm)
    decimals = np.log10(comb.step_nm / np.array([1.0, 2.0, 5.0]))
    off = [abs(10.0 ** (d - round(d)) - 1.0) for d in decimals.tolist()]
    if round(bits) >= _FEWEST_BITS:
        off.append(abs(2.0 ** (bits - round(bits)) - 1.0))
    return bool(min(off) > _WHOLE)


def quantised(comb: Comb, record: Record, profile: ProfileData, cost: Cost) -> Acquired:
    """Return coarse steps of the torque channel as a cause.

    Parameters
    ----------
    comb : Comb
        Grid of its values.
    record : Record
        Record.
    profile : ProfileData
        Converter of the bench.
    cost : Cost
        What masked samples cost.

    Returns
    -------
    Acquired
        Its gain is that of predicting the mean reading of a converter with these steps: the
        prediction plus normal noise, rounded.

    Notes
    -----
    With noise s ahead of steps q the mean reading of m is ``m + q/pi sum_k (-1)^k / k
    exp(-2 (pi k s / q)^2) sin(2 pi k (m - m0) / q)``, m0 a level.
    """
    before = cost.of(np.zeros(len(cost.used), dtype=bool))[0]
    predicted = np.where(record.valid, record.torque_nm - before.left_nm, 0.0)
    level = float(record.torque_nm[record.valid][0])
    trials = [
        (before.mean_square, before),
        *(_rounded(before, predicted, level, comb.step_nm, s) for s in _DITHERS * comb.step_nm),
    ]
    after = min(trials, key=lambda trial: trial[0])[1]
    share = float(min(1.0, comb.step_nm**2 / 12.0 / max(before.mean_square, 1e-300)))
    count = int(record.valid.sum())
    # each sample on one of the levels instead of any of the converter's steps in between
    nats = count * float(np.log(comb.step_nm / nominal_step_nm(profile)))
    cause = acquired_cause(
        "quantisation",
        {
            "step_nm": entry(comb.step_nm, comb.std_nm, "N m"),
            "levels": entry(comb.levels, 0.0, "1"),
        },
        Tail(nats, 0.0),
        (gain_of(before, after, cost.rng), share),
        domain="torque",
    )
    detail = f"readings in steps of {comb.step_nm:.4g} N m"
    flags = tuple(flag_samples("quantisation", cost.time_s, record.valid, detail))
    return Acquired(cause, flags, CauseTerm("quantisation", {"step_nm": comb.step_nm}, ()))


def _rounded(
    before: Residual, predicted: FloatArray, level: float, step: float, noise: float
) -> tuple[float, Residual]:
    """Return mean square and residual with the mean reading of a converter predicted."""
    turn = 2.0 * np.pi * (predicted - level) / step
    shift = np.zeros(len(predicted))
    for k in range(1, 30):
        weight = float(np.exp(-2.0 * (np.pi * k * noise / step) ** 2))
        shift += (-1.0) ** k / k * weight * np.sin(k * turn)
    after = Residual(before.left_nm - step / np.pi * shift, before.valid)
    return after.mean_square, after
