"""The blocks of a filter model: oscillators locked to the motor or the clock, and slow torque."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

__all__ = ["NoisePer", "OscillatorBlock", "Role", "SlowBlock", "SlowKind"]

Role = Literal["ripple", "misalignment"]
NoisePer = Literal["sample", "motor-radian", "second"]
SlowKind = Literal[
    "random-walk",
    "integrated-random-walk",
    "ornstein-uhlenbeck",
    "matern-3/2",
    "resonance",
]
_WALKS = ("random-walk", "integrated-random-walk")


def _positive(name: str, value: float) -> None:
    if not 0.0 < value < math.inf:
        raise ValueError(f"{name} is {value!r}; needed: a finite number above 0")


@dataclass(frozen=True, slots=True)
class OscillatorBlock:
    """One oscillator: a torque component locked to motor or clock, and its quadrature.

    Parameters
    ----------
    order : float
        Cycles per wave-generator turn, > 0; 0 for a block locked to the clock.
    role : {"ripple", "misalignment"}
        Which output carries it: torque ripple, or misalignment at an output order.
    process_noise : float
        Q of both states, (N m)^2 per unit of `noise_per`, > 0.
    noise_per : {"sample", "motor-radian", "second"}
        What the process noise grows with: samples (as in the report), the turned angle of the
        motor (tuned models: nothing grows while it stands), or time.
    frequency_hz : float
        Frequency of a block locked to the clock, Hz, > 0; 0 for an order.

    Raises
    ------
    ValueError
        If a number is out of its domain, or a role or unit is unknown.
    """

    order: float
    role: Role
    process_noise: float
    noise_per: NoisePer = "sample"
    frequency_hz: float = 0.0

    def __post_init__(self) -> None:
        if self.frequency_hz == 0.0:
            _positive("order", self.order)
        else:
            _positive("frequency_hz", self.frequency_hz)
            if self.order != 0.0:
                raise ValueError(
                    f"order is {self.order!r} beside frequency_hz {self.frequency_hz!r}; "
                    "needed: one of them above 0, the other 0"
                )
        _positive("process_noise", self.process_noise)
        if self.role not in get_args(Role):
            raise ValueError(f"role is {self.role!r}; needed: ripple or misalignment")
        if self.noise_per not in get_args(NoisePer):
            raise ValueError(
                f"noise_per is {self.noise_per!r}; needed: {', '.join(get_args(NoisePer))}"
            )


@dataclass(frozen=True, slots=True)
class SlowBlock:
    r"""Torque that the filter keeps: what it believes of torque that nobody told it.

    Parameters
    ----------
    kind : str
        ``random-walk``, ``integrated-random-walk``; or stationary, with bounded variance at every
        frequency: ``ornstein-uhlenbeck``, ``matern-3/2``, ``resonance``.
    noise_per_s : float
        Of the walks: growth of the variance, (N m)^2 per second; of the slope's variance,
        (N m/s)^2 per second, for the integrated one. > 0.
    variance : float
        Of the stationary kinds: (N m)^2, > 0.
    time_constant_s : float
        T of the stationary kinds, s, > 0: covariance ``variance * exp(-|tau|/T)``,
        ``variance * (1 + |tau|/T) * exp(-|tau|/T)``; for a resonance that of its envelope.
    frequency_hz : float
        Undamped natural frequency f of a resonance, Hz, with ``2 pi f T >= 1``.

    Raises
    ------
    ValueError
        If a number is out of its domain or does not belong to the kind.

    Notes
    -----
    A resonance is :math:`\ddot\tau + (2/T)\dot\tau + (2\pi f)^2\tau = w` with white w: at
    :math:`2\pi f T = 1` it is Matern 3/2, at :math:`\sqrt 2` second-order Butterworth noise, and
    for large T a sine of slowly changing amplitude and phase.
    """

    kind: SlowKind
    noise_per_s: float = 0.0
    variance: float = 0.0
    time_constant_s: float = 0.0
    frequency_hz: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in get_args(SlowKind):
            raise ValueError(f"kind is {self.kind!r}; needed: {', '.join(get_args(SlowKind))}")
        needed = self.parameters
        for name in ("noise_per_s", "variance", "time_constant_s", "frequency_hz"):
            value = getattr(self, name)
            if name in needed:
                _positive(name, value)
            elif value != 0.0:
                raise ValueError(f"{name} is {value!r}; a {self.kind} has no such number")
        # 1e-9: rounding of a number written and read again
        if self.kind == "resonance" and not (
            2.0 * math.pi * self.frequency_hz * self.time_constant_s > 1.0 - 1e-9
        ):
            raise ValueError("a resonance needs time_constant_s >= 1 / (2 pi frequency_hz)")

    @property
    def stationary(self) -> bool:
        """Whether its variance is bounded."""
        return self.kind not in _WALKS

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the numbers that its kind has."""
        if not self.stationary:
            return ("noise_per_s",)
        common = ("variance", "time_constant_s")
        return (*common, "frequency_hz") if self.kind == "resonance" else common
