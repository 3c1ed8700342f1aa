"""What is asked of a tuning."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

from hdbench.filter.blocks import SlowKind
from hdbench.profile.schema import ProfileData

__all__ = ["SLOW_CHOICES", "SlowChoice", "TuningSettings", "settings_of"]

SlowChoice = Literal["auto", "none"] | SlowKind
SLOW_CHOICES: tuple[str, ...] = ("auto", "none", *get_args(SlowKind))


@dataclass(frozen=True, slots=True)
class TuningSettings:
    """What is asked of a tuning, beside the model whose orders are tuned.

    Parameters
    ----------
    order_prior_std_nm : float
        Standard deviation of ripple and misalignment before the first sample, N m, > 0.
    slow_prior_std_nm : float
        The same of a constant torque, N m, > 0.
    slow : str
        ``auto``: the stationary kind that the likelihood prefers, beside a slowly walking offset;
        ``none``: no torque but the expected one; or one kind by name.
    gate_sigma : float or None
        Samples beyond so many standard deviations of their innovation count as outliers; None
        keeps all.
    torque_limit_nm : float or None
        Torque at or beyond which the sensor is saturated, N m; None where it is not known.
    max_evaluations : int
        Evaluations of the likelihood per start, >= 50.

    Raises
    ------
    ValueError
        If a number or choice is out of its domain.
    """

    order_prior_std_nm: float
    slow_prior_std_nm: float
    slow: SlowChoice = "auto"
    gate_sigma: float | None = 6.0
    torque_limit_nm: float | None = None
    max_evaluations: int = 1500

    def __post_init__(self) -> None:
        for name in ("order_prior_std_nm", "slow_prior_std_nm"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} is {getattr(self, name)!r}; needed: finite, above 0")
        if self.slow not in SLOW_CHOICES:
            raise ValueError(f"slow is {self.slow!r}; needed: {', '.join(SLOW_CHOICES)}")
        # below 4 a gate cuts into Gaussian noise: one sample in 16 000
        if self.gate_sigma is not None and not 4.0 <= self.gate_sigma < math.inf:
            raise ValueError(f"gate_sigma is {self.gate_sigma!r}; needed: at least 4, or None")
        limit = self.torque_limit_nm
        if limit is not None and not 0.0 < limit < math.inf:
            raise ValueError(f"torque_limit_nm is {limit!r}; needed: finite, above 0, or None")
        if not self.max_evaluations >= 50:
            raise ValueError(f"max_evaluations is {self.max_evaluations!r}; needed: at least 50")


# ripple and misalignment stay below a tenth of the rated torque on a bench worth filtering
_ORDER_SHARE = 0.1


def settings_of(profile: ProfileData, *, slow: SlowChoice = "auto") -> TuningSettings:
    """Return the settings that a bench's own numbers give.

    Parameters
    ----------
    profile : ProfileData
        The bench: rated torque, sensor gain and converter range.
    slow : str
        As in `TuningSettings`.

    Returns
    -------
    TuningSettings
        Priors of a tenth of the rated torque for each order and of the rated torque for the
        offset; the torque at which the converter saturates.
    """
    rated = profile.drive.rated_torque_nm
    return TuningSettings(
        order_prior_std_nm=_ORDER_SHARE * rated,
        slow_prior_std_nm=rated,
        slow=slow,
        torque_limit_nm=abs(profile.sensor.gain_nm_per_v) * profile.daq.range_v,
    )
