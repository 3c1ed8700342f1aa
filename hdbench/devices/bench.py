"""Bench: what a session needs of it, its samples in their units, and the limits that they keep."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from hdbench.records.trace import FloatArray

if TYPE_CHECKING:
    from hdbench.devices.operator import Simulation
    from hdbench.profile.schema import Limits, ProfileData, ReferenceWave
    from hdbench.profile.waves import ReferenceProgram

# 0.1 % above a limit is within the converter's scale error, not a crossing
_MARGIN = 1.001
# columns that a bench without the channel does not have
_COLUMNS_OF = {
    "encoder": ("motor_angle_rad", "encoder_count"),
    "current": ("motor_current_a",),
    "reference": ("reference_v",),
}


@dataclass(frozen=True, slots=True)
class Identity:
    """Who answers on the wire.

    Parameters
    ----------
    vendor, model, serial, firmware : str
        As the device tells them, control characters removed.
    simulated : bool
        True where the device says that it is an emulator. That is only its word: what may move
        unasked is decided by `Bench.simulation`.
    """

    vendor: str
    model: str
    serial: str
    firmware: str
    simulated: bool


@dataclass(frozen=True, slots=True)
class AcquisitionSettings:
    """One acquisition: the parameter block of the node.

    Parameters
    ----------
    sample_period_s : float
        Sampling period, s.
    n_samples : int
        Samples to take; the node stops and zeroes the motor reference by itself after them.
    reference : ReferenceWave, ReferenceProgram or None
        Reference generator in volts: one wave, or parts one after the other; None
        keeps the drive disabled (locked wave generator).
    """

    sample_period_s: float
    n_samples: int
    reference: ReferenceWave | ReferenceProgram | None


@dataclass(frozen=True, slots=True)
class Block:
    """Samples of one acknowledged transaction.

    Parameters
    ----------
    first_index : int
        Index of the first sample since the start of the acquisition.
    lost_before : int
        Samples lost between the previous block and this one.
    torque_v, tacho_v, motor_current_a, reference_v : ndarray, shape (n,)
        Channels in volts or amperes.
    encoder_count : ndarray of int64, shape (n,)
        Unwrapped encoder counts.
    saturated : ndarray of bool, shape (n,)
        True where torque, tacho or reference sits at the end of its range. The motor current does
        not count: at the end of its range the amplifier limits, not the converter.
    running : bool
        Whether the node is still sampling.
    watchdog_tripped : bool
        Whether the node has zeroed the motor for want of a host.
    depth : int
        Samples still waiting in the node; at least 1 while losses at the end are untold.
    time_s : ndarray, shape (n,), or None
        Time of every sample since the start, s, where the host asked for each of them (a polled
        device); None where the device samples on its own clock, every period.
    absent : tuple of str
        ``encoder``, ``current``, ``reference``, ``tacho``, ``torque``: what is not measured on this
        bench. Its values are NaN throughout, an encoder's counts 0.
    repeats : int
        Requests that the driver has sent again since it was opened.
    """

    first_index: int
    lost_before: int
    torque_v: FloatArray
    tacho_v: FloatArray
    motor_current_a: FloatArray
    reference_v: FloatArray
    encoder_count: NDArray[np.int64]
    saturated: NDArray[np.bool_]
    running: bool
    watchdog_tripped: bool
    depth: int
    time_s: FloatArray | None = None
    absent: tuple[str, ...] = ()
    repeats: int = 0

    def __len__(self) -> int:
        return len(self.torque_v)


@dataclass(frozen=True, slots=True)
class SafeState:
    """What was read back after making the bench safe.

    Parameters
    ----------
    confirmed : bool
        True when the reference read back is zero, the drive is disabled and the motor stands.
    reference_v : float or None
        Reference read back, V; None when no answer came.
    velocity_rad_s : float or None
        Motor speed read back, rad/s; None when no answer came.
    detail : str
        One line for a person.
    """

    confirmed: bool
    reference_v: float | None
    velocity_rad_s: float | None
    detail: str


class Bench(Protocol):
    """A bench controller on the wire; every call keeps its own deadline.

    Every method raises `DeviceError` when the device does not answer in time, answers wrongly, or
    answers with an exception. No call repeats a motion write by itself.

    Attributes
    ----------
    simulation : Simulation or None
        Control channel of a simulated bench. Without it the bench is a real one, whatever the
        device says of itself.
    """

    @property
    def simulation(self) -> Simulation | None:
        """Control channel of a simulated bench."""

    def identity(self) -> Identity:
        """Return who answers."""

    def configure(self, settings: AcquisitionSettings) -> None:
        """Write the parameter block and the watchdog time, and read both back."""

    def start(self) -> None:
        """Start sampling and, with a reference, the motion."""

    def read_block(self) -> Block | None:
        """Acknowledge the previous block and return the next; None when none is ready yet.

        A block that is not `running` and has no `depth` is the last one. A call after it returns an
        empty one again. After an empty answer the next call waits a little by itself.
        """

    def stop(self) -> None:
        """Stop the acquisition normally; samples already taken can still be read."""

    def safe_state(self) -> SafeState:
        """Make the bench safe from any state, twice if need be; never raises."""

    def close(self) -> None:
        """Close the connection; never raises."""


class Operator(Protocol):
    """A person at the bench, or one who is simulated."""

    def confirm_lock(self, *, locked: bool) -> bool:
        """Ask for the wave generator to be locked (or released); True when confirmed."""

    def set_position(self, position_rad: float, *, index: int, count: int) -> bool:
        """Ask for a flexspline position, rad; True when confirmed."""

    def hang(self, mass_kg: float, *, direction: str, expected_nm: float, step: str) -> bool:
        """Ask for `mass_kg` on the arm for `direction` (``cw`` or ``ccw``); True when done."""

    def confirm_motion(self, description: str) -> bool:
        """Ask whether the motor may move; True when it may."""


def scaled(block: Block, profile: ProfileData, gain_nm_per_v: float) -> dict[str, FloatArray]:
    """Return the channels of a block in their units; a lost sample is NaN."""
    counts = block.encoder_count.astype(np.float64)
    present = {
        "motor_velocity_rad_s": block.tacho_v * profile.tacho.gain_rad_s_per_v,
        "motor_angle_rad": counts * (2.0 * math.pi / profile.encoder.counts_per_turn),
        "encoder_count": counts,
        "torque_nm": block.torque_v * gain_nm_per_v,
        "torque_v": block.torque_v,
        "tacho_v": block.tacho_v,
        "motor_current_a": block.motor_current_a,
        "reference_v": block.reference_v,
    }
    missing = {name for role in block.absent for name in _COLUMNS_OF.get(role, ())}
    lost = np.full(block.lost_before, math.nan)
    return {
        name: np.concatenate((lost, values))
        for name, values in present.items()
        if name not in missing
    }


def crossed_limit(
    block: Block, rows: Mapping[str, FloatArray], limits: Limits
) -> tuple[str, int] | None:
    """Return which limit of speed, torque or current the rows of a block cross, and the sample."""
    for name, role, column, limit, unit in (
        ("motor speed", "tacho", "motor_velocity_rad_s", limits.velocity_rad_s, "rad/s"),
        ("torque", "torque", "torque_nm", limits.torque_nm, "N m"),
        ("motor current", "current", "motor_current_a", limits.current_a, "A"),
    ):
        if role not in block.absent and column in rows:
            values = rows[column][block.lost_before :]
            found = beyond(name, values, (limit, unit), block.first_index)
            if found is not None:
                return found
    return None


def beyond(
    name: str, values: FloatArray, limit: tuple[float, str], first_index: int
) -> tuple[str, int] | None:
    """Return what is beyond a limit, and the index of that sample."""
    most, unit = limit
    # written so that NaN counts as a crossing
    at = np.flatnonzero(~(np.abs(values) <= _MARGIN * most))
    if not len(at):
        return None
    what = f"{name} {float(values[at[0]]):+.6g} {unit} crossed the limit {most:g} {unit}"
    return what, int(first_index + at[0])
