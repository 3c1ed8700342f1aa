"""What the causes of an extended model add to the torque channel, in motion and under weights."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hdbench.plant.extended import cause_volts
from hdbench.plant.fixture import Mount
from hdbench.plant.lockedcauses import LockedCauses
from hdbench.plant.torque import AnalogueChannels
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray

if TYPE_CHECKING:
    from hdbench.model import BenchModel

__all__ = ["ModelCauses"]


class ModelCauses:
    """Causes of the model that an emulated bench follows.

    Parameters
    ----------
    model : BenchModel or None
        An extended model; None has no causes.
    profile : ProfileData
        The bench with the model's baseline.
    """

    def __init__(self, model: BenchModel | None, profile: ProfileData) -> None:
        self._model = model
        self._locked = None if model is None else LockedCauses(model, profile)
        self._volts: FloatArray = np.zeros(1)

    @property
    def names(self) -> list[str]:
        """Names of the causes."""
        return [] if self._model is None else [term.name for term in self._model.causes]

    @property
    def any(self) -> bool:
        """Whether an extended model is followed."""
        return self._model is not None

    def restart(self, elapsed_s: float) -> None:
        """Count time from a new acquisition, `elapsed_s` after the one before began."""
        if self._locked is not None:
            self._locked.restart(elapsed_s)

    def change(self, mount: Mount) -> None:
        """Take note of what is mounted from now on."""
        if self._locked is not None:
            self._locked.change(mount)

    def move(
        self,
        channels: AnalogueChannels,
        mount: Mount,
        sample_period_s: float,
        reference_v: FloatArray,
    ) -> None:
        """Compute the causes for a whole motion; those of a locked bench come by their time."""
        self._volts = np.zeros(1)
        if self._model is not None and not mount.locked:
            self._volts = cause_volts(self._model, channels, mount, sample_period_s, reference_v)

    def volts(self, stamps: NDArray[np.int64], time_s: FloatArray) -> FloatArray:
        """Return what the causes add at samples."""
        volts: FloatArray = self._volts[np.minimum(stamps, len(self._volts) - 1)]
        return volts if self._locked is None else volts + self._locked.volts(time_s)
