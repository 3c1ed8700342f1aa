"""The state-space model that the kernel runs: blocks of two states, seen through one scalar."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from hdbench.filter.layout import BLOCK, MAX_BLOCKS, MODEL_HEADER
from hdbench.records import FloatArray

__all__ = ["Kind", "Part", "StateBlock", "StateSpace", "pack"]

Kind = Literal[
    "oscillator",
    "random-walk",
    "integrated-random-walk",
    "ornstein-uhlenbeck",
    "matern-3/2",
    "resonance",
]
Part = Literal["ripple", "misalignment", "slow"]
_KINDS: tuple[Kind, ...] = get_args(Kind)
_PARTS: tuple[Part, ...] = get_args(Part)
_STATIONARY = ("ornstein-uhlenbeck", "matern-3/2", "resonance")


@dataclass(frozen=True, slots=True)
class StateBlock:
    r"""One block: a torque component (first state, N m) and its companion.

    Parameters
    ----------
    kind : str
        ``oscillator``; or a slow torque: ``random-walk``, ``integrated-random-walk``,
        ``ornstein-uhlenbeck``, ``matern-3/2``, ``resonance``.
    part : str
        ``ripple`` or ``misalignment`` (taken off the torque), or ``slow`` (true torque, kept).
        Slow kinds are ``slow``; an oscillator is not.
    order : float
        Oscillator: cycles per motor turn (1/N for once per output turn); 0 for a clock block.
    frequency_hz : float
        Oscillator: frequency of a block locked to the clock, Hz; 0 for an order. Resonance: its
        undamped natural frequency f, Hz.
    noise_per_sample, noise_per_rad, noise_per_s : float
        Process noise: (N m)^2 added to each state's variance per sample, per radian of the
        *motor*, per second. A random walk takes the first and the last; an integrated random walk
        the last only, on its slope: (N m/s)^2 per second.
    variance : float
        Stationary variance of ``ornstein-uhlenbeck``, ``matern-3/2``, ``resonance``, (N m)^2.
    time_constant_s : float
        T of those, s: covariance ``variance * exp(-|tau|/T)`` or
        ``variance * (1 + |tau|/T) * exp(-|tau|/T)``; a resonance is the free decay with envelope
        ``exp(-|tau|/T)``, at least 1 / (2 pi f): there it is ``matern-3/2``.
    prior_variance, prior_variance_2 : float
        Variance of the first and second state at the start, (N m)^2 ((N m/s)^2 for a slow slope).
        Not used where the model starts as the listing does.

    Raises
    ------
    ValueError
        If a number is out of its domain, or does not belong to this kind.

    Notes
    -----
    An oscillator turns by ``a = order * D + 2 pi frequency_hz * dt`` with the motor turn D:
    :math:`\Phi = [\cos a, \sin a; -\sin a, \cos a]`, so the first state is
    ``A cos(psi)``, the second ``-A sin(psi)``. Its process noise is isotropic, of variance
    ``noise_per_sample + noise_per_rad * |D| + noise_per_s * dt`` in each state.
    """

    kind: Kind
    part: Part
    order: float = 0.0
    frequency_hz: float = 0.0
    noise_per_sample: float = 0.0
    noise_per_rad: float = 0.0
    noise_per_s: float = 0.0
    variance: float = 0.0
    time_constant_s: float = 0.0
    prior_variance: float = 1.0
    prior_variance_2: float = 1.0

    def __post_init__(self) -> None:
        if self.kind not in _KINDS:
            raise ValueError(f"kind is {self.kind!r}; needed: {', '.join(_KINDS)}")
        if (self.kind == "oscillator") == (self.part == "slow") or self.part not in _PARTS:
            raise ValueError(f"a block of kind {self.kind!r} cannot be the part {self.part!r}")
        for name in self.__slots__[2:]:
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ValueError(f"{name} is {value!r}; needed: a finite number, at least 0")
        if self.kind == "oscillator":
            if (self.order > 0.0) == (self.frequency_hz > 0.0):
                raise ValueError("an oscillator needs either order or frequency_hz above 0")
        elif self.kind == "resonance":
            # aperiodic damping is left to the other kinds; 1e-9 for the rounding of a file
            if not 2.0 * math.pi * self.frequency_hz * self.time_constant_s > 1.0 - 1e-9:
                raise ValueError("a resonance needs time_constant_s >= 1 / (2 pi frequency_hz)")
        elif self.order > 0.0 or self.frequency_hz > 0.0:
            raise ValueError(f"a block of kind {self.kind!r} has neither order nor frequency_hz")
        stationary = self.kind in _STATIONARY
        if stationary != (self.variance > 0.0) or stationary != (self.time_constant_s > 0.0):
            raise ValueError(
                f"a block of kind {self.kind!r} needs variance and time_constant_s "
                f"{'above' if stationary else 'to be'} 0"
            )

    @property
    def n_states(self) -> int:
        """Number of states that this kind has, 1 or 2."""
        return 1 if self.kind in ("random-walk", "ornstein-uhlenbeck") else 2


@dataclass(frozen=True, slots=True)
class StateSpace:
    """Blocks, measurement noise, expected torque, and how the filter starts.

    Parameters
    ----------
    blocks : tuple of StateBlock
        1 to 16 blocks, in any order.
    measurement_noise : float
        R, (N m)^2, > 0.
    load_inertia_kg_m2, gear_ratio, differentiator_time_constant_s : float
        J (>= 0), N (> 0) and T (> 0) of the expected torque J * acceleration / N.
    start : {"prior", "listing"}
        ``prior``: states 0 with the blocks' prior variances at the first sample. ``listing``: P = I
        and the first state of every block the first residual; the prediction there is 0.
    gate_sigma : float or None
        A sample whose innovation is beyond this many standard deviations only predicts; None: no
        gate.
    gate_samples : int
        So many samples in a row are gated at most; the next one is taken, so that a step of the
        torque is not refused for ever.

    Raises
    ------
    ValueError
        If a number is out of its domain.
    """

    blocks: tuple[StateBlock, ...]
    measurement_noise: float
    load_inertia_kg_m2: float = 0.0
    gear_ratio: float = 1.0
    differentiator_time_constant_s: float = 1.0
    start: Literal["prior", "listing"] = "prior"
    gate_sigma: float | None = None
    gate_samples: int = 5

    def __post_init__(self) -> None:
        if not 1 <= len(self.blocks) <= MAX_BLOCKS:
            raise ValueError(f"found {len(self.blocks)} blocks, needed 1 to {MAX_BLOCKS}")
        for name in ("measurement_noise", "gear_ratio", "differentiator_time_constant_s"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} is {getattr(self, name)!r}; needed: finite, above 0")
        if not 0.0 <= self.load_inertia_kg_m2 < math.inf:
            raise ValueError(f"load_inertia_kg_m2 is {self.load_inertia_kg_m2!r}; needed: >= 0")
        if self.gate_sigma is not None and not 0.0 < self.gate_sigma < 1e6:
            raise ValueError(f"gate_sigma is {self.gate_sigma!r}; needed: above 0, or None")
        if not self.gate_samples >= 1:
            raise ValueError(f"gate_samples is {self.gate_samples!r}; needed: at least 1")
        if self.start not in ("prior", "listing"):
            raise ValueError(f"start is {self.start!r}; needed: prior or listing")
        if self.start == "listing" and any(block.part == "slow" for block in self.blocks):
            raise ValueError("the listing knows no slow torque; start such a model at its prior")

    def kernel_order(self) -> list[int]:
        """Return the index of each block as the kernel holds them: oscillators first."""
        return sorted(range(len(self.blocks)), key=lambda i: self.blocks[i].kind != "oscillator")


def pack(model: StateSpace) -> FloatArray:
    """Return the model as the vector that the kernel reads."""
    blocks = [model.blocks[i] for i in model.kernel_order()]
    n_oscillators = sum(block.kind == "oscillator" for block in blocks)
    gate = 0.0 if model.gate_sigma is None else model.gate_sigma
    header = [
        n_oscillators,
        len(blocks) - n_oscillators,
        model.measurement_noise,
        model.load_inertia_kg_m2,
        model.gear_ratio,
        model.differentiator_time_constant_s,
        gate * gate,
        model.gate_samples,
        float(model.start == "prior"),
    ]
    rows = [header, *(_row(block) for block in blocks)]
    packed = np.array([value for row in rows for value in row], dtype=np.float64)
    if packed.size != MODEL_HEADER + BLOCK * len(blocks):
        raise ValueError(f"packed {packed.size} numbers for {len(blocks)} blocks")
    return packed


def _damped(block: StateBlock) -> float:
    """Return the damped angular frequency of a resonance, rad/s; where it is 0, next to nothing."""
    natural, rate = 2.0 * math.pi * block.frequency_hz, 1.0 / block.time_constant_s
    # a millionth of the natural frequency differs from critical damping by 1e-12 of the covariance
    return max(math.sqrt(max(natural * natural - rate * rate, 0.0)), 1e-6 * natural)


def _row(block: StateBlock) -> list[float]:
    second = block.prior_variance_2 if block.n_states == 2 else 0.0
    return [
        _KINDS.index(block.kind),
        _PARTS.index(block.part),
        _damped(block) if block.kind == "resonance" else block.order,
        2.0 * math.pi * block.frequency_hz,
        block.noise_per_sample,
        block.noise_per_rad,
        block.noise_per_s,
        1.0 / block.time_constant_s if block.time_constant_s > 0.0 else 0.0,
        block.variance,
        block.prior_variance,
        second,
    ]
