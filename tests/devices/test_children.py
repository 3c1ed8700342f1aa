"""Children: no module of the user's folder in place of the standard library, no full pipe."""

import os
import subprocess
import sys

import pytest
from changing import REPORT, with_keys
from forked import ended

from hdbench.devices.emulator import process
from hdbench.devices.guard.order import order_of
from hdbench.errors import DeviceError
from hdbench.profile import load_profile

SHADOWS = ("signal", "json", "asyncio", "struct", "pathlib", "site", "subprocess", "select")
RUN = """
import sys
from hdbench.devices import AcquisitionSettings, open_bench
from hdbench.devices import opening, guard
from hdbench.devices.emulator import process
from hdbench.profile import load_profile
from hdbench.profile.schema import ReferenceWave
import asyncio, pathlib, signal, struct, subprocess
# a script and `python -m hdbench_cli` put the folder first, or an entry that means it
for first in "{folder}", "":
    sys.path.insert(0, first)
    with open_bench(load_profile("cim-tr-97-06")) as bench:
        wave = ReferenceWave(wave="constant", amplitude_v=1.0)
        bench.configure(AcquisitionSettings(2e-3, 100, wave))
        bench.start()
        seen = 0
        while seen < 100:
            block = bench.read_block()
            seen += len(block) if block else 0
        print(bench.safe_state().confirmed)
    del sys.path[0]
"""


@pytest.fixture(scope="module")
def warm_emulators():
    """Start emulators as a session does, in place of the fixture of the other tests."""


@pytest.fixture
def folder(tmp_path):
    for name in SHADOWS:
        (tmp_path / f"{name}.py").write_text(f"raise SystemExit('the user has a {name}.py')\n")
    return tmp_path


def test_modules_of_the_users_folder_are_no_standard_library(folder):
    program = RUN.format(folder=folder)
    done = ended([sys.executable, "-P", "-c", program], cwd=folder)
    assert (done.returncode, done.stdout) == (0, 2 * "True\n"), done.stderr


def test_a_driver_that_the_guard_calls_is_not_shadowed_either(folder):
    order = order_of(load_profile("seneca-z-sg").data)
    nobody = with_keys(REPORT, daq={"address": "tcp://127.0.0.1:1"})
    told = nobody.model_dump_json(exclude_none=True)
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    done = ended(order.command, input=told, cwd=folder, env=environment)
    assert "no connection" in done.stdout, done.stderr
    assert done.returncode == 5


def in_its_place(monkeypatch, program):
    """Let another program run where the emulator is started."""
    popen = subprocess.Popen
    instead = [sys.executable, "-c", program]
    monkeypatch.setattr(process.subprocess, "Popen", lambda _, **keys: popen(instead, **keys))


def test_an_emulator_that_says_a_lot_is_not_held_up(monkeypatch):
    """A pipe that nobody reads takes 64 KiB, then its writer stands still."""
    # before it serves, and whenever the node is asked
    in_its_place(
        monkeypatch,
        "import os, runpy, sys; os.write(2, b'w' * 500_000)\n"
        f"sys.path[:0] = {[path for path in sys.path if path]!r}\n"
        "runpy.run_module('hdbench.devices.emulator', run_name='__main__')",
    )
    monkeypatch.setattr(process, "_START_S", 30.0)
    with process.running_emulator(REPORT, plant="as-modelled", seed=0, pace="fast") as found:
        assert str(found["address"]).startswith("tcp://")


def test_why_an_emulator_did_not_start_is_the_last_it_said(monkeypatch):
    in_its_place(
        monkeypatch, "import sys; print('w' * 100_000, file=sys.stderr); sys.exit('no such luck')"
    )
    with (
        pytest.raises(DeviceError, match="exit code 1: no such luck"),
        process.running_emulator(REPORT, plant="as-modelled", seed=0, pace="fast"),
    ):
        pass
