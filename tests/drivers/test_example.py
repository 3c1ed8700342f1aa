"""The example of a driver of another package: installed, found, and calibrated with."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hdbench.profile import load_profile

ROOT = Path(__file__).parents[2]
DAQ = '[daq]\ndriver = "example-bridge"\naddress = "embedded"\nsample_period_s = 0.1\n'
# a short calibration: 2 positions, 2 directions, 3 weights up and down
SHORT = {
    "positions = 4": "positions = 2",
    'ranges = ["low", "full"]': 'ranges = ["full"]',
    "full_masses_kg = [0.0, 2.0, 4.0, 6.0, 8.0]": "full_masses_kg = [0.0, 4.0, 8.0]",
}


@pytest.fixture(scope="module")
def hdbench(tmp_path_factory):
    """Install the package beside hdbench and return what runs a command with it."""
    folder = tmp_path_factory.mktemp("example")
    shutil.copytree(ROOT / "examples" / "driver", folder / "source")
    words = ["--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--target"]
    install = [sys.executable, "-m", "pip", "install", *words, folder / "site", folder / "source"]
    subprocess.run(install, check=True, timeout=120)
    places = [str(folder / "site"), *filter(None, sys.path)]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(places)}

    def run(*arguments):
        command = [sys.executable, "-m", "hdbench_cli", *map(str, arguments)]
        return subprocess.run(
            command, env=env, cwd=folder, capture_output=True, text=True, timeout=300, check=False
        )

    return run


@pytest.fixture
def bench(tmp_path):
    """Return the profile of a bench whose sensor is on the example's amplifier."""
    text = load_profile("seneca-z-sg").text
    for old, new in SHORT.items():
        assert old in text
        text = text.replace(old, new)
    head, rest = text.split("[daq]\n", 1)
    file = tmp_path / "bench.toml"
    file.write_text(f"{head}{DAQ}\n[limits]\n{rest.split('[limits]', 1)[1]}")
    return file


def test_a_calibration_runs_through_an_installed_driver(hdbench, bench, tmp_path):
    done = hdbench(
        "calibrate", "--profile", bench, "--yes", "--no-input", "--no-report", "--json",
        "--out", tmp_path / "runs",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    gain = json.loads(done.stdout)["gain_nm_per_v"]
    # the plant as modelled has the profile's gain, each clamping its own by 2 % (one sigma)
    expected = load_profile("seneca-z-sg").data.sensor.gain_nm_per_v
    assert abs(gain["value"] - expected) < 0.04 * expected
    assert gain["std"] > 0.0


def test_doctor_names_the_driver_and_its_package_and_reaches_the_device(hdbench, bench):
    told = hdbench("doctor", "--profile", bench).stdout
    assert "example-bridge (hdbench-example-bridge 0.1.0)" in told
    assert "Example BR-1 sim-0" in told


def test_a_motion_is_refused_from_the_profile_alone(hdbench, bench, tmp_path):
    done = hdbench("run-ripple", "--profile", bench, "--yes", "--out", tmp_path / "runs")
    assert done.returncode == 2
    assert "has no output in this profile" in done.stderr


def test_a_wrong_key_of_the_drivers_own_table_is_told_with_its_line(hdbench, bench):
    bench.write_text(bench.read_text().replace(DAQ, f"{DAQ}baud = 9600\n"))
    done = hdbench("profile", "check", bench)
    assert done.returncode != 0
    assert "did you mean 'daq.baud_bd'?" in done.stderr
    assert "bench.toml:" in done.stderr


def test_the_example_is_short():
    files = [*ROOT.glob("examples/driver/*/*.py"), ROOT / "examples/driver/pyproject.toml"]
    assert sum(len(file.read_text().splitlines()) for file in files) < 250
