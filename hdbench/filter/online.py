"""The filter while samples come."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdbench.errors import DataError
from hdbench.filter.assemble import state_space
from hdbench.filter.core import Form, kernel_form, kernel_name
from hdbench.filter.guard import GUARD_STATES, guard_torque
from hdbench.filter.kalman import new_state, run
from hdbench.filter.model import FilterModel
from hdbench.records import FloatArray

__all__ = ["FilteredBlock", "OnlineFilter"]


@dataclass(frozen=True, slots=True)
class FilteredBlock:
    """What the filter says about each sample, arrays of shape (n_samples,), N m.

    Parameters
    ----------
    torque_expected_nm : ndarray
        J_load * acceleration / N by the online differentiator.
    ripple_nm : ndarray
        Predicted sum of the ripple blocks, from earlier samples only.
    misalignment_nm : ndarray
        Predicted sum of the output-order blocks, from earlier samples only.
    torque_filtered_nm : ndarray
        Torque minus both predictions; NaN where the torque is missing.
    slow_nm : ndarray
        Predicted slow torque, which the filtered torque keeps; 0 where the model has none.
    innovation_nm : ndarray
        Torque minus everything predicted; NaN where the sample is missing.
    innovation_variance_nm2 : ndarray
        What the model claims of its variance, (N m)^2; NaN before the filter has started.
    flags : ndarray of uint8
        0, or bits: 1 missing, 2 gated as an outlier, 4 an order not resolved (as at standstill),
        8 saturated, 16 stuck.
    """

    torque_expected_nm: FloatArray
    ripple_nm: FloatArray
    misalignment_nm: FloatArray
    torque_filtered_nm: FloatArray
    slow_nm: FloatArray
    innovation_nm: FloatArray
    innovation_variance_nm2: FloatArray
    flags: NDArray[np.uint8]


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

    __slots__ = ("_guard", "_kernel", "_space", "_state", "model")

    def __init__(self, model: FilterModel, *, kernel: Form | None = None) -> None:
        self.model = model
        self._kernel: Form = kernel_name() if kernel is None else kernel
        kernel_form(self._kernel)
        self._space = state_space(model)
        self._state = new_state(self._space)
        guarded = model.torque_limit_nm is not None or model.stuck_samples is not None
        self._guard = np.zeros(GUARD_STATES if guarded else 0)

    @property
    def kernel(self) -> str:
        """Form that runs: ``c`` or ``numpy``."""
        return self._kernel

    def process(
        self,
        time_s: ArrayLike,
        velocity_rad_s: ArrayLike,
        torque_nm: ArrayLike,
        angle_rad: ArrayLike | None = None,
    ) -> FilteredBlock:
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
        time, velocity, torque = (_vector(v) for v in (time_s, velocity_rad_s, torque_nm))
        use_angle = self.model.use_measured_angle and angle_rad is not None
        angle = _vector(angle_rad) if angle_rad is not None and use_angle else None
        for name, array in (("velocity_rad_s", velocity), ("torque_nm", torque), ("angle", angle)):
            if array is not None and array.size != time.size:
                raise ValueError(f"{name} has {array.size} samples, time_s {time.size}")
        guard, refused = self._guard.copy(), None
        if guard.size:
            torque, refused = guard_torque(self.model, torque, guard)
        found = run(
            self._space,
            self._state,
            time,
            velocity,
            torque,
            angle_rad=angle,
            form=self._kernel,
        )
        self._guard[:] = guard
        return FilteredBlock(
            found.torque_expected_nm,
            found.ripple_nm,
            found.misalignment_nm,
            found.torque_filtered_nm,
            found.slow_nm,
            found.innovation_nm,
            found.innovation_variance_nm2,
            found.flags if refused is None else found.flags | refused,
        )

    def state(self) -> FloatArray:
        """Return a copy of the state, to `restore` later with the same bits.

        Returns
        -------
        ndarray, shape (n,)
            Finite numbers only: header (`hdbench.filter.layout`), block states and one triangle of
            their covariance P as predicted for the last sample, between them P C' of it, in N m
            and (N m)^2; then what the guard against stuck samples keeps, where the model has one.
            Both kernel forms use this layout.
        """
        return np.concatenate((self._state, self._guard))

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
        needed = self._state.size + self._guard.size
        if array.shape != (needed,) or not np.isfinite(array).all():
            raise DataError(
                f"filter state has shape {array.shape} or holds NaN or infinity; needed: "
                f"{needed} finite numbers for {len(self._space.blocks)} blocks",
                where="stored filter state",
                fix="restore a state of this very model, or start the filter anew",
            )
        self._state[:] = array[: self._state.size]
        self._guard[:] = array[self._state.size :]


def _vector(values: ArrayLike) -> FloatArray:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != 1:
        raise ValueError(f"found an array of shape {array.shape}; needed: one dimension")
    return array
