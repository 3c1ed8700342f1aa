"""What the filter believes: oscillators, slow torque, noise, and where each number is from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hdbench.filter.blocks import NoisePer, OscillatorBlock, Role, SlowBlock, SlowKind
from hdbench.filter.layout import MAX_BLOCKS
from hdbench.filter.modeljson import (
    bad_file,
    block_dict,
    number,
    read_block,
    read_slow,
    slow_dict,
    typed,
)

__all__ = ["SCHEMA", "FilterModel", "NoisePer", "OscillatorBlock", "Role", "SlowBlock", "SlowKind"]

SCHEMA = "hdbench/filter-model/1"
_LIMITS = ("order_prior_std_nm", "slow_prior_std_nm", "gate_sigma", "torque_limit_nm")
_FLOATS = ("torque_gain_nm_per_v", *_LIMITS)
_OPTIONAL = {*_FLOATS, "provenance", "slow", "stuck_samples", "tuning"}


def _positive(name: str, value: float) -> None:
    if not 0.0 < value < math.inf:
        raise ValueError(f"{name} is {value!r}; needed: a finite number above 0")


@dataclass(frozen=True, slots=True)
class FilterModel:
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
    provenance : mapping of str to str
        For each number or group of numbers, where it came from.
    torque_gain_nm_per_v : float or None
        Calibrated torque per volt, N m/V, for traces in volts; None where no calibration was fed.
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
    measurement_noise: float
    load_inertia_kg_m2: float
    gear_ratio: float
    differentiator_time_constant_s: float
    use_measured_angle: bool
    provenance: Mapping[str, str]
    torque_gain_nm_per_v: float | None = None
    slow: tuple[SlowBlock, ...] = ()
    order_prior_std_nm: float | None = None
    slow_prior_std_nm: float | None = None
    gate_sigma: float | None = None
    torque_limit_nm: float | None = None
    stuck_samples: int | None = None
    tuning: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        n_blocks = len(self.blocks) + len(self.slow)
        if not (self.blocks and n_blocks <= MAX_BLOCKS):
            raise ValueError(f"found {n_blocks} blocks, needed 1 to {MAX_BLOCKS}")
        places = [(block.order, block.frequency_hz) for block in self.blocks]
        for order, hz in places:
            if places.count((order, hz)) > 1:
                place = f"order {order!r}" if order else f"frequency_hz {hz!r}"
                raise ValueError(f"two blocks have {place}; they cannot be told apart")
        _positive("measurement_noise", self.measurement_noise)
        _positive("gear_ratio", self.gear_ratio)
        _positive("differentiator_time_constant_s", self.differentiator_time_constant_s)
        if not 0.0 <= self.load_inertia_kg_m2 < math.inf:
            raise ValueError(f"load_inertia_kg_m2 is {self.load_inertia_kg_m2!r}; needed: >= 0")
        gain = self.torque_gain_nm_per_v
        if gain is not None and not 0.0 < abs(gain) < math.inf:
            raise ValueError(f"torque_gain_nm_per_v is {gain!r}; needed: finite and not 0")
        for name in _LIMITS:
            if getattr(self, name) is not None:
                _positive(name, getattr(self, name))
        if self.stuck_samples is not None and not self.stuck_samples >= 2:
            raise ValueError(f"stuck_samples is {self.stuck_samples!r}; needed: at least 2")
        self._check_start()

    def _check_start(self) -> None:
        """Refuse slow torque without a prior to start from."""
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
        body: dict[str, object] = {
            "schema": SCHEMA,
            "name": self.name,
            "blocks": [block_dict(block) for block in self.blocks],
            "measurement_noise": self.measurement_noise,
            "load_inertia_kg_m2": self.load_inertia_kg_m2,
            "gear_ratio": self.gear_ratio,
            "differentiator_time_constant_s": self.differentiator_time_constant_s,
            "use_measured_angle": self.use_measured_angle,
            "torque_gain_nm_per_v": self.torque_gain_nm_per_v,
            "provenance": dict(self.provenance),
        }
        if self.slow:
            body["slow"] = [slow_dict(block) for block in self.slow]
        for name in (*_LIMITS, "stuck_samples"):
            if getattr(self, name) is not None:
                body[name] = getattr(self, name)
        if self.tuning is not None:
            body["tuning"] = dict(self.tuning)
        return body

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
        _check_keys(body, {"schema", *cls.__slots__}, source)
        blocks, slow = typed(body, "blocks", list, source), body.get("slow", [])
        if not isinstance(slow, list):
            raise bad_file(f"slow is {slow!r}; needed: list", f"{source}:slow")
        try:
            return cls(
                name=typed(body, "name", str, source),
                blocks=tuple(read_block(b, f"{source}:blocks[{i}]") for i, b in enumerate(blocks)),
                measurement_noise=number(body, "measurement_noise", source),
                load_inertia_kg_m2=number(body, "load_inertia_kg_m2", source),
                gear_ratio=number(body, "gear_ratio", source),
                differentiator_time_constant_s=number(
                    body, "differentiator_time_constant_s", source
                ),
                use_measured_angle=typed(body, "use_measured_angle", bool, source),
                provenance=_provenance(body, source),
                slow=tuple(read_slow(b, f"{source}:slow[{i}]") for i, b in enumerate(slow)),
                stuck_samples=None
                if body.get("stuck_samples") is None
                else typed(body, "stuck_samples", int, source),
                tuning=None if body.get("tuning") is None else typed(body, "tuning", dict, source),
                **{k: None if body.get(k) is None else number(body, k, source) for k in _FLOATS},
            )
        except ValueError as error:
            raise bad_file(str(error), source) from error


def _check_keys(body: Mapping[str, Any], known: set[str], source: str) -> None:
    if body.get("schema") != SCHEMA:
        raise bad_file(f"schema is {body.get('schema')!r}; needed: {SCHEMA}", f"{source}:schema")
    for key in sorted(set(body) - known):
        what = f"unknown key {key!r}; known: {', '.join(sorted(known))}"
        raise bad_file(what, f"{source}:{key}")
    for key in sorted(known - _OPTIONAL - set(body)):
        raise bad_file(f"key {key!r} is missing", f"{source}:{key}")


def _provenance(body: Mapping[str, Any], source: str) -> dict[str, str]:
    found = body.get("provenance", {})
    if not isinstance(found, Mapping) or not all(isinstance(v, str) for v in found.values()):
        raise bad_file("provenance must map names to text", f"{source}:provenance")
    return dict(found)
