"""Filter model: oscillators, slow torque, noise, and where each number is from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat

from hdbench.errors import DataError
from hdbench.records import FloatArray
from hdbench.results import Part

SCHEMA = "hdbench/filter-model/1"
MAX_BLOCKS = 16
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
# files leave out what is not set
_ABSENT = Field(exclude_if=lambda value: not value)
_Set = Annotated[NonNegativeFloat, _ABSENT]
_Limit = Annotated[PositiveFloat | None, _ABSENT]
_FIX = "correct the filter-model file or write it again"


class OscillatorBlock(Part, kw_only=False, closed=True, strict=True):
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

    order: NonNegativeFloat
    role: Role
    process_noise: PositiveFloat
    noise_per: Annotated[NoisePer, Field(exclude_if=lambda unit: unit == "sample")] = "sample"
    frequency_hz: _Set = 0.0

    def __post_init__(self) -> None:
        if (self.order > 0.0) == (self.frequency_hz > 0.0):
            raise ValueError(
                f"order is {self.order!r} beside frequency_hz {self.frequency_hz!r}; "
                "needed: one of them above 0, the other 0"
            )

    def turned(self, angle_rad: FloatArray, elapsed_s: FloatArray) -> FloatArray:
        """Return the angle of its torque by the motor's angle or by the clock, rad."""
        return self.order * angle_rad + 2.0 * math.pi * self.frequency_hz * elapsed_s

    def frequency_at(self, speed_rad_s: float) -> float:
        """Return its frequency at a speed of the motor, Hz."""
        return self.frequency_hz or self.order * abs(speed_rad_s) / (2.0 * math.pi)


class SlowBlock(Part, kw_only=False, closed=True, strict=True):
    r"""Torque that the filter estimates and keeps: a torque unknown to the expected torque.

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
    noise_per_s: _Set = 0.0
    variance: _Set = 0.0
    time_constant_s: _Set = 0.0
    frequency_hz: _Set = 0.0

    def __post_init__(self) -> None:
        for name in ("noise_per_s", "variance", "time_constant_s", "frequency_hz"):
            value = getattr(self, name)
            if (value > 0.0) != (name in self.parameters):
                needed = "above 0" if value == 0.0 else "0, as its kind has no such number"
                raise ValueError(f"{name} of a {self.kind} is {value!r}; needed: {needed}")
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

    @property
    def n_states(self) -> int:
        """Number of states of its kind: the torque, and its slope where it has one."""
        return 1 if self.kind in ("random-walk", "ornstein-uhlenbeck") else 2


class FilterModel(Part, kw_only=False, closed=True, strict=True):
    """Oscillator blocks with their noise, and the expected torque they are held against.

    Parameters
    ----------
    name : str
        ``report-a1``, ``report-a2``, ``report-6``, or the name of a model file or result.
    blocks : tuple of OscillatorBlock
        1 to 16 blocks, with the slow ones, of different orders and frequencies.
    measurement_noise : float
        R, (N m)^2, > 0.
    load_inertia_kg_m2 : float
        J of the expected torque J * acceleration / N, kg m^2, >= 0; 0 expects no torque.
    gear_ratio : float
        N, motor turns per output turn, > 0.
    differentiator_time_constant_s : float
        T of the differentiator s / (T s + 1), s, > 0.
    use_measured_angle : bool
        Whether blocks turn with a measured motor angle where there is one, else with the velocity.
    torque_gain_nm_per_v : float or None
        Calibrated torque per volt, N m/V, for traces in volts; None where no calibration was fed.
    provenance : mapping of str to str
        For each number or group of numbers, where it came from.
    slow : tuple of SlowBlock
        Torque unknown to the expected torque. The filter estimates it, so that it is not taken for
        ripple or misalignment, and leaves it in the filtered torque.
    order_prior_std_nm : float or None
        Standard deviation of every oscillator's states before the first sample, N m, about 0; None
        starts as the report's listing does (P = I, states from the first residual).
    slow_prior_std_nm : float or None
        The same of the walks in `slow`, N m (N m/s for a slope). Stationary kinds start at their
        own variance.
    gate_sigma : float or None
        Samples whose innovation is beyond so many of its standard deviations only predict.
    torque_limit_nm : float or None
        Torque at or beyond which the sensor is saturated, N m: such samples count as missing.
    stuck_samples : int or None
        From this many equal torques in a row on the converter is stuck: they count as missing.
    tuning : mapping or None
        What `hdbench tune` found beside the model: standard errors, checks, data used.

    Raises
    ------
    ValueError
        If a number is out of its domain, or two blocks have one order or frequency.
    """

    name: str
    blocks: tuple[OscillatorBlock, ...]
    measurement_noise: PositiveFloat
    load_inertia_kg_m2: NonNegativeFloat
    gear_ratio: PositiveFloat
    differentiator_time_constant_s: PositiveFloat
    use_measured_angle: bool
    torque_gain_nm_per_v: float | None = None
    provenance: Mapping[str, str] = Field(default_factory=dict)
    slow: Annotated[tuple[SlowBlock, ...], _ABSENT] = ()
    order_prior_std_nm: _Limit = None
    slow_prior_std_nm: _Limit = None
    gate_sigma: _Limit = None
    torque_limit_nm: _Limit = None
    stuck_samples: Annotated[int | None, Field(ge=2), _ABSENT] = None
    tuning: Annotated[Mapping[str, Any] | None, _ABSENT] = None

    def __post_init__(self) -> None:
        n_blocks = len(self.blocks) + len(self.slow)
        if not (self.blocks and n_blocks <= MAX_BLOCKS):
            raise ValueError(f"found {n_blocks} blocks, needed 1 to {MAX_BLOCKS}")
        places = [(block.order, block.frequency_hz) for block in self.blocks]
        for order, hz in places:
            if places.count((order, hz)) > 1:
                place = f"order {order!r}" if order else f"frequency_hz {hz!r}"
                raise ValueError(f"two blocks have {place}; they cannot be told apart")
        if self.torque_gain_nm_per_v == 0.0:
            raise ValueError("torque_gain_nm_per_v is 0; needed: a finite number, not 0")
        if self.slow and self.order_prior_std_nm is None:
            raise ValueError("slow torque needs order_prior_std_nm: the listing's start has none")
        if self.slow_prior_std_nm is None and not all(block.stationary for block in self.slow):
            raise ValueError("a walk in slow needs slow_prior_std_nm to start from")

    def to_dict(self) -> dict[str, object]:
        """Return the model as its JSON file stores it (schema ``hdbench/filter-model/1``).

        Returns
        -------
        dict
            Every field under its own name, blocks as objects. Fields that a report's preset does
            not have are left out where they are not set.
        """
        return {"schema": SCHEMA, **self.to_json()}

    @classmethod
    def from_dict(cls, body: Mapping[str, Any], *, source: str = "<memory>") -> FilterModel:
        """Read a model from its JSON object.

        Parameters
        ----------
        body : mapping
            As `to_dict` returns it. Keys that a later version adds are not known: an error.
        source : str
            The file, for messages.

        Returns
        -------
        FilterModel
            The model.

        Raises
        ------
        DataError
            If the schema is another one, or a key is missing, unknown or out of its domain.
        """
        if body.get("schema") != SCHEMA:
            found = f"schema is {body.get('schema')!r}; needed: {SCHEMA}"
            raise DataError(found, where=f"{source}:schema", fix=_FIX)
        rest = {key: value for key, value in body.items() if key != "schema"}
        return cls.from_json(rest, source, _FIX)
