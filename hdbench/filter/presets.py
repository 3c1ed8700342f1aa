"""Filter models by name: the report's three, and those stored in files."""

from __future__ import annotations

import difflib
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from hdbench.errors import DataError
from hdbench.filter.build import Stored, value_of
from hdbench.filter.model import SCHEMA, FilterModel, OscillatorBlock, first_problem
from hdbench.profile.schema import ProfileData
from hdbench.records.jsonfile import read_json

MODEL_SCHEMA = "hdbench/model/1"
PRESETS = ("report-a1", "report-a2", "report-6")
_MOTOR_ORDERS = {"wave-generator-eccentricity": 1.0, "motor-unbalance": 1.0}
_OUTPUT_ORDERS = {"misalignment": 1.0, "angular-misalignment": 2.0, "load-gravity": 1.0}
# repeated impacts: the defect's order, twice and three times it; poles: currents, slots, windings
_HARMONICS = {"bearing-defect": (1, 2, 3), "cogging": (1, 2, 3, 6)}
_SOURCES = {
    "report-a1": "report CIM-TR-97-06, section 4 and listing A.1",
    "report-a2": "report CIM-TR-97-06, section 5 and listing A.2",
    "report-6": "report CIM-TR-97-06, section 5 (sixth-order model) with the noise of listing A.2",
}


def preset(name: str, profile: ProfileData) -> FilterModel:
    """Return one of the report's filter models on the bench of `profile`.

    Parameters
    ----------
    name : str
        ``report-a1`` (orders 2 and 4), ``report-a2`` (2 and 1/N) or ``report-6`` (2, 4 and 1/N).
    profile : ProfileData
        Gear ratio, load inertia and the noise values in table ``filter``.

    Returns
    -------
    FilterModel
        Turning with the velocity, as in the report.

    Raises
    ------
    DataError
        If there is no such preset; names the nearest one.
    """
    if name not in PRESETS:
        raise _unknown(name)
    noise, ratio = profile.filter, profile.drive.gear_ratio
    orders = {"report-a1": (2.0, 4.0), "report-a2": (2.0,), "report-6": (2.0, 4.0)}[name]
    blocks = [OscillatorBlock(order, "ripple", noise.ripple_process_noise) for order in orders]
    if name != "report-a1":
        blocks.append(
            OscillatorBlock(1.0 / ratio, "misalignment", noise.misalignment_process_noise)
        )
    table = f"profile {profile.name}"
    return FilterModel(
        name=name,
        blocks=tuple(blocks),
        measurement_noise=noise.measurement_noise,
        load_inertia_kg_m2=profile.drive.load_inertia_kg_m2,
        gear_ratio=ratio,
        differentiator_time_constant_s=noise.differentiator_time_constant_s,
        use_measured_angle=False,
        provenance={
            "orders": _SOURCES[name],
            "noise": f"{table}, table filter",
            "expected torque": f"{table}, tables drive and filter",
        },
    )


def load_filter_model(name_or_path: str, profile: ProfileData) -> FilterModel:
    """Return a preset, or the model stored in a JSON file.

    Parameters
    ----------
    name_or_path : str
        A preset; a file of schema ``hdbench/filter-model/1``; or an extended bench model of schema
        ``hdbench/model/1``, whose order-locked causes become blocks beside those of ``report-6``.
    profile : ProfileData
        The bench; its numbers serve where the file has none.

    Returns
    -------
    FilterModel
        The model.

    Raises
    ------
    DataError
        If it is neither a preset nor a readable model file; names the nearest preset.
    """
    if name_or_path in PRESETS:
        return preset(name_or_path, profile)
    path = Path(name_or_path)
    if not path.is_file():
        raise _unknown(name_or_path)
    body = read_json(path)
    if body.get("schema") == SCHEMA:
        return FilterModel.from_dict(body, source=str(path))
    if body.get("schema") == MODEL_SCHEMA:
        return _from_bench_model(body, path, profile)
    raise DataError(
        f"schema is {body.get('schema')!r}; needed: {SCHEMA} or {MODEL_SCHEMA}",
        where=f"{path}:schema",
        fix="give the file that `hdbench tune --out` or `hdbench diagnose` wrote",
    )


def _unknown(name: str) -> DataError:
    if name == "tuned":
        return DataError(
            "'tuned' is tuned on the very input, and there is none before measuring; presets: "
            f"{', '.join(PRESETS)}",
            where="filter model",
            fix="tune on a stored run: `hdbench tune RUN --out tuned.json`, then name that file; "
            "or take `report-6`",
        )
    nearest = difflib.get_close_matches(name, PRESETS, n=1)
    return DataError(
        f"{name!r} is no filter model; presets: {', '.join(PRESETS)}, and there is no such file",
        where="filter model",
        fix=(f"did you mean `{nearest[0]}`? Or give" if nearest else "give")
        + " the path of a model file",
    )


# cycles per motor turn, or Hz
_Place = Annotated[float, BeforeValidator(value_of), Field(gt=0.0, lt=1e6)]


class _Parameters(Stored):
    order: _Place | None = None
    frequency_hz: _Place | None = None


class _Cause(Stored):
    name: str
    parameters: _Parameters = _Parameters()

    @model_validator(mode="after")
    def _has_frequency(self) -> _Cause:
        if self.name == "mains-hum" and self.parameters.frequency_hz is None:
            raise ValueError("key 'parameters.frequency_hz' is missing; needed: a number in Hz")
        return self


class _Ripple(Stored):
    order: _Place


class _Baseline(Stored):
    ripple: list[_Ripple] = Field(default_factory=list)


class _BenchModel(Stored):
    baseline: _Baseline = _Baseline()
    causes: list[_Cause] = Field(default_factory=list)


def _from_bench_model(body: dict[str, Any], path: Path, profile: ProfileData) -> FilterModel:
    base, noise = preset("report-6", profile), profile.filter.ripple_process_noise
    try:
        stored = _BenchModel.model_validate(body)
    except ValidationError as error:
        place, what = first_problem(error)
        raise DataError(
            what,
            where=f"{path}: key {place}",
            fix="give the model file that `hdbench diagnose` wrote",
        ) from error
    provenance = dict(base.provenance)
    blocks = [block for block in base.blocks if block.role == "misalignment"]
    # orders of the model's own ripple; those of the preset where the file names none
    own = [entry.order for entry in stored.baseline.ripple]
    orders = own or [block.order for block in base.blocks if block.role == "ripple"]
    found = [
        (f"ripple order {order:g}", f"{path}, baseline", OscillatorBlock(order, "ripple", noise))
        for order in orders
    ]
    for cause in stored.causes:
        of_cause = _cause_blocks(cause, profile)
        if not of_cause:
            provenance[f"cause {cause.name}"] = f"{path}: not locked to one order, no block"
        for block in of_cause:
            place = f"{block.frequency_hz:g} Hz" if block.frequency_hz else f"order {block.order:g}"
            found.append((place, f"{path}, cause {cause.name}", block))
    for what, source, block in found:
        if not any(_same_place(block, other) for other in blocks):
            blocks.append(block)
            provenance[what] = source
    try:
        return replace(
            base,
            name=path.stem,
            blocks=tuple(blocks),
            use_measured_angle=True,
            provenance=provenance,
        )
    except ValueError as error:
        raise DataError(
            str(error), where=f"{path}:causes", fix="keep fewer causes in the model file"
        ) from error


def _same_place(a: OscillatorBlock, b: OscillatorBlock) -> bool:
    if a.frequency_hz or b.frequency_hz:
        # two tones closer than this cannot be parted within a hundred seconds
        return a.order == b.order and abs(a.frequency_hz - b.frequency_hz) < 1e-2
    # two orders closer than this cannot be parted within a thousand turns of the motor
    return abs(a.order - b.order) < 1e-3 * min(1.0, a.order, b.order)


def _cause_blocks(cause: _Cause, profile: ProfileData) -> list[OscillatorBlock]:
    """Return the blocks of a cause; none where its torque is not locked to single orders."""
    noise = profile.filter.ripple_process_noise
    if cause.name in _OUTPUT_ORDERS:
        order = _OUTPUT_ORDERS[cause.name] / profile.drive.gear_ratio
        return [OscillatorBlock(order, "misalignment", profile.filter.misalignment_process_noise)]
    hz = cause.parameters.frequency_hz
    if cause.name == "mains-hum" and hz is not None:
        # picked up by the sensor's wires: no torque
        return [OscillatorBlock(0.0, "ripple", noise, frequency_hz=hz)]
    turning = cause.parameters.order or _MOTOR_ORDERS.get(cause.name)
    if turning is None:
        return []
    return [OscillatorBlock(k * turning, "ripple", noise) for k in _HARMONICS.get(cause.name, (1,))]
