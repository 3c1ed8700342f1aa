"""Fixtures of the filter's tests: the bench, and both kernel forms."""

import sys
import tomllib
from pathlib import Path

import pytest
from tuning_traces import needs_compiled_kernel

from hdbench.profile.schema import ProfileData

# tuning_campaign
sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

PROFILE = Path(__file__).parents[2] / "profiles" / "cim-tr-97-06.toml"


@pytest.fixture(scope="session")
def bench() -> ProfileData:
    """Return the report's bench, read without the profile room's own reader."""
    return ProfileData.model_validate(tomllib.loads(PROFILE.read_text()), strict=False)


@pytest.fixture(params=["c", "numpy"])
def kernel(request: pytest.FixtureRequest) -> str:
    """Return each kernel form that is there; without a compiler only the NumPy form is."""
    if request.param == "c":
        needs_compiled_kernel()
    return str(request.param)
