"""Examples of hypothesis are the same in every run and have no deadline.

The suite says whether a change is good; looking for new inputs is the work of
`tools/faults/inputs.py`.
"""

import gc
import json
import os
import signal
import sys
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from hdbench.model import Cause
from hdbench.profile import Profile, ProfileData, load_profile

settings.register_profile(
    "suite", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("suite")

# tools that tests use; behind the libraries, one of which has a tool's name: coverage
sys.path.append(str(Path(__file__).parents[1] / "tools"))

# programs that tests start write as they do at a user's terminal
os.environ.pop("PYTHONUNBUFFERED", None)


@pytest.fixture(autouse=True)
def _hears_ctrl_c() -> None:
    """Undo what a command leaves that ran in this process: its Ctrl-C is ignored, and inherited."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect no garbage while modules are imported, and never look at them again."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_xdist_auto_num_workers() -> int:
    """Return two workers more than there are cores: a worker waits a third of its time."""
    return (os.cpu_count() or 1) + 2


@pytest.fixture
def hdbench(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[str, str]]:
    """Return a function that runs a command line in this process."""
    from hdbench_cli.main import main

    def run(*words: object, code: int = 0) -> tuple[str, str]:
        """Return stdout and stderr of a command that ends with `code`."""
        with pytest.raises(SystemExit) as end:
            main([str(word) for word in words])
        shown = capsys.readouterr()
        assert end.value.code == code, shown.err
        return shown.out, shown.err

    return run


@pytest.fixture
def answer(hdbench: Callable[..., tuple[str, str]]) -> Callable[..., dict[str, Any]]:
    """Return a function that runs a command line with --json, for its one object."""
    return lambda *words, code=0: json.loads(hdbench(*words, "--json", code=code)[0])


@pytest.fixture(scope="session")
def profile() -> Profile:
    return load_profile("cim-tr-97-06")


@pytest.fixture(scope="session")
def bench(profile: Profile) -> ProfileData:
    return profile.data


@pytest.fixture(scope="session")
def changed_profile(profile: Profile) -> Callable[..., str]:
    """Return a function that changes keys in tables of the report's profile, for its text."""

    def changed(**tables: dict[str, object]) -> str:
        table, lines = "", []
        for line in profile.text.splitlines():
            table = line.strip("[]") if line.startswith("[") else table
            key = line.partition(" = ")[0]
            if key in tables.get(table, {}):
                line = f"{key} = {json.dumps(tables[table].pop(key))}"
            lines.append(line)
        assert not any(tables.values()), tables
        return "\n".join(lines)

    return changed


@pytest.fixture(scope="session")
def middle_shape() -> Callable[[Cause], dict[str, float]]:
    """Return a function that gives the shape of a cause in the middle of its bounds."""

    def middle(cause: Cause) -> dict[str, float]:
        shape = {}
        for parameter in cause.shape:
            low, high = (parameter.bands or ((parameter.lower, parameter.upper),))[0]
            shape[parameter.name] = (low * high) ** 0.5 if low > 0.0 else 0.5 * (low + high)
        return shape

    return middle


@pytest.fixture(scope="session")
def named_cause() -> Callable[..., dict[str, Any]]:
    """Return a function that makes a cause of a stored diagnosis from its name and parameters."""

    def made(name: str, parameters: dict[str, Any], **changes: Any) -> dict[str, Any]:
        return {
            "name": name,
            "group": [name],
            "rivals": [],
            "parameters": parameters,
            "evidence_nats": 40.0,
            "false_alarm_probability": 1e-12,
            "gain": {
                "heldout_rms_before_nm": 0.2,
                "heldout_rms_after_nm": 0.166,
                "explained_fraction": 0.312,
                "interval": [0.3, 0.33],
            },
            "separating_experiment": None,
            "share_of_variance": 0.3,
            "domain": "motor-order",
            **changes,
        }

    return made
