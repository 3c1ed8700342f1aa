"""Noise that grows with the speed, in the whitened residual once all else is explained."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc, ndtri

from hdbench.diagnosis.acquisition.measure import Residual, gain_of
from hdbench.diagnosis.acquisition.named import Acquired, Tail, acquired_cause, entry, normal_tail
from hdbench.diagnosis.acquisition.variance import (
    SpeedNoise,
    find_speed_noise,
    speed_variance,
    variance_score,
)
from hdbench.diagnosis.naming.curves import equal_bins
from hdbench.diagnosis.search import Found
from hdbench.model import CauseTerm
from hdbench.records.trace import FloatArray

__all__ = ["noise_law", "speed_noise_cause", "still_left"]

_BINS = 16
# bins of the squares that differ by no more than this probability are alike
_ALIKE = 1e-4
# increments of the angle below this part of the largest tell no slope
_MOVING = 0.05
# a residual this many standard deviations larger on steep parts of the ripple is an angle's error
_OFF_SIGMA = 3.0
# law of the catalogue: noise at this speed
_REFERENCE_RAD_S = 100.0
_DRIVEN = "constant speeds over at least 1:4 and rest, long enough for the variance at each"


def noise_law(found: Found, level: float) -> SpeedNoise | None:
    """Return the law of noise that grows with the speed, None where there is none.

    Parameters
    ----------
    found : Found
        Result of the search.
    level : float
        Probability of a law without any effect, in (0, 1).

    Returns
    -------
    SpeedNoise or None
    """
    space, motion = found.space, found.record.motion
    law = find_speed_noise(space.residual, space.whitener.used, motion.velocity_rad_s, level)
    if law is None or motion.angle_source != "velocity":
        return law
    return None if _angle_is_off(found) else law


def _angle_is_off(found: Found) -> bool:
    """Return whether the residual is large where the torque changes fastest over the angle.

    An integrated angle that is off by noise makes such a residual, and it grows with the speed.
    """
    record, space = found.record, found.space
    fitted = np.where(record.valid, found.fit.fitted_nm, np.nan)
    turned = np.gradient(record.motion.angle_rad)
    slope = np.full(len(fitted), np.nan)
    moving = np.abs(turned) > _MOVING * float(np.nanmax(np.abs(turned)))
    slope[moving] = np.gradient(fitted)[moving] / turned[moving]
    used = space.whitener.used & np.isfinite(slope)
    return variance_score(space.residual[used] ** 2, slope[used] ** 2) > _OFF_SIGMA


def speed_noise_cause(
    law: SpeedNoise, found: Found, baseline_square: float, rng: np.random.Generator
) -> Acquired:
    """Return noise that grows with the speed as a cause.

    Parameters
    ----------
    law : SpeedNoise
        Law.
    found : Found
        Result of the search.
    baseline_square : float
        Mean square of the baseline's residual, (N m)^2.
    rng : Generator
        For the bootstrap.

    Returns
    -------
    Acquired
        Its gain is that of weighing each sample by the modelled variance: the residual over its
        modelled standard deviation, times their harmonic mean.
    """
    record = found.record
    velocity = record.motion.velocity_rad_s
    left = np.where(record.valid, record.response_nm - found.fit.fitted_nm, 0.0)
    before = Residual(left, record.valid)
    variance = speed_variance(law, np.where(record.valid, velocity, 0.0))
    harmonic = 1.0 / float(np.mean(1.0 / variance[record.valid]))
    after = Residual(left * np.sqrt(harmonic / variance), record.valid)
    power = before.mean_square
    moving = float(np.mean(law.slope * velocity[record.valid] ** 2))
    share = float(np.clip(moving * power / max(baseline_square, 1e-300), 0.0, 1.0))
    slope = np.sqrt(law.slope * power)
    noise_nm = float(slope * _REFERENCE_RAD_S)
    std = noise_nm * 0.5 * law.slope_std / law.slope
    still = float(np.sqrt(law.still * power))
    count = int(record.valid.sum())
    tail = Tail(
        law.nats - 0.5 * float(np.log(count)), normal_tail(law.sigmas, 1.0, 1, count).chance
    )
    cause = acquired_cause(
        "speed-dependent-noise",
        {"noise_nm": entry(noise_nm, std, "N m"), "noise_at_rest_nm": entry(still, None, "N m")},
        tail,
        (gain_of(before, after, rng), share),
        domain="variance",
        experiment=_DRIVEN,
    )
    return Acquired(cause, (), CauseTerm("speed-dependent-noise", {"noise_nm": noise_nm}, ()))


def still_left(found: Found, law: SpeedNoise) -> Found:
    """Return the search's result without what the law of the noise explains.

    Parameters
    ----------
    found : Found
        Result of the search.
    law : SpeedNoise
        Law of the noise over speed.

    Returns
    -------
    Found
        A variance over speed that is even once the law is divided out is no place without a name,
        nor are outliers that are none for the noise at their speed.
    """
    space, motion = found.space, found.record.motion
    used = space.whitener.used
    speed = np.where(np.isfinite(motion.velocity_rad_s), motion.velocity_rad_s, 0.0)
    even = space.residual / np.sqrt(speed_variance(law, speed))
    gone = set()
    if _alike(even**2, np.abs(speed), used):
        gone.add("variance")
    scatter = float(np.sqrt(np.mean(even[used] ** 2)))
    count = int(used.sum())
    if float(np.abs(even[used]).max()) < -float(ndtri(0.5 * _ALIKE / count)) * scatter:
        gone.add("outliers")
    return replace(found, left=tuple(place for place in found.left if place.domain not in gone))


def _alike(squares: FloatArray, speed: FloatArray, used: NDArray[np.bool_]) -> bool:
    """Return whether the squares have one mean over bins of speed."""
    masks = equal_bins(speed, used, _BINS)
    if len(masks) < 2:
        return True
    means = np.array([squares[m].mean() for m in masks])
    weights = np.array([float(m.sum()) for m in masks]) / float(squares[used].var())
    centre = float((weights * means).sum() / weights.sum())
    statistic = float((weights * (means - centre) ** 2).sum())
    return float(gammaincc((len(masks) - 1) / 2.0, statistic / 2.0)) > _ALIKE
