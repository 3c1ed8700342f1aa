"""Runs of every kind for the tests of the report, and one page of all of them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bench_runs as bench
import generate
import pytest

from hdbench.profile import Profile
from hdbench.report import ReportFiles, write_report


@pytest.fixture(scope="session")
def runs(
    tmp_path_factory: pytest.TempPathFactory,
    profile: Profile,
    named_cause: Callable[..., dict[str, Any]],
) -> dict[str, Path]:
    parent = tmp_path_factory.mktemp("bench")
    places = parent / "runs"
    turning = bench.trace_of(generate.trace_csv(generate.misalignment_velocity(), 12), parent)
    parameters = {
        "order": {"value": 6.0, "std": 0.0004, "unit": "1"},
        "amplitude_nm": {"value": 0.1502, "std": 0.0011, "unit": "N m"},
        "phase_rad": {"value": 0.401, "std": 0.007, "unit": "rad"},
    }
    cause = named_cause("ripple-harmonic", parameters, rivals=["tooth-mesh"])
    free = bench.trace_of(generate.trace_csv(generate.ripple_velocity(), 13), parent)
    return {
        "calibration": bench.calibration_run(places, profile, generate.loads_csv(11)),
        "misalignment": bench.dynamic_run(places, "misalignment", profile, turning),
        "ripple": bench.dynamic_run(places, "ripple", profile, free),
        "diagnosis": bench.diagnosis_run(places, profile, cause),
    }


@pytest.fixture(scope="session")
def report(runs: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> ReportFiles:
    return write_report([*runs.values()], tmp_path_factory.mktemp("out") / "all.html")
