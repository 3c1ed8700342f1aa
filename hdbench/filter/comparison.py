"""Comparison of filters on one trace: suppression, torque kept, delay, noise, error."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdbench.errors import DataError
from hdbench.filter.model import FilterModel
from hdbench.filter.online import Channels, OnlineFilter
from hdbench.filter.orders import motor_angle, smooth_channels
from hdbench.records import FloatArray

_SETTLE_SHARE = 0.25  # of the record is left to the filters to settle, at most 20 s
_SETTLE_S = 20.0
_LAG_S = 0.25  # delays are sought up to here


@dataclass(frozen=True, slots=True)
class Contender:
    """One way to get the torque, judged on the settled part of the record."""

    name: str
    suppression_db: Mapping[str, float | None]  # of each block, at most 120 dB
    torque_kept: float | None  # slope on the reference; None where that hardly varies
    delay_s: float | None  # lag behind the reference
    noise_nm: float  # from sample to sample: third differences over root 20
    error_rms_nm: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """All contenders on one trace."""

    reference: str  # truth or smoothed
    from_s: float
    contenders: tuple[Contender, ...]
    torque_nm: Mapping[str, FloatArray]  # of each contender

    def to_dict(self) -> dict[str, object]:
        """Return the comparison as results store it."""
        return {
            "reference": self.reference,
            "from_s": self.from_s,
            "rows": [asdict(row) for row in self.contenders],
        }


def butterworth_lowpass(
    torque_nm: ArrayLike, *, sample_period_s: float, cutoff_hz: float, order: int
) -> FloatArray:
    """Low-pass the torque causally, the report's comparison for its filter.

    Parameters
    ----------
    torque_nm : array_like, shape (n,)
        Torque, N m. From a NaN on, no output is known: those samples stay NaN.
    sample_period_s : float
        Sampling period, s, > 0, taken as uniform.
    cutoff_hz : float
        -3 dB frequency, Hz, in (0, half the sampling frequency).
    order : int
        Order of the low-pass, 1 to 8.

    Returns
    -------
    ndarray, shape (n,)
        Low-passed torque, N m, started in the steady state of the first sample.

    Raises
    ------
    DataError
        If the period, cut-off or order is out of its domain.

    Notes
    -----
    Second-order sections of the bilinear Butterworth design, run forward only, so its delay is
    the one a control loop would see.

    References
    ----------
    .. [1] S. Butterworth, "On the theory of filter amplifiers", Wireless Engineer 7 (1930).
    """
    if not 0.0 < sample_period_s < math.inf or not 0.0 < cutoff_hz < 0.5 / sample_period_s:
        raise DataError(
            f"cut-off {cutoff_hz!r} Hz at a sampling period of {sample_period_s!r} s; needed: "
            "above 0 and below half the sampling frequency",
            where="filter.butterworth_cutoff_hz",
            fix="lower the cut-off",
        )
    if not 1 <= order <= 8:
        raise DataError(
            f"order {order!r}; needed: 1 to 8",
            where="filter.butterworth_order",
            fix="choose a low-pass order from 1 to 8",
        )
    from scipy.signal import butter, sosfilt, sosfilt_zi

    torque = np.asarray(torque_nm, dtype=np.float64)
    if torque.size == 0:
        return torque.copy()
    sections = butter(order, cutoff_hz, fs=1.0 / sample_period_s, output="sos")
    filtered, _ = sosfilt(sections, torque, zi=sosfilt_zi(sections) * torque[0])
    return np.asarray(filtered, dtype=np.float64)


def compare_filters(
    channels: Channels,
    models: Mapping[str, FilterModel],
    tuned: FilterModel,
    *,
    truth_nm: FloatArray | None,
    lowpass: tuple[float, int],
) -> Comparison:
    """Run filters over one trace and judge them alike."""
    time = channels.time_s
    outputs: dict[str, FloatArray] = {"raw": channels.torque_nm}
    outputs["lowpass"] = _lowpassed(channels, lowpass)
    for name, model in {**models, "tuned": tuned}.items():
        outputs[name] = OnlineFilter(model).process(*channels.samples).torque_filtered_nm
    smoothed = smooth_channels(tuned, channels)
    outputs["smoothed"] = smoothed.torque_smoothed_nm
    reference = smoothed.torque_smoothed_nm if truth_nm is None else truth_nm
    start = time[0] + min(_SETTLE_S, _SETTLE_SHARE * (time[-1] - time[0]))
    judged = (time >= start) & np.isfinite(reference)
    for output in outputs.values():
        judged &= np.isfinite(output)
    # least samples for the fit of a dozen columns and a lag of a quarter second
    if not np.count_nonzero(judged) >= 1000:
        raise DataError(
            f"{np.count_nonzero(judged)} samples are left to judge; needed: 1000",
            where=channels.source,
            fix="compare on a longer record",
        )
    slow = reference if truth_nm is not None else _slow_part(reference, time, lowpass)
    yardstick = _Yardstick(time, reference, slow, _columns(tuned, channels), judged)
    before = yardstick.amplitudes(outputs["raw"])
    rows = [yardstick.judge(name, output, before) for name, output in outputs.items()]
    kind = "smoothed" if truth_nm is None else "truth"
    return Comparison(kind, float(start), tuple(rows), outputs)


def _slow_part(torque: FloatArray, time: FloatArray, lowpass: tuple[float, int]) -> FloatArray:
    """Low-pass forwards and backwards, so that nothing is delayed; missing samples hold."""
    from scipy.signal import butter, sosfiltfilt

    rate = 1.0 / float(np.median(np.diff(time)))
    sections = butter(lowpass[1], lowpass[0], fs=rate, output="sos")
    return np.asarray(sosfiltfilt(sections, _held(torque)), dtype=np.float64)


def _held(values: FloatArray) -> FloatArray:
    """Return the values with the last one in the place of each that is missing."""
    known = np.isfinite(values)
    return values[np.maximum.accumulate(np.where(known, np.arange(known.size), np.argmax(known)))]


def _lowpassed(channels: Channels, lowpass: tuple[float, int]) -> FloatArray:
    """Low-pass the torque; missing samples hold the last one, and are missing in the answer."""
    known = np.isfinite(channels.torque_nm)
    if not known.any():
        raise DataError("no sample has a torque", where=channels.source, fix="record the torque")
    period = float(np.median(np.diff(channels.time_s)))
    held = _held(channels.torque_nm)
    low = butterworth_lowpass(held, sample_period_s=period, cutoff_hz=lowpass[0], order=lowpass[1])
    return np.where(known, low, np.nan)


def _columns(model: FilterModel, channels: Channels) -> dict[str, FloatArray]:
    """Return cosine and sine of every block, shape (n, 2), by name."""
    angle, elapsed = motor_angle(channels), channels.time_s - channels.time_s[0]
    found = {}
    for block in model.blocks:
        turned = block.turned(angle, elapsed)
        name = f"{block.frequency_hz:g} Hz" if block.frequency_hz > 0.0 else f"{block.order:g}x"
        found[name] = np.stack((np.cos(turned), np.sin(turned)), axis=1)
    return found


@dataclass(frozen=True, slots=True)
class _Yardstick:
    """What every contender is held against; arrays of shape (n,)."""

    time_s: FloatArray
    reference_nm: FloatArray
    slow_nm: FloatArray  # reference without ripple: what a filter should follow
    columns: Mapping[str, FloatArray]  # cosine and sine of every block
    judged: NDArray[np.bool_]

    def amplitudes(self, output: FloatArray) -> dict[str, float]:
        """Fit all blocks and a constant to what is off together; return amplitudes, N m."""
        whole = np.hstack([*self.columns.values(), np.ones((self.judged.size, 1))])[self.judged]
        fit = np.linalg.lstsq(whole, (output - self.reference_nm)[self.judged], rcond=None)[0]
        places = enumerate(self.columns)
        return {name: float(np.hypot(*fit[2 * i : 2 * i + 2])) for i, name in places}

    def judge(self, name: str, output: FloatArray, before: Mapping[str, float]) -> Contender:
        """Return one contender; `before` has the amplitudes of the raw torque."""
        after, judged = self.amplitudes(output), self.judged
        suppression = {
            key: min(20.0 * math.log10(max(before[key], 1e-12) / max(after[key], 1e-12)), 120.0)
            if output is not self.reference_nm
            else None
            for key in before
        }
        third = np.diff(output, 3)[judged[3:] & judged[:-3]]
        noise = float(np.std(third)) / math.sqrt(20.0)
        kept, delay = self._followed(output, noise)
        error = (output - self.reference_nm)[judged]
        rms = float(np.sqrt(np.mean(np.square(error))))
        return Contender(name, suppression, kept, delay, noise, rms)

    def _followed(self, output: FloatArray, noise: float) -> tuple[float | None, float | None]:
        """Return slope on the reference, and lag behind it by the largest correlation."""
        y, r = output[self.judged], self.slow_nm[self.judged]
        r = r - np.mean(r)
        power = float(r @ r)
        # a reference that varies less than the noise shows neither; 1e-12 is against rounding
        if not power > max(noise**2, 1e-12) * r.size:
            return None, None
        y = y - np.mean(y)
        kept = float(y @ r) / power
        period = float(np.median(np.diff(self.time_s)))
        lags = np.arange(-round(_LAG_S / period), round(_LAG_S / period) + 1)
        n = y.size
        size = 1 << (2 * n - 1).bit_length()
        full = np.fft.irfft(np.fft.rfft(y, size) * np.conj(np.fft.rfft(r, size)), size)
        correlation = full[lags]
        at = int(np.argmax(correlation))
        if not 0 < at < lags.size - 1:
            return kept, None
        left, top, right = correlation[at - 1 : at + 2]
        bend = left - 2.0 * top + right
        shift = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
        return kept, float((lags[at] + shift) * period)
