"""Spikes judged beside all that is explained: which only show there, and which are none."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from hdbench.diagnosis.acquisition.flags import mask_runs
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.naming.jumps import beside_causes
from hdbench.diagnosis.search import Found
from hdbench.records.trace import FloatArray

__all__ = ["explained_spikes", "late_spikes"]

# probability of any such spike on a record of normal noise
_CHANCE = 2e-5
# a spike and its echo in the whitened residual
_SPIKE_LENGTH = 2
# part of an innovation that has to be gone again two samples later
_COMES_BACK = 0.5
# samples over which the scatter around a sample is taken
_AROUND = 400
# the form of a cause is off where its torque changes most: a sample that lies no further out than
# this share of what the causes change by within so many samples is theirs and no spike
_FORM_SHARE = 0.5
_NEAR = 7
# isolated samples are rare: more of them than this share are another distribution, not spikes
_RARE = 0.02


def _local_std(values: FloatArray, used: NDArray[np.bool_]) -> FloatArray:
    """Return the robust scatter of the used values around each sample."""
    at = np.flatnonzero(used)
    std = np.ones(len(values))
    if not len(at):
        return std
    parts = np.array_split(at, max(1, len(at) // _AROUND))
    centres = np.array([float(part.mean()) for part in parts])
    sizes = np.array([float(np.quantile(np.abs(values[part]), 0.6827)) for part in parts])
    # a loud stretch between two quiet ones must not be judged by them: the larger neighbour counts
    wide = np.maximum(sizes, np.maximum(np.roll(sizes, 1), np.roll(sizes, -1)))
    return np.asarray(np.maximum(np.interp(np.arange(len(values)), centres, wide), 1e-12))


def _away_nm(found: Found) -> FloatArray:
    """Return how far each sample of the residual lies from the median of five around it, N m."""
    from scipy.ndimage import median_filter

    record = found.record
    left = np.where(record.valid, record.response_nm - found.fit.fitted_nm, 0.0)
    return np.asarray(np.abs(left - median_filter(left, size=5, mode="nearest")))


def _changes_nm(found: Found) -> FloatArray:
    """Return by how much the causes' torque changes within some samples of each, N m."""
    record, fit = found.record, found.fit
    torque = np.where(record.valid, fit.fitted_nm - record.base @ fit.base, 0.0)
    return _range_around(torque)


def _range_around(values: FloatArray) -> FloatArray:
    """Return the range of values within some samples of each."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    return np.asarray(maximum_filter1d(values, _NEAR) - minimum_filter1d(values, _NEAR))


def explained_spikes(found: Found, full: Record, spikes: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return those spikes of the baseline's residual that the causes explain.

    Parameters
    ----------
    found : Found
        Result of the search on the record without the spikes.
    full : Record
        The same record with them.
    spikes : ndarray of bool, shape (n,)
        Spikes that were masked before the search.

    Returns
    -------
    ndarray of bool, shape (n,)
        Samples that lie beside baseline and causes no further out than one of them in a record of
        normal noise does, or than a misfit of the causes' form.
    """
    fit, record = found.fit, found.record
    both = beside_causes(found, full) if spikes.any() else None
    if both is None:
        return np.zeros(len(spikes), dtype=bool)
    left, causes = both
    scatter = float(np.std((record.response_nm - fit.fitted_nm)[record.valid]))
    wide = _range_around(causes)
    limit = -float(ndtri(0.5 * _CHANCE / int(full.valid.sum()))) * scatter
    return np.asarray(spikes & full.valid & (np.abs(left) < np.maximum(limit, _FORM_SHARE * wide)))


def late_spikes(found: Found) -> NDArray[np.bool_]:
    """Return isolated samples that nothing explains.

    Parameters
    ----------
    found : Found
        Result of the search.

    Returns
    -------
    ndarray of bool, shape (n,)
        Samples of the whitened residual beyond what one record in 50 000 shows, held against the
        scatter around them; none where they come in runs or are more than one in fifty.
    """
    from scipy.ndimage import binary_dilation

    white, used = found.space.residual, found.space.whitener.used
    count = int(used.sum())
    spikes = np.zeros(len(white), dtype=bool)
    if count < _AROUND:
        return spikes
    # neither the scatter around it nor that of the whole residual makes such a sample
    std = np.maximum(_local_std(white, used), float(np.sqrt(np.mean(white[used] ** 2))))
    far = used & (np.abs(white) > -float(ndtri(0.5 * _CHANCE / count)) * std)
    # a jump to another level that lasts is one innovation as well, but no spike
    size = np.abs(white) * found.space.whitener.std
    far &= (_away_nm(found) > _COMES_BACK * size) & (size > _FORM_SHARE * _changes_nm(found))
    if found.accepted:
        # what remembers begins anew behind masked samples
        far &= ~binary_dilation(~found.record.valid, iterations=_NEAR)
    echo = len(found.space.whitener.kernel)
    for first, last in mask_runs(far):
        if last - first < _SPIKE_LENGTH + echo:
            top = first + int(np.argmax(np.abs(white[first : last + 1])))
            spikes[first : top + 1] = True
    return spikes if int(spikes.sum()) <= _RARE * count else np.zeros(len(white), dtype=bool)
