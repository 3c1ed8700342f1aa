"""The diagnosis finds what a bench with its own physics hides, and nothing else."""

import ast
import sys
from pathlib import Path

import numpy as np
import pytest

from hdbench.diagnosis import diagnose_trace
from hdbench.profile import load_profile
from hdbench.records import Trace

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path.insert(0, str(HERE))
from injector import inject  # noqa: E402
from scorer import score  # noqa: E402


def imported(path):
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module or "")
    return names


def cell(injected):
    columns = injected.columns
    if injected.hidden == "tone":
        return 1.0 / np.ptp(columns["time_s"])
    return 4000.0 / np.ptp(columns["encoder_count"])


def answer(injected):
    trace = Trace(injected.columns, source="blind")
    return diagnose_trace(trace, load_profile("cim-tr-97-06"), seed=injected.seed).to_dict({})


def test_injector_and_product_import_nothing_of_each_other():
    for name in ("injector.py", "scorer.py"):
        roots = {module.partition(".")[0] for module in imported(HERE / name)}
        assert roots <= {"dataclasses", "numpy"}
    for path in [*(ROOT / "hdbench").rglob("*.py"), *(ROOT / "cli").rglob("*.py")]:
        assert not any(
            word in module.split(".")
            for module in imported(path)
            for word in ("injector", "scorer", "tests")
        ), path


@pytest.mark.parametrize(
    ("hidden", "motion", "noise", "seed"),
    [
        ("order", "reversals", "coloured", 16),
        ("order", "varying", "coloured", 10),
        ("order", "constant", "white", 5),
        ("tone", "reversals", "white", 1),
        ("tone", "varying", "coloured", 18),
        ("friction", "reversals", "white", 1),
        ("friction", "reversals", "coloured", 2),
    ],
)
def test_hidden_effect_is_found_with_its_place_and_no_second_name(hidden, motion, noise, seed):
    injected = inject(seed, hidden, motion, noise, 15.0)
    judged = score(injected, answer(injected), cell(injected))
    assert judged.found
    assert judged.right_place
    assert judged.right_name
    assert judged.extra == 0


@pytest.mark.parametrize(
    ("motion", "noise"),
    [("reversals", "white"), ("varying", "coloured"), ("constant", "white")],
)
def test_clean_record_gives_no_finding(motion, noise):
    injected = inject(77, "clean", motion, noise, 12.0)
    result = answer(injected)
    # a finding of any size has a probability of 1 % per record: 3 % that this test needs a look
    assert result["verdict"] == "nothing-found"
    assert result["minor"] == []
    assert result["minor_unexplained"] == []
    assert result["data_flags"] == []


def test_scorer_rejects_a_wrong_place_and_counts_a_second_name():
    injected = inject(3, "tone", "varying", "white", 2.0)
    entry = {
        "name": "structural-tone",
        "group": ["structural-tone"],
        "rivals": [],
        "parameters": {"frequency_hz": {"value": injected.place + 1.0}},
    }
    body = {"causes": [entry, entry], "unexplained": [], "minor": [], "minor_unexplained": []}
    judged = score(injected, body, cell(injected))
    assert not judged.right_place
    assert judged.extra == 1
