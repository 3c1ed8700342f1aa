"""The table of result keys is what stored results and a fresh diagnosis hold."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from hdbench.diagnosis import DiagnosisOptions, diagnose_run
from hdbench.profile import load_profile
from hdbench.records import resolve_input
from hdbench.regression.resultkeys import KINDS, RESULT_KEYS, keys_of, type_of
from hdbench.session import evaluate_stored

STORED = Path(__file__).parents[1] / "stored"
UNIT_OF_END = {
    "_nm": "N m",
    "_rad": "rad",
    "_rad_s": "rad/s",
    "_db": "dB",
    "_nm_per_v": "N m/V",
    "_v_per_nm": "V/(N m)",
    "_v_nm": "V N m",
    "_v": "V",
    "_s": "s",
    "_hz": "Hz",
    "_kg_m3": "kg/m^3",
    "_m_s2": "m/s^2",
    "_nm_per_rad": "N m/rad",
    "_v_s": "V/s",
}


def differences(kind: str, result: Mapping[str, Any]) -> list[str]:
    """Return what a result and the table do not agree in."""
    table = keys_of(kind)
    top = {key: row for key, row in table.items() if "[]" not in key and "." not in key}
    found = [f"not in the table: {key}" for key in result if key not in top]
    found += [f"not in the result: {key}" for key in top if key not in result]
    for key, row in top.items():
        found += unlike(key, row.type, result.get(key, _ABSENT))
    for key, row in table.items():
        outer, mark, inner = key.partition("[].")
        if not mark or "." in inner or "[]" in outer or "." in outer:
            continue
        for entry in result.get(outer, ()):
            found += unlike(key, row.type, entry.get(inner, _ABSENT))
    return found


_ABSENT = object()


def nested(value: object, path: str) -> Iterator[tuple[str, object]]:
    """Yield what stands inside a value, with its path as the table writes it."""
    if isinstance(value, list):
        for entry in value:
            yield from nested(entry, f"{path}[]")
    elif isinstance(value, Mapping):
        for key, inner in value.items():
            # the hysteresis of each experiment stands under the experiment's own name
            place = f"{path}.{'ID' if path == 'hysteresis' else key}"
            yield place, inner
            if type_of(inner) != "uncertain":
                yield from nested(inner, place)


def unknown_inside(kind: str, result: Mapping[str, Any]) -> set[str]:
    """Return what stands inside a result and not, or otherwise, in the table."""
    table = keys_of(kind)
    found = set()
    for key, value in result.items():
        if type_of(value) == "uncertain":
            continue
        for path, inner in nested(value, key):
            row = table.get(path)
            told = [f"not in the table: {path}"] if row is None else unlike(path, row.type, inner)
            found.update(told)
    return found


def unlike(key: str, wanted: str, value: object) -> list[str]:
    if value is _ABSENT:
        return [f"no {key}"] if "[]" in key and "absent" not in wanted else []
    allowed = set(wanted.split(" or ")) if wanted != "true or false" else {wanted}
    # an uncertain number may stand as a whole number too
    kind = type_of(value)
    if kind == "integer" and "number" in allowed:
        return []
    return [] if kind in allowed else [f"{key} is {kind}, the table says {wanted}"]


@pytest.mark.parametrize("case", ["calibration", "misalignment", "ripple", "filter"])
def test_stored_results_hold_no_key_and_no_type_that_the_table_does_not_know(case: str) -> None:
    result = json.loads((STORED / case / "expected.json").read_text())["result"]
    told = [line for line in differences(case, result) if not line.startswith("not in the result")]
    assert told == []


@pytest.mark.parametrize("kind", ["calibration", "misalignment", "ripple"])
def test_a_fresh_result_holds_every_key(kind: str, tmp_path: Path) -> None:
    source = next(file for file in (STORED / kind).iterdir() if ".csv" in file.suffixes)
    profile = load_profile("cim-tr-97-06")
    _, found = evaluate_stored(kind, source, profile, out=tmp_path)
    result = json.loads(json.dumps(found.result.to_json()))
    assert differences(kind, result) == []
    assert unknown_inside(kind, result) == set()


def test_a_fresh_diagnosis_holds_every_key(tmp_path: Path) -> None:
    source = tmp_path / "loads.csv"
    source.write_bytes(resolve_input(STORED / "calibration" / "loads.csv").read_bytes())
    profile = load_profile("cim-tr-97-06")
    _, result = diagnose_run(source, profile, out=tmp_path, options=DiagnosisOptions())
    assert differences("diagnosis", result) == []


def test_units_agree_with_the_names() -> None:
    for row in RESULT_KEYS:
        ends = [end for end in UNIT_OF_END if row.key.endswith(end)]
        if ends and row.unit:
            assert row.unit == UNIT_OF_END[max(ends, key=len)], row.key


def test_every_kind_has_keys_and_every_key_a_meaning() -> None:
    assert {kind for row in RESULT_KEYS for kind in row.kinds} == set(KINDS)
    assert all(row.meaning for row in RESULT_KEYS)
