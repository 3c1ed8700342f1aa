"""Result types: what evaluations write, what is read back, and the reference made of them."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from result_keys import KINDS, ResultKey, json_schema, keys_of

from hdbench.diagnosis import DiagnosisOptions, diagnose_run
from hdbench.errors import DataError
from hdbench.profile import load_profile
from hdbench.results import CalibrationResult, DiagnosisResult, MisalignmentResult, RippleResult
from hdbench.session import evaluate_stored

STORED = Path(__file__).parents[1] / "stored"
TYPES = {
    "calibration": CalibrationResult,
    "misalignment": MisalignmentResult,
    "ripple": RippleResult,
}
UNIT_OF_END = {
    "_nm": "N m", "_rad": "rad", "_rad_s": "rad/s", "_db": "dB", "_nm_per_v": "N m/V",
    "_v_per_nm": "V/(N m)", "_v_nm": "V N m", "_v": "V", "_s": "s", "_hz": "Hz",
    "_kg_m3": "kg/m^3", "_m_s2": "m/s^2", "_nm_per_rad": "N m/rad", "_v_s": "V/s",
}  # fmt: skip
# tables whose entries stand under names of their own
FREE = {"hysteresis": "ID", "steps[].increasing.parts": "ID"}
FREE["steps[].increasing_decreasing.parts"] = "ID"
FREE |= {f"{kind}[].parameters": "ID" for kind in ("causes", "minor")}


# keys that the contract names, by kind
CONTRACT = {
    "calibration": "gain_nm_per_v consistency consistency_interval n_experiments accepted "
    "experiments steps class",
    "misalignment": "amplitude_nm peak_to_peak_nm phase_rad before after output_turns "
    "mean_torque_nm motor_velocity_rad_s filter",
    "ripple": "ripple motor_velocity_rad_s torque_rms_nm suppression_db filter",
}


def type_of(value: object) -> str:
    """Return the type of a JSON value in the words of the reference."""
    if isinstance(value, Mapping):
        return "uncertain" if {"value", "std"} == set(value) - {"dof"} else "table"
    names = {bool: "true or false", int: "integer", float: "number", str: "text", list: "list"}
    return "null" if value is None else names[type(value)]


def inside(value: object, path: str) -> Iterator[tuple[str, object]]:
    """Yield what stands inside a value, with its path as the reference writes it."""
    if isinstance(value, list):
        for entry in value:
            yield from inside(entry, f"{path}[]")
    elif isinstance(value, Mapping) and type_of(value) != "uncertain":
        for key, inner in value.items():
            place = f"{path}.{FREE.get(path, key)}".lstrip(".")
            yield place, inner
            yield from inside(inner, place)


def unlike(row: ResultKey | None, place: str, value: object) -> str:
    """Return what a value has that the reference does not know."""
    kind = type_of(value)
    if row is None:
        return "" if FREE.get(place.removesuffix(".ID")) else f"{place} is not in the reference"
    allowed = set(row.type.replace("true or false", "switch").split(" or "))
    kind = "number" if kind == "integer" and "number" in allowed else kind
    kind = "switch" if kind == "true or false" else kind
    return "" if kind in allowed else f"{place} is {kind}, the reference says {row.type}"


def differences(kind: str, result: Mapping[str, Any]) -> set[str]:
    """Return what a result and the reference do not agree in."""
    table = keys_of(kind)
    found = {unlike(table.get(place), place, value) for place, value in inside(result, "")}
    top = {
        key for key, row in table.items() if not set(key) & set(".[") and "absent" not in row.type
    }
    return found - {""} | {f"no {key}" for key in top - set(result)}


@pytest.fixture(scope="module", params=["calibration", "misalignment", "ripple"])
def fresh(request, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, dict[str, Any]]:
    """Return a kind and its JSON, evaluated from the stored input."""
    kind = request.param
    source = next(file for file in (STORED / kind).iterdir() if ".csv" in file.suffixes)
    profile = load_profile("cim-tr-97-06")
    folder, found = evaluate_stored(kind, source, profile, out=tmp_path_factory.mktemp(kind))
    body = json.loads(folder.result.read_text(encoding="utf-8"))
    assert body == json.loads(json.dumps(found.to_json()))
    return kind, body


def test_a_fresh_result_is_what_contract_and_reference_say(fresh):
    kind, body = fresh
    assert differences(kind, body) == set()
    assert body["schema"] == f"hdbench/{kind}/1"
    assert set(CONTRACT[kind].split()) <= set(body)


def test_a_stored_result_reads_back_to_the_same_file(fresh):
    kind, body = fresh
    again = TYPES[kind].from_json(body, "result.json").to_json()
    assert list(again) == list(body)
    assert json.loads(json.dumps(again)) == body


def test_an_older_result_without_optional_keys_is_read(fresh):
    kind, body = fresh
    table = json_schema(kind)
    older = {key: value for key, value in body.items() if key in table["required"]}
    found = TYPES[kind].from_json(older, "result.json")
    assert found.flags == ()
    assert found.profile is None
    assert {key: found.to_json()[key] for key in older} == older


@pytest.mark.parametrize(
    ("kind", "part", "lacked"),
    [
        ("calibration", "steps", "deflection_v"),
        ("calibration", "budget", "relative_std"),
        ("misalignment", "stretches", "offset_nm"),
        ("ripple", "spectrum", "resolution_hz"),
    ],
)
def test_a_part_that_an_older_version_wrote_with_fewer_keys_is_left_out(kind, part, lacked):
    body = json.loads((STORED / kind / "expected.json").read_text())["result"]
    whole = body[part][0] if isinstance(body[part], list) else body[part]
    del whole[lacked]
    found = TYPES[kind].from_json(body, "result.json")
    assert not getattr(found, part)
    assert found.notes[-1].detail.startswith(f"{part} is left out: it lacks {part}.")
    # what is wrong besides is still an error
    body["n_samples"] = "soon"
    with pytest.raises(DataError):
        TYPES[kind].from_json(body, "result.json")


def test_a_key_of_the_contract_is_needed_inside_a_list(fresh):
    kind, body = fresh
    entries = {"calibration": "experiments", "ripple": "ripple"}.get(kind)
    older = json.loads(json.dumps(body))
    if entries is None:
        del older["before"]["peak_to_peak_nm"]
    else:
        del older[entries][0]["gain_nm_per_v" if kind == "calibration" else "order"]
    with pytest.raises(DataError, match="needed: this key"):
        TYPES[kind].from_json(older, "result.json")


@pytest.mark.parametrize("body", [[], None, {"notes": 3, "budget": [{}]}])
def test_what_is_no_result_is_refused(body):
    with pytest.raises(DataError) as caught:
        CalibrationResult.from_json(body, "result.json")
    assert caught.value.where.startswith("result.json")


def test_a_damaged_result_is_named_by_file_and_key(fresh):
    kind, body = fresh
    with pytest.raises(DataError, match="found 'soon'") as caught:
        TYPES[kind].from_json({**body, "n_samples": "soon"}, "runs/a/result.json")
    assert caught.value.where == "runs/a/result.json: n_samples"
    needed = json_schema(kind)["required"][0]
    with pytest.raises(DataError, match="needed: this key") as caught:
        TYPES[kind].from_json({k: v for k, v in body.items() if k != needed}, "result.json")
    assert caught.value.where == f"result.json: {needed}"


@pytest.mark.parametrize("kind", ["calibration", "misalignment", "ripple", "filter"])
def test_what_was_stored_holds_no_key_that_the_reference_does_not_know(kind):
    result = json.loads((STORED / kind / "expected.json").read_text())["result"]
    assert {line for line in differences(kind, result) if not line.startswith("no ")} == set()


def test_a_fresh_diagnosis_holds_every_key(tmp_path):
    source = tmp_path / "loads.csv"
    source.write_bytes((STORED / "calibration" / "loads.csv").read_bytes())
    profile = load_profile("cim-tr-97-06")
    folder, result = diagnose_run(source, profile, out=tmp_path, options=DiagnosisOptions())
    body = result.to_json()
    assert json.loads((folder / "result.json").read_text()) == json.loads(json.dumps(body))
    again = DiagnosisResult.from_json(body, "result.json").to_json()
    assert (list(again), again) == (list(body), body)
    # what the settings hold depends on the record
    assert differences("diagnosis", {**body, "settings": {}}) == set()


def test_every_key_has_a_meaning_and_the_unit_of_its_name():
    for kind in KINDS:
        for row in keys_of(kind).values():
            assert row.meaning, row.key
            ends = [end for end in UNIT_OF_END if row.key.endswith(end)]
            if ends and row.unit:
                assert row.unit == UNIT_OF_END[max(ends, key=len)], row.key
