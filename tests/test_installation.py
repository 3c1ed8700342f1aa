"""Every file of the packages is installed; `make wheel` builds the wheel and uses it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from forked import ended

ROOT = Path(__file__).parents[1]
FOLDERS = {"hdbench": "hdbench", "cli/hdbench_cli": "hdbench_cli", "profiles": "hdbench_profiles"}


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Return the folder of a build without what is compiled."""
    folder = tmp_path_factory.mktemp("installed")
    command = [sys.executable, "setup.py", "--quiet", "build_py", "--build-lib", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    return folder


def files(folder):
    paths = (path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    return {path for path in paths if path.suffix not in (".pyc", ".so", ".pyd")}


def test_every_file_is_installed_and_nothing_else(installed):
    for here, there in FOLDERS.items():
        assert files(installed / there) == files(ROOT / here)
    assert {path.name for path in installed.iterdir()} == set(FOLDERS.values())


def test_what_is_installed_runs_without_the_sources(installed, tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    command = [sys.executable, "-P", "-m", "hdbench_cli"]
    run = [*command, "simulate", "--duration", "1", "--out", "trace.csv"]
    subprocess.run(run, cwd=tmp_path, env=environment, check=True, capture_output=True)
    run = [*command, "filter", "trace.csv", "--out", "filtered.csv", "--json"]
    told = ended(run, cwd=tmp_path, env=environment)
    assert told.returncode == 0, told.stderr
    assert '"kernel": "numpy' in told.stdout or '"kernel": "python' in told.stdout
