"""The filter while samples come."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hdbench.errors import DataError
from hdbench.filter.core import kernel_name, run_form
from hdbench.filter.layout import state_size
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
    """

    torque_expected_nm: FloatArray
    ripple_nm: FloatArray
    misalignment_nm: FloatArray
    torque_filtered_nm: FloatArray


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

    with :math:`y` = torque - expected torque. P = I and the first state of every block is the
    first residual at the start; the prediction reported for that sample is 0.

    Missing samples (NaN, or beyond 1e12): without torque or velocity the sample only predicts.
    A missing velocity holds the last one and the last acceleration. Q is added once per row, so a
    gap in time should be filled by rows of NaN, as records do.

    The object owns its state; one thread at a time may call it.
    """

    __slots__ = ("_kernel", "_parameters", "_run", "_state", "model")

    def __init__(self, model: FilterModel, *, kernel: str | None = None) -> None:
        self.model = model
        self._kernel = kernel_name() if kernel is None else kernel
        self._run = run_form(self._kernel)
        blocks = model.blocks
        self._parameters = (
            np.array([block.order for block in blocks]),
            np.array([block.process_noise for block in blocks]),
            np.array([float(block.role == "misalignment") for block in blocks]),
            np.array(
                [
                    model.measurement_noise,
                    model.load_inertia_kg_m2,
                    model.gear_ratio,
                    model.differentiator_time_constant_s,
                ]
            ),
        )
        self._state = np.zeros(state_size(len(blocks)))

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
        out = FilteredBlock(*(np.empty(time.size) for _ in range(4)))
        bad = self._run(
            *self._parameters,
            self._state,
            time,
            velocity,
            torque,
            angle,
            out.torque_expected_nm,
            out.ripple_nm,
            out.misalignment_nm,
            out.torque_filtered_nm,
        )
        if bad >= 0:
            raise DataError(
                f"time_s is {time[bad]!r} s; needed: finite and later than the sample before",
                where=f"sample {bad} of the block",
                fix="sort the samples by time and remove repeated ones",
            )
        return out

    def state(self) -> FloatArray:
        """Return a copy of the state, to `restore` later with the same bits.

        Returns
        -------
        ndarray, shape (state_size(n_blocks),)
            Finite numbers only: header (`hdbench.filter.layout`), block states and one triangle of
            their covariance, in N m and (N m)^2. Both kernel forms use this layout.
        """
        return self._state.copy()

    def restore(self, state: ArrayLike) -> None:
        """Go on from a state that `state` returned.

        Parameters
        ----------
        state : array_like, shape (state_size(n_blocks),)
            The state of a filter with as many blocks.

        Raises
        ------
        DataError
            If the length is another one or a number is not finite.
        """
        array = np.array(state, dtype=np.float64)
        if array.shape != self._state.shape or not np.isfinite(array).all():
            raise DataError(
                f"filter state has shape {array.shape} or holds NaN or infinity; needed: "
                f"{self._state.size} finite numbers for {len(self.model.blocks)} blocks",
                where="stored filter state",
                fix="restore a state of this very model, or start the filter anew",
            )
        self._state[:] = array


def _vector(values: ArrayLike) -> FloatArray:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != 1:
        raise ValueError(f"found an array of shape {array.shape}; needed: one dimension")
    return array
