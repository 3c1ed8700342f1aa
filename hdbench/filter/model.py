"""What the filter believes: oscillator blocks, noise, and where each number came from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

from hdbench.errors import DataError
from hdbench.filter.layout import MAX_BLOCKS

__all__ = ["SCHEMA", "FilterModel", "OscillatorBlock", "Role"]

SCHEMA = "hdbench/filter-model/1"
Role = Literal["ripple", "misalignment"]


def _positive(name: str, value: float) -> None:
    if not 0.0 < value < math.inf:
        raise ValueError(f"{name} is {value!r}; needed: a finite number above 0")


@dataclass(frozen=True, slots=True)
class OscillatorBlock:
    """One oscillator: a torque component locked to the wave generator, and its quadrature.

    Parameters
    ----------
    order : float
        Cycles per wave-generator turn, > 0.
    role : {"ripple", "misalignment"}
        Which output carries it: torque ripple, or misalignment at an output order.
    process_noise : float
        Q of both states, (N m)^2 per sample, > 0.

    Raises
    ------
    ValueError
        If a number is not positive and finite, or the role is unknown.
    """

    order: float
    role: Role
    process_noise: float

    def __post_init__(self) -> None:
        _positive("order", self.order)
        _positive("process_noise", self.process_noise)
        if self.role not in get_args(Role):
            raise ValueError(f"role is {self.role!r}; needed: ripple or misalignment")


@dataclass(frozen=True, slots=True)
class FilterModel:
    """Oscillator blocks with their noise, and the expected torque they are held against.

    Parameters
    ----------
    name : str
        ``report-a1``, ``report-a2``, ``report-6``, or the name of a model file or result.
    blocks : tuple of OscillatorBlock
        1 to 16 blocks of different orders.
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

    Raises
    ------
    ValueError
        If a number is out of its domain, or two blocks have one order.
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

    def __post_init__(self) -> None:
        if not 1 <= len(self.blocks) <= MAX_BLOCKS:
            raise ValueError(f"found {len(self.blocks)} blocks, needed 1 to {MAX_BLOCKS}")
        orders = [block.order for block in self.blocks]
        for order in orders:
            if orders.count(order) > 1:
                raise ValueError(f"two blocks have order {order!r}; they cannot be told apart")
        _positive("measurement_noise", self.measurement_noise)
        _positive("gear_ratio", self.gear_ratio)
        _positive("differentiator_time_constant_s", self.differentiator_time_constant_s)
        if not 0.0 <= self.load_inertia_kg_m2 < math.inf:
            raise ValueError(f"load_inertia_kg_m2 is {self.load_inertia_kg_m2!r}; needed: >= 0")
        gain = self.torque_gain_nm_per_v
        if gain is not None and not 0.0 < abs(gain) < math.inf:
            raise ValueError(f"torque_gain_nm_per_v is {gain!r}; needed: finite and not 0")

    def to_dict(self) -> dict[str, object]:
        """Return the model as its JSON file stores it (schema ``hdbench/filter-model/1``).

        Returns
        -------
        dict
            Every field under its own name, blocks as objects.
        """
        return {
            "schema": SCHEMA,
            "name": self.name,
            "blocks": [
                {"order": b.order, "role": b.role, "process_noise": b.process_noise}
                for b in self.blocks
            ],
            "measurement_noise": self.measurement_noise,
            "load_inertia_kg_m2": self.load_inertia_kg_m2,
            "gear_ratio": self.gear_ratio,
            "differentiator_time_constant_s": self.differentiator_time_constant_s,
            "use_measured_angle": self.use_measured_angle,
            "torque_gain_nm_per_v": self.torque_gain_nm_per_v,
            "provenance": dict(self.provenance),
        }

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
            raise _bad(f"schema is {body.get('schema')!r}; needed: {SCHEMA}", f"{source}:schema")
        known = {"schema", *cls.__slots__}
        optional = {"torque_gain_nm_per_v", "provenance"}
        for key in sorted(set(body) - known):
            raise _bad(f"unknown key {key!r}; known: {', '.join(sorted(known))}", f"{source}:{key}")
        for key in sorted(known - optional - set(body)):
            raise _bad(f"key {key!r} is missing", f"{source}:{key}")
        try:
            return cls(
                name=_typed(body, "name", str, source),
                blocks=tuple(
                    _block(item, f"{source}:blocks[{i}]")
                    for i, item in enumerate(_typed(body, "blocks", list, source))
                ),
                measurement_noise=_number(body, "measurement_noise", source),
                load_inertia_kg_m2=_number(body, "load_inertia_kg_m2", source),
                gear_ratio=_number(body, "gear_ratio", source),
                differentiator_time_constant_s=_number(
                    body, "differentiator_time_constant_s", source
                ),
                use_measured_angle=_typed(body, "use_measured_angle", bool, source),
                provenance=_provenance(body, source),
                torque_gain_nm_per_v=None
                if body.get("torque_gain_nm_per_v") is None
                else _number(body, "torque_gain_nm_per_v", source),
            )
        except ValueError as error:
            raise _bad(str(error), source) from error


def _bad(what: str, where: str) -> DataError:
    return DataError(what, where=where, fix="correct the filter-model file or write it again")


def _typed(body: Mapping[str, Any], key: str, kind: type, where: str) -> Any:
    value = body.get(key)
    if not isinstance(value, kind):
        raise _bad(f"{key} is {value!r}; needed: {kind.__name__}", f"{where}:{key}")
    return value


def _number(body: Mapping[str, Any], key: str, where: str) -> float:
    value = body.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise _bad(f"{key} is {value!r}; needed: a finite number", f"{where}:{key}")
    return float(value)


def _block(item: object, where: str) -> OscillatorBlock:
    keys = {"order", "role", "process_noise"}
    if not isinstance(item, Mapping) or set(item) != keys:
        raise _bad(f"found {item!r}; needed: an object with {', '.join(sorted(keys))}", where)
    try:
        return OscillatorBlock(
            _number(item, "order", where), item["role"], _number(item, "process_noise", where)
        )
    except ValueError as error:
        raise _bad(str(error), where) from error


def _provenance(body: Mapping[str, Any], source: str) -> dict[str, str]:
    found = body.get("provenance", {})
    if not isinstance(found, Mapping) or not all(isinstance(v, str) for v in found.values()):
        raise _bad("provenance must map names to text", f"{source}:provenance")
    return dict(found)
