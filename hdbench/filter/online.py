"""Filter over samples as they come and over stored traces: screening, states, amplitudes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdbench.errors import DataError
from hdbench.filter import kalman
from hdbench.filter.model import FilterModel, OscillatorBlock
from hdbench.profile.scaling import angle_channel, velocity_channel
from hdbench.profile.schema import ProfileData
from hdbench.records import FloatArray, Trace

SATURATED, STUCK = 8, 16
"""Bits of a sample's flag, beside those of the kernel."""

FLAG_BITS = {
    "missing": kalman.MISSING,
    "gated": kalman.GATED,
    "unresolved": kalman.UNRESOLVED,
    "saturated": SATURATED,
    "stuck": STUCK,
}
"""Every bit of a sample's flag by its name."""

SCREEN_STATES = 2
"""Numbers that the screening keeps between calls: last torque, and how often it came in a row."""


def screen_torque(
    model: FilterModel, torque_nm: FloatArray, state: FloatArray
) -> tuple[FloatArray, NDArray[np.uint8]]:
    """Return the torque with impossible samples missing, and why.

    Notes
    -----
    Causal: a run of equal torques is flagged from its `stuck_samples`-th sample on, so that blocks
    of any split give the same answer. A missing sample ends a run.
    """
    flags = np.zeros(torque_nm.size, dtype=np.uint8)
    if model.torque_limit_nm is not None:
        flags[np.abs(torque_nm) >= model.torque_limit_nm] |= SATURATED | kalman.MISSING
    if model.stuck_samples is not None and torque_nm.size:
        flags[_run_lengths(torque_nm, state) >= model.stuck_samples] |= STUCK | kalman.MISSING
    return (np.where(flags != 0, np.nan, torque_nm) if flags.any() else torque_nm), flags


def _run_lengths(torque_nm: FloatArray, state: FloatArray) -> FloatArray:
    """Return how many equal torques end at each sample; advance the state."""
    new = np.ones(torque_nm.size, dtype=bool)
    new[1:] = torque_nm[1:] != torque_nm[:-1]
    carried = state[1] if state[1] > 0.0 and torque_nm[0] == state[0] else 0.0
    index = np.arange(torque_nm.size)
    first = np.maximum.accumulate(np.where(new, index, 0))
    length: FloatArray = (index - first + 1).astype(np.float64)
    length = length + np.where(first == 0, carried, 0.0)
    known = bool(np.isfinite(torque_nm[-1]))
    state[0] = torque_nm[-1] if known else 0.0
    state[1] = length[-1] if known else 0.0
    return length


class OnlineFilter:
    r"""Filter samples block by block, with the same bits as in one call.

    Parameters
    ----------
    model : FilterModel
        Orders, noise and expected torque.
    kernel : str or None
        ``c`` or ``numpy``; None takes what `kernel_name` says.

    Notes
    -----
    With :math:`\Phi_i(k)` the rotation by ``order[i] * velocity(k) * (t(k+1) - t(k))`` and
    :math:`C` the sum over the blocks' first states (report CIM-TR-97-06, equations 5-10):

    .. math::
        K = \Phi P C^T / (R + C P C^T), \quad
        x(k+1) = \Phi x + K (y - C x), \quad
        P(k+1) = Q + (\Phi - K C) P \Phi^T

    with :math:`y` = torque - expected torque. The report's models start with P = I and the first
    state of every block at the first residual, and report the prediction 0 for that sample; models
    with a prior start at states 0 with its variances. Slow torque is estimated beside the blocks
    and stays in the filtered torque.

    Missing samples (NaN, or beyond 1e12): without torque or velocity the sample only predicts.
    A missing velocity holds the last one and the last acceleration. Noise per sample is added once
    per row, so for the report's models a gap in time should be filled by rows of NaN, as records
    do; noise per angle or second grows with the gap itself.

    The object owns its state; one thread at a time may call it.
    """

    __slots__ = ("_kernel", "_packed", "_screen", "_state", "model")

    def __init__(self, model: FilterModel, *, kernel: kalman.Form | None = None) -> None:
        self.model = model
        self._kernel: kalman.Form = kalman.kernel_name() if kernel is None else kernel
        kalman.kernel_form(self._kernel)
        self._packed = kalman.pack(model)
        self._state = kalman.new_state(self._packed)
        screened = model.torque_limit_nm is not None or model.stuck_samples is not None
        self._screen = np.zeros(SCREEN_STATES if screened else 0)

    def process(
        self,
        time_s: ArrayLike,
        velocity_rad_s: ArrayLike,
        torque_nm: ArrayLike,
        angle_rad: ArrayLike | None = None,
    ) -> kalman.FilteredBlock:
        """Filter the next samples.

        Parameters
        ----------
        time_s : array_like, shape (n,)
            Sample times, s, finite, strictly increasing also across calls.
        velocity_rad_s : array_like, shape (n,)
            Motor velocity, rad/s; NaN where missing.
        torque_nm : array_like, shape (n,)
            Measured torque, N m; NaN where missing.
        angle_rad : array_like, shape (n,), or None
            Measured motor angle, rad, unwrapped; not used unless the model asks for it.

        Returns
        -------
        FilteredBlock
            One value per sample.

        Raises
        ------
        DataError
            If a time is not finite or does not increase; the state is then unchanged.
        ValueError
            If the arrays are not one-dimensional and of one length.
        """
        angle = angle_rad if self.model.use_measured_angle else None
        torque = np.asarray(torque_nm, dtype=np.float64)
        screen, refused = self._screen.copy(), None
        if screen.size and torque.ndim == 1:
            torque, refused = screen_torque(self.model, torque, screen)
        samples = (time_s, velocity_rad_s, torque, angle)
        found = kalman.run(self._packed, self._state, samples, form=self._kernel)
        self._screen[:] = screen
        return found if refused is None else replace(found, flags=found.flags | refused)

    def state(self) -> FloatArray:
        """Return a copy of the state, to `restore` later with the same bits.

        Returns
        -------
        ndarray, shape (n,)
            Finite numbers only: header (``kernel/filter.h``), block states and one triangle of
            their covariance P as predicted for the last sample, between them P C' of it, in N m
            and (N m)^2; then what the screening for stuck samples keeps, where the model has one.
            Both kernel forms use this layout.
        """
        return np.concatenate((self._state, self._screen))

    def restore(self, state: ArrayLike) -> None:
        """Go on from a state that `state` returned.

        Parameters
        ----------
        state : array_like, shape (n,)
            The state of a filter with as many blocks.

        Raises
        ------
        DataError
            If the length is another one or a number is not finite.
        """
        array = np.array(state, dtype=np.float64)
        needed = self._state.size + self._screen.size
        if array.shape != (needed,) or not np.isfinite(array).all():
            raise DataError(
                f"filter state has shape {array.shape} or holds NaN or infinity; needed: "
                f"{needed} finite numbers for this model",
                where="stored filter state",
                fix="restore a state of this very model, or start the filter anew",
            )
        self._state[:] = array[: self._state.size]
        self._screen[:] = array[self._state.size :]


@dataclass(frozen=True, slots=True)
class BlockAmplitude:
    """Amplitude of one oscillator."""

    block: OscillatorBlock
    amplitude_nm: float
    std_nm: float


def block_amplitudes(model: FilterModel, state: FloatArray) -> tuple[BlockAmplitude, ...]:
    """Return the amplitude of every oscillator of a filter.

    Notes
    -----
    With states a, b of a block and P their covariance: amplitude A = sqrt(a^2 + b^2), variance
    (a^2 P_aa + 2 a b P_ab + b^2 P_bb) / A^2 to first order; (P_aa + P_bb) / 2 at A = 0. Neither
    depends on the phase in which the states are kept.
    """
    size = 2 * (len(model.blocks) + len(model.slow))
    predicted, gain, triangle = np.split(state[kalman.HEADER + size :], (size, 2 * size))
    # the state stands before the last sample's measurement: done here
    states = (predicted + state[kalman.STEP] * gain).tolist()
    rows, columns = np.tril_indices(size)
    covariance = np.zeros((size, size))
    covariance[rows, columns] = triangle[: rows.size] - state[kalman.INVERSE] * (
        gain[rows] * gain[columns]
    )
    found = []
    for i, block in zip(range(0, size, 2), model.blocks, strict=False):
        a, b = states[i : i + 2]
        (aa, _), (ab, bb) = covariance[i : i + 2, i : i + 2].tolist()
        amplitude = math.hypot(a, b)
        variance = (aa + bb) / 2.0
        if amplitude:
            variance = (a * a * aa + 2.0 * a * b * ab + b * b * bb) / amplitude**2
        found.append(BlockAmplitude(block, amplitude, math.sqrt(max(0.0, variance))))
    return tuple(found)


@dataclass(frozen=True, slots=True)
class Channels:
    """Samples as the filter takes them, arrays of shape (n,).

    Parameters
    ----------
    time_s : ndarray
        Sample times, s.
    velocity_rad_s : ndarray
        Motor velocity, rad/s; NaN where missing.
    torque_nm : ndarray
        Measured torque, N m; NaN where missing.
    angle_rad : ndarray or None
        Measured motor angle, rad, unwrapped; None where the velocity turns the blocks.
    source : str
        File of the trace, for messages.
    """

    time_s: FloatArray
    velocity_rad_s: FloatArray
    torque_nm: FloatArray
    angle_rad: FloatArray | None
    source: str

    @property
    def samples(self) -> kalman.Arrays:
        """Time, velocity, torque and angle, in the order in which the filter takes them."""
        return self.time_s, self.velocity_rad_s, self.torque_nm, self.angle_rad

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Which samples have a torque and a velocity that the filter can use."""
        return (np.abs(self.torque_nm) <= kalman.USABLE) & (
            np.abs(self.velocity_rad_s) <= kalman.USABLE
        )


@contextmanager
def faults_of(source: str) -> Iterator[None]:
    """Name the file in the errors of the kernel, which knows samples only."""
    try:
        yield
    except DataError as error:
        where = f"{source}: {error.where}"
        raise DataError(error.what, where=where, fix=error.fix) from error


def filter_channels(trace: Trace, profile: ProfileData, *, use_measured_angle: bool) -> Channels:
    """Return the channels that the filter reads.

    Parameters
    ----------
    trace : Trace
        With ``torque_nm`` and ``motor_velocity_rad_s`` or ``tacho_v``.
    profile : ProfileData
        Gain of the tacho and counts of the encoder, for channels in volts and counts.
    use_measured_angle : bool
        Whether a measured motor angle is wanted where there is one.

    Returns
    -------
    Channels
        The samples.

    Raises
    ------
    DataError
        If a channel is missing.
    """
    if "torque_nm" not in trace:
        raise DataError(
            "there is no channel torque_nm",
            where=trace.source,
            fix="give the torque in N m, or torque_v and a gain in N m/V",
        )
    velocity = velocity_channel(trace, profile)
    angle = angle_channel(trace, profile) if use_measured_angle else None
    return Channels(trace.time_s, velocity, trace["torque_nm"], angle, trace.source)


def run_channels(model: FilterModel, channels: Channels) -> kalman.FilteredBlock:
    """Filter channels as they stand, from the start of the model."""
    packed = kalman.pack(model)
    return kalman.run(packed, kalman.new_state(packed), channels.samples)


def filter_trace(trace: Trace, model: FilterModel, profile: ProfileData) -> kalman.FilteredBlock:
    """Filter a stored trace as it would have been filtered while sampling.

    Parameters
    ----------
    trace : Trace
        With ``torque_nm`` and ``motor_velocity_rad_s`` or ``tacho_v``.
    model : FilterModel
        Orders, noise and expected torque.
    profile : ProfileData
        Gain of the tacho and counts of the encoder, for channels in volts and counts.

    Returns
    -------
    FilteredBlock
        One value per sample; the same bits as `OnlineFilter` on blocks of any length.

    Raises
    ------
    DataError
        If a channel is missing or time does not increase.
    """
    channels = filter_channels(trace, profile, use_measured_angle=model.use_measured_angle)
    with faults_of(trace.source):
        return OnlineFilter(model).process(*channels.samples)


def filtered_columns(trace: Trace, block: kalman.FilteredBlock) -> Trace:
    """Return what `hdbench filter` writes: the torque and what the filter says about it.

    Parameters
    ----------
    trace : Trace
        The trace that was filtered, with ``torque_nm``.
    block : FilteredBlock
        The filter's answer to it.

    Returns
    -------
    Trace
        Time, torque, expected torque, ripple, misalignment, filtered torque; NaN where a sample
        was lost.
    """
    names = ("torque_expected_nm", "ripple_nm", "misalignment_nm", "torque_filtered_nm")
    columns = {name: getattr(block, name) for name in names}
    return Trace(
        {"time_s": trace.time_s, "torque_nm": trace["torque_nm"], **columns}, source=trace.source
    )
