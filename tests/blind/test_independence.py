"""Injector, scorer and product know nothing of each other."""

import ast
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
OWN = ("injector", "scorer", "rivals")
FOREIGN = {
    "dataclasses", "numpy", "scipy", "collections", "math", "statistics", "hashlib", "itertools",
    "json", "random", "importlib", "pathlib", "tomllib", "pysindy", "sysidentpy",
}  # fmt: skip


def imported(path):
    """(level, dotted name) of everything that a module imports anywhere in it."""
    out = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            out += [(0, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            out.append((node.level, node.module or ""))
    return out


def roots(path):
    return {name.partition(".")[0] for level, name in imported(path) if level == 0}


@pytest.mark.parametrize("package", OWN)
def test_package_imports_no_product(package):
    files = sorted((HERE / package).rglob("*.py"))
    assert files
    for path in files:
        allowed = FOREIGN | ({"injector"} if package == "rivals" else set())
        assert roots(path) <= allowed, path


def test_scorer_and_injector_share_nothing():
    for package, other in (("injector", "scorer"), ("scorer", "injector")):
        for path in (HERE / package).rglob("*.py"):
            assert other not in roots(path), path
            assert all(level <= 1 for level, _ in imported(path)), path


def test_product_imports_nothing_of_the_benchmark():
    seen = 0
    for room in ("hdbench", "cli"):
        for path in (ROOT / room).rglob("*.py"):
            seen += 1
            assert not roots(path) & {*OWN, "tests", "runner"}, path
    assert seen > 100


def test_only_the_runner_holds_both_ends():
    both = {
        path.name
        for path in (ROOT / "tools" / "blind").glob("*.py")
        if {"hdbench"} & roots(path) and {"injector"} & roots(path)
    }
    # the proposal asks the plan of the one and drives the bench of the other; the records of
    # others are cases of the one and traces of the other; the rivals run on hdbench's workers
    wanted = {"runner.py", "proposal.py", "real_records.py", "other_methods.py"}
    assert both == wanted
