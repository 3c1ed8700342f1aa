"""What is taken from inside pymodbus is what it was when it was tried."""

import inspect
import tomllib
from pathlib import Path

import pymodbus
import pytest

from hdbench.devices import pymodbusparts
from hdbench.errors import UsageError


@pytest.mark.parametrize(
    ("owner", "name", "parameters", "use"),
    pymodbusparts.INTERNALS,
    ids=[f"{owner}.{name}" for owner, name, *_ in pymodbusparts.INTERNALS],
)
def test_an_internal_of_pymodbus_is_still_there(owner, name, parameters, use):
    found = getattr(getattr(pymodbusparts, owner), name, None)
    now = "gone" if found is None else ", ".join(inspect.signature(found).parameters)
    assert now == parameters, (
        f"pymodbus {pymodbus.__version__} changed {owner}.{name} ({use}): it takes ({now}); "
        f"hdbench relies on ({parameters}). Compare its source, run tools/polled_faults.py, then "
        "change hdbench/devices/pymodbusparts.py and the pin in pyproject.toml together"
    )


def test_the_pin_of_the_package_is_the_version_of_the_code():
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())
    major, minor = pymodbusparts.VERSION.split(".")
    pin = f"pymodbus>={major}.{minor},<{major}.{int(minor) + 1}"
    assert pin in project["project"]["dependencies"]


def test_another_version_is_refused_with_what_to_install():
    pymodbusparts.check_version(f"{pymodbusparts.VERSION}.7")
    for other in ("3.17.0", "3.15.4", "4.0.0"):
        with pytest.raises(
            UsageError, match=f"pymodbus {other} is installed; needed: 3.16"
        ) as told:
            pymodbusparts.check_version(other)
        assert told.value.fix == "pip install 'pymodbus==3.16.*'"
