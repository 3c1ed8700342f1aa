from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

from hdbench.profile import Profile, load_profile


def _load(name: str) -> ModuleType:
    file = Path(__file__).with_name(f"{name}.py")
    spec = importlib.util.spec_from_file_location(f"report_{name}", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def profile() -> Profile:
    return load_profile("cim-tr-97-06")


@pytest.fixture(scope="session")
def bench() -> ModuleType:
    return _load("bench_runs")


@pytest.fixture(scope="session")
def runs(
    tmp_path_factory: pytest.TempPathFactory, bench: ModuleType, profile: Profile
) -> dict[str, Path]:
    parent = tmp_path_factory.mktemp("bench")
    made, places = bench.generator(), parent / "runs"
    turning = bench.trace_of(made.trace_csv(made.misalignment_velocity(), 12), parent)
    free = bench.trace_of(made.trace_csv(made.ripple_velocity(), 13), parent)
    return {
        "calibration": bench.calibration_run(places, profile, made.loads_csv(11)),
        "misalignment": bench.dynamic_run(places, "misalignment", profile, turning),
        "ripple": bench.dynamic_run(places, "ripple", profile, free),
        "diagnosis": bench.diagnosis_run(places, profile),
    }
