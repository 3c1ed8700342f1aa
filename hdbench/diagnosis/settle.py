"""Causes and noise fitted in turn; what the noise model must not swallow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.challengers import equal_bins
from hdbench.diagnosis.jointfit import JointFit, fit_jointly
from hdbench.diagnosis.notch import without_order_lines
from hdbench.diagnosis.record import Record
from hdbench.diagnosis.scan import LineScan
from hdbench.diagnosis.terms import Term
from hdbench.diagnosis.whitened import Whitener, make_whitener, orthonormal
from hdbench.estimation import NoiseModel, fit_noise
from hdbench.records.trace import FloatArray

__all__ = ["Hidden", "Noise", "coarse_basis", "settle"]

# the noise hardly moves after the second round
_NOISE_ROUNDS = 2
# bins of speed, blocks of time, and twice the output orders that the noise must not swallow
_COARSE = 16


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise model and its whitener."""

    model: NoiseModel
    whitener: Whitener


@dataclass(frozen=True, slots=True)
class Hidden:
    """What a noise model must not see: coarse columns, and lines over motor order."""

    coarse: FloatArray
    scans: tuple[LineScan, ...]


def coarse_basis(record: Record) -> FloatArray:
    """Return what slow and speed-bound effects can be made of, orthonormal, shape (n, k).

    Means over 16 bins of speed and 16 blocks of time, and output orders 1 to 8. An autoregression
    that sees such effects takes them for noise with a long memory and whitens them away; without
    some forty of many thousand directions it still sees all colour that it can describe.
    """
    motion, valid = record.motion, record.valid
    masks = equal_bins(motion.velocity_rad_s, valid, _COARSE)
    masks += equal_bins(motion.time_s, valid, _COARSE)
    columns = [np.ones(len(valid)), *(m.astype(float) for m in masks)]
    for order in range(1, _COARSE // 2 + 1):
        angle = order * np.where(valid, motion.output_angle_rad, 0.0)
        columns += [np.cos(angle), np.sin(angle)]
    return orthonormal(np.where(valid[:, None], np.column_stack(columns), 0.0))


def _noise_of(record: Record, fitted_nm: FloatArray, hidden: Hidden) -> Noise:
    left = np.where(record.valid, record.response_nm - fitted_nm, 0.0)
    left = left - hidden.coarse @ (hidden.coarse.T @ left)
    for scan in hidden.scans:
        if scan.domain == "motor-order":
            left = without_order_lines(left, record.valid, scan)
    model = fit_noise(left, record.valid, starts=record.starts)
    return Noise(model, make_whitener(model, record.valid, record.starts))


def settle(
    record: Record, terms: tuple[Term, ...], noise: Noise | None, hidden: Hidden
) -> tuple[JointFit, Noise]:
    """Fit terms and noise in turn.

    Parameters
    ----------
    record : Record
        Record.
    terms : tuple of Term
        Causes.
    noise : Noise or None
        Noise to start from; white without it.
    hidden : Hidden
        What the noise model must not see.

    Returns
    -------
    fit : JointFit
    noise : Noise
    """
    if noise is None:
        white = NoiseModel((np.zeros(0),), np.ones(1), int(record.valid.sum()))
        noise = Noise(white, make_whitener(white, record.valid, record.starts))
        fit = fit_jointly(record, terms, noise.whitener, refine=False)
        noise = _noise_of(record, fit.fitted_nm, hidden)
    for _ in range(_NOISE_ROUNDS):
        fit = fit_jointly(record, terms, noise.whitener)
        terms = fit.terms
        noise = _noise_of(record, fit.fitted_nm, hidden)
    return fit_jointly(record, terms, noise.whitener, refine=False), noise
