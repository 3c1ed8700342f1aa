"""Faults that show in what a model leaves: spikes, coarse steps, noise that grows with speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter
from scipy.special import ndtri

from hdbench.diagnosis.faults.converter import quantisation
from hdbench.diagnosis.faults.fault import Fault, entry, mask_runs, normal_tail, robust_std
from hdbench.model import Motion
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray

__all__ = ["ResidualFaults", "SpeedNoise", "faults_of_residual"]

# probability of any such spike on a record of normal noise
_CHANCE = 2e-5
# a spike lasts this many samples at most, against the median of this many
_LONG = 2
_WINDOW = 5
# isolated samples are rare: more of them than this share are another distribution, not spikes
_RARE = 0.02
# a loud stretch is judged by itself: samples over which the scatter is taken
_AROUND = 400
# part of a spike by which it has to stand out of the torque's own samples on both sides
_COMES_BACK = 0.5
# law of the catalogue: noise at this speed, rad/s
_REFERENCE_RAD_S = 100.0
# cells of equal counts in which squares are summed: the law bends slowly
_CELLS = 64
# blocks in time: noise that changes with time alone must not be taken for a law of the speed
_BLOCKS = 24
# Fisher scoring converges within ten rounds
_ROUNDS = 20
_LEAST_SAMPLES = 500
# samples before that predict, and samples over which they are weighed alike
_ORDER, _BLOCK = 8, 512
# times the median size that the bulk of normal noise ends at: 2.5 standard deviations
_BULK = 3.7


@dataclass(frozen=True, slots=True)
class SpeedNoise:
    """Variance ``still + slope w^2`` of a residual in units of its mean, w in rad/s.

    Parameters
    ----------
    still, slope, slope_std : float
        Its two numbers, and the uncertainty of the second, s^2/rad^2.
    sigmas, nats : float
        How far the slope is from none, in standard deviations and in evidence.
    """

    still: float
    slope: float
    slope_std: float
    sigmas: float
    nats: float

    def variance(self, velocity_rad_s: FloatArray) -> FloatArray:
        """Return the variance over its mean at each velocity."""
        speed = np.where(np.isfinite(velocity_rad_s), velocity_rad_s, 0.0)
        return np.asarray(self.still + self.slope * speed**2)


@dataclass(frozen=True, slots=True)
class ResidualFaults:
    """Faults of a residual.

    Parameters
    ----------
    faults : tuple of Fault
        Faults with a name.
    spikes : ndarray of bool, shape (n,)
        Spikes.
    law : SpeedNoise or None
        How the noise grows with speed, where it does.
    """

    faults: tuple[Fault, ...]
    spikes: NDArray[np.bool_]
    law: SpeedNoise | None


def faults_of_residual(
    residual_nm: FloatArray,
    whitened_residual: FloatArray | None,
    motion: Motion,
    valid: NDArray[np.bool_],
    torque_nm: FloatArray,
    profile: ProfileData,
    *,
    alpha: float,
    volts: bool,
) -> ResidualFaults:
    """Return the faults of the acquisition that a residual shows.

    Parameters
    ----------
    residual_nm : ndarray, shape (n,)
        Measured less modelled torque, N m.
    whitened_residual : ndarray, shape (n,), or None
        The same with white noise, in any unit; None before the noise is known: then only spikes
        and coarse steps are looked for.
    motion : Motion
        Motion of the record.
    valid : ndarray of bool, shape (n,)
        Samples that count.
    torque_nm : ndarray, shape (n,)
        Torque as read, N m.
    profile : ProfileData
        Converter of the bench.
    alpha : float
        False-alarm rate of the law of the noise, in (0, 1).
    volts : bool
        Whether the torque is the converter's own reading times the gain (``torque_v``).

    Returns
    -------
    ResidualFaults
    """
    spikes = _find_spikes(residual_nm, whitened_residual, valid, torque_nm)
    faults = [*_spiky(spikes, residual_nm, valid, motion.time_s)]
    spikes = spikes if faults else np.zeros_like(spikes)
    kept = valid & ~spikes
    scatter = robust_std(residual_nm[kept])
    readings = np.where(valid, torque_nm, np.nan)
    coarse = quantisation(motion.time_s, readings, scatter, profile, volts=volts)
    if coarse is not None:
        faults.append(coarse)
    law = None
    if whitened_residual is not None:
        law = _speed_noise(whitened_residual, kept, motion.velocity_rad_s, alpha)
        # readings of a coarse converter are rough where they cross levels fast
        if law is not None and coarse is None:
            faults.append(_rough(law, residual_nm, kept, motion.time_s))
        law = law if coarse is None else None
    return ResidualFaults(tuple(faults), spikes, law)


def _local_std(values: FloatArray, used: NDArray[np.bool_]) -> FloatArray:
    """Return the robust scatter of the used values around each sample, at least that of all."""
    at = np.flatnonzero(used)
    parts = np.array_split(at, max(1, len(at) // _AROUND))
    centres = np.array([float(part.mean()) for part in parts])
    sizes = np.array([robust_std(values[part]) for part in parts])
    # a loud stretch between two quiet ones must not be judged by them: the larger neighbour counts
    wide = maximum_filter1d(sizes, 3)
    local = np.interp(np.arange(len(values)), centres, wide)
    return np.asarray(np.maximum(local, max(robust_std(values[at]), 1e-300)))


def _find_spikes(
    residual_nm: FloatArray,
    whitened_residual: FloatArray | None,
    valid: NDArray[np.bool_],
    torque_nm: FloatArray,
) -> NDArray[np.bool_]:
    """Return one or two samples that stand out of the noise and of their neighbours.

    Samples of the whitened residual beyond what one record in 50 000 shows, held against the
    scatter around them; none where they come in runs, where the torque does not come back, or
    where they are more than one in fifty.
    """
    spikes = np.zeros(len(valid), dtype=bool)
    count = int(valid.sum())
    if count < _AROUND:
        return spikes
    known = np.where(valid, residual_nm, 0.0)
    off = known - median_filter(known, size=_WINDOW, mode="nearest")
    away = np.abs(off)
    sigmas = -float(ndtri(0.5 * _CHANCE / count))
    far = valid & (away > sigmas * _local_std(off, valid))
    if whitened_residual is not None and far.any():
        far &= np.abs(whitened_residual) > sigmas * _local_std(whitened_residual, valid)
    torque = np.where(valid, torque_nm, 0.0)
    for first, last in mask_runs(far):
        beside = np.concatenate([torque[max(0, first - 2) : first], torque[last + 1 : last + 3]])
        mine = torque[first : last + 1]
        outside = max(float(mine.min() - beside.max()), float(beside.min() - mine.max()))
        # what the torque itself does not come back from is a step, or the model's error at one
        if last - first < _LONG and outside > _COMES_BACK * float(away[first : last + 1].min()):
            spikes[first : last + 1] = True
    return spikes if int(spikes.sum()) <= _RARE * count else np.zeros(len(valid), dtype=bool)


def _spiky(
    spikes: NDArray[np.bool_], residual_nm: FloatArray, valid: NDArray[np.bool_], time_s: FloatArray
) -> tuple[Fault, ...]:
    """Return the spikes as one fault, none where nothing speaks for it."""
    at = np.flatnonzero(spikes)
    if not len(at):
        return ()
    scatter = robust_std(residual_nm[valid & ~spikes])
    sizes, total = np.abs(residual_nm[at]), len(spikes)
    sigmas = sizes / max(scatter, 1e-300)
    # each has a place among all samples and a size of its own
    nats = float(np.sum(0.5 * sigmas**2 - 1.5 * np.log(total)))
    if not nats > 0.0:
        return ()
    size, share = float(np.sqrt(np.mean(sizes**2))), len(at) / total
    parameters = {
        "share": entry(share, float(np.sqrt(len(at))) / total, "1"),
        "size_nm": entry(size, size / float(np.sqrt(2.0 * len(at))), "N m"),
        "samples": entry(len(at), 0.0, "1"),
        "largest_nm": entry(float(sizes.max()), scatter, "N m"),
        "first_s": entry(float(time_s[at[0]]), None, "s"),
    }
    chance = normal_tail(float(sigmas.max()), total, 1, total)[1]
    fault = Fault(
        "spikes", parameters, len(at), float(time_s[at[0]]), float(time_s[at[-1]]), nats, chance,
        ("torque_nm",), {"share": share, "size_nm": size}, masked=spikes, domain="outliers",
    )  # fmt: skip
    return (fault,)


def _rough(
    law: SpeedNoise, residual_nm: FloatArray, kept: NDArray[np.bool_], time_s: FloatArray
) -> Fault:
    """Return noise that grows with the speed as a fault."""
    power = float(np.mean(residual_nm[kept] ** 2))
    size = float(np.sqrt(law.slope * power)) * _REFERENCE_RAD_S
    std = size * 0.5 * law.slope_std / law.slope
    count = int(kept.sum())
    parameters = {
        "noise_nm": entry(size, std, "N m"),
        "noise_at_rest_nm": entry(float(np.sqrt(law.still * power)), None, "N m"),
    }
    return Fault(
        "speed-dependent-noise", parameters, count, float(time_s[0]), float(time_s[-1]),
        law.nats, normal_tail(law.sigmas, 1.0, 1, count)[1],
        ("torque_nm",), {"noise_nm": size}, domain="variance",
    )  # fmt: skip


def _innovations(white: FloatArray, good: NDArray[np.bool_]) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return what the samples before do not predict, block by block, and its samples.

    What a wrong form or angle leaves is a line that wanders with the speed: it can be predicted,
    noise cannot.
    """
    windows = np.lib.stride_tricks.sliding_window_view(np.where(good, white, 0.0), _ORDER + 1)
    left, rows = [], []
    for first in range(0, len(windows), _BLOCK):
        part = windows[first : first + _BLOCK]
        at = np.flatnonzero(good[first + _ORDER : first + _ORDER + len(part)])
        if len(at) < 4 * _ORDER:
            continue
        before, now = part[at, :-1], part[at, -1]
        gram = before.T @ before
        gram[np.diag_indices_from(gram)] += 1e-9 * float(np.trace(gram)) + 1e-300
        left.append(now - before @ np.linalg.solve(gram, before.T @ now))
        rows.append(at + first + _ORDER)
    if not left:
        return np.zeros(0), np.zeros(0, dtype=np.intp)
    return np.concatenate(left), np.concatenate(rows)


def _speed_noise(
    whitened: FloatArray, used: NDArray[np.bool_], velocity_rad_s: FloatArray, alpha: float
) -> SpeedNoise | None:
    """Return the law of noise that grows with the square of the speed, if there is one.

    By greatest likelihood for normal noise (Fisher scoring). None where the variance does not grow
    as surely as alpha asks, or where a variance that changes with time alone is likelier.
    """
    left, rows = _innovations(whitened, used & np.isfinite(velocity_rad_s))
    speed = velocity_rad_s[rows] ** 2
    if len(rows) < _LEAST_SAMPLES or not float(np.ptp(speed)) > 0.0:
        return None
    # the bulk decides: held samples and other outliers are none of the noise
    cells = np.array_split(np.argsort(speed, kind="stable"), _CELLS)
    kept = np.concatenate(
        [cell[np.abs(left[cell]) < _BULK * float(np.median(np.abs(left[cell])))] for cell in cells]
    )
    kept.sort()
    squares, speed = left[kept] ** 2, speed[kept]
    squares = squares / float(squares.mean())
    centred = speed - speed.mean()
    spread = float(np.sqrt(np.sum((squares - 1.0) ** 2 * centred**2)))
    sigmas = float((squares - 1.0) @ centred) / spread
    if not sigmas > -float(ndtri(alpha)):
        return None
    still, slope, std, nats = _fitted(squares, speed)
    nats -= 0.5 * float(np.log(len(squares)))
    if nats < max(0.0, _over_time(squares)):
        return None
    return SpeedNoise(still, slope, std, sigmas, nats)


def _fitted(squares: FloatArray, speed: FloatArray) -> tuple[float, float, float, float]:
    """Return s0^2, s1^2, its standard uncertainty and the gain in likelihood over even noise."""
    cells = np.array_split(np.argsort(speed), _CELLS)
    count = np.array([len(cell) for cell in cells], dtype=float)
    means, design = np.array([squares[cell].mean() for cell in cells]), np.ones((_CELLS, 2))
    scale = float(speed.max())
    design[:, 1] = [speed[cell].mean() / scale for cell in cells]
    values = np.array([0.5, 0.5])
    for _ in range(_ROUNDS):
        weighted = design * (0.5 * count / (design @ values) ** 2)[:, None]
        fisher = weighted.T @ design
        # a variance stays positive: a thousandth of the mean is none
        values = np.maximum(np.linalg.solve(fisher, weighted.T @ means), 1e-3)
    variance = design @ values
    nats = 0.5 * float(np.sum(count * (means - np.log(variance) - means / variance)))
    std = float(np.sqrt(np.linalg.inv(fisher)[1, 1])) / scale
    return float(values[0]), float(values[1]) / scale, std, nats


def _over_time(squares: FloatArray) -> float:
    """Return the log likelihood that a variance for each of 24 blocks of time gains, paid for."""
    blocks = np.array_split(squares, _BLOCKS)
    gain = sum(0.5 * len(part) * float(np.log(max(float(part.mean()), 1e-12))) for part in blocks)
    return -gain - 0.5 * (_BLOCKS - 1) * float(np.log(len(squares)))
