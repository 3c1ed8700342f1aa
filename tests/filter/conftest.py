"""Both forms of the filter's kernel."""

import pytest
from tuning_traces import needs_compiled_kernel


@pytest.fixture(params=["c", "numpy"])
def kernel(request: pytest.FixtureRequest) -> str:
    """Return each kernel form that is there; without a compiler only the NumPy form is."""
    if request.param == "c":
        needs_compiled_kernel()
    return str(request.param)
