"""The table of result keys is what stored results and a fresh diagnosis hold."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from hdbench.diagnosis import DiagnosisOptions, diagnose_run
from hdbench.profile import load_profile
from hdbench.records import resolve_input
from hdbench.regression.resultkeys import KINDS, RESULT_KEYS, keys_of, type_of
from hdbench.session import evaluate_stored

STORED = Path(__file__).parents[1] / "stored"
UNIT_OF_END = {"_nm": "N m", "_rad": "rad", "_rad_s": "rad/s", "_db": "dB", "_nm_per_v": "N m/V"}


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
        for entry in result.get(outer, ()) if mark else ():
            found += unlike(key, row.type, entry.get(inner, _ABSENT))
    return found


_ABSENT = object()


def unlike(key: str, wanted: str, value: object) -> list[str]:
    if value is _ABSENT:
        return [f"no {key}"] if "[]" in key else []
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
    assert differences(kind, found.result) == []


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
