"""Filter models by name: the report's three, and those stored in files."""

from __future__ import annotations

import difflib
from dataclasses import replace
from pathlib import Path
from typing import Any

from hdbench.errors import DataError
from hdbench.filter.model import SCHEMA, FilterModel, OscillatorBlock
from hdbench.profile.schema import ProfileData
from hdbench.records.jsonfile import read_json

__all__ = ["MODEL_SCHEMA", "PRESETS", "load_filter_model", "preset"]

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


def _from_bench_model(body: dict[str, Any], path: Path, profile: ProfileData) -> FilterModel:
    base = preset("report-6", profile)
    provenance = dict(base.provenance)
    noise = profile.filter.ripple_process_noise
    blocks = [block for block in base.blocks if block.role == "misalignment"]
    found = [
        (f"ripple order {order:g}", f"{path}, baseline", OscillatorBlock(order, "ripple", noise))
        for order in _baseline_orders(body, path, base)
    ]
    for i, cause in enumerate(_list(body, "causes", path)):
        where = f"causes[{i}]"
        if not isinstance(cause, dict) or not isinstance(cause.get("name"), str):
            raise _bad(path, where, cause, "an object with a name")
        of_cause = _cause_blocks(cause, path, where, profile)
        if not of_cause:
            provenance[f"cause {cause['name']}"] = f"{path}: not locked to one order, no block"
        for block in of_cause:
            place = f"{block.frequency_hz:g} Hz" if block.frequency_hz else f"order {block.order:g}"
            found.append((place, f"{path}, cause {cause['name']}", block))
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


def _bad(path: Path, key: str, found: object, needed: str) -> DataError:
    return DataError(
        f"found {repr(found)[:60]}; needed: {needed}",
        where=f"{path}: key {key}",
        fix="give the model file that `hdbench diagnose` wrote",
    )


def _list(body: dict[str, Any], key: str, path: Path) -> list[Any]:
    found = body.get(key, [])
    if not isinstance(found, list):
        raise _bad(path, key, found, "a list")
    return found


def _order(value: object, path: Path, key: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < 1e6:
        raise _bad(path, key, value, "a number above 0, cycles per motor turn or Hz")
    return float(value)


def _baseline_orders(body: dict[str, Any], path: Path, base: FilterModel) -> list[float]:
    """Orders of the model's own ripple; those of `base` where the file names none."""
    baseline = body.get("baseline", {})
    if not isinstance(baseline, dict):
        raise _bad(path, "baseline", baseline, "an object")
    entries = _list(baseline, "ripple", path)
    if not entries:
        return [block.order for block in base.blocks if block.role == "ripple"]
    orders = []
    for i, entry in enumerate(entries):
        key = f"baseline.ripple[{i}]"
        if not isinstance(entry, dict):
            raise _bad(path, key, entry, "an object with an order")
        orders.append(_order(entry.get("order"), path, f"{key}.order"))
    return orders


def _cause_blocks(
    cause: dict[str, Any], path: Path, where: str, profile: ProfileData
) -> list[OscillatorBlock]:
    """Return the blocks of a cause; none where its torque is not locked to single orders."""
    name, ratio = cause["name"], profile.drive.gear_ratio
    if name in _OUTPUT_ORDERS:
        noise = profile.filter.misalignment_process_noise
        return [OscillatorBlock(_OUTPUT_ORDERS[name] / ratio, "misalignment", noise)]
    parameters = cause.get("parameters", {})
    if not isinstance(parameters, dict):
        raise _bad(path, f"{where}.parameters", parameters, "an object")
    if name == "mains-hum":  # picked up by the sensor's wires: no torque
        entry = parameters.get("frequency_hz")
        hum = entry.get("value") if isinstance(entry, dict) else entry
        hz = _order(hum, path, f"{where}.parameters.frequency_hz")
        noise = profile.filter.ripple_process_noise
        return [OscillatorBlock(0.0, "ripple", noise, frequency_hz=hz)]
    entry = parameters.get("order", _MOTOR_ORDERS.get(name))
    if entry is None:
        return []
    value = entry.get("value") if isinstance(entry, dict) else entry
    order = _order(value, path, f"{where}.parameters.order")
    noise = profile.filter.ripple_process_noise
    return [OscillatorBlock(k * order, "ripple", noise) for k in _HARMONICS.get(name, (1,))]
