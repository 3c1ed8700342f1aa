"""The example of a driver of another package: installed, found, and calibrated with."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

from changing import with_daq
from forked import ended

from hdbench.profile import load_profile

ROOT = Path(__file__).parents[2]
DAQ = 'driver = "example-bridge"\naddress = "embedded"\nsample_period_s = 0.1\n'
# a short calibration: 1 position, 1 direction, 2 weights up and down
SHORT = {
    "positions = 4": "positions = 1",
    'directions = ["cw", "ccw"]': 'directions = ["cw"]',
    'ranges = ["low", "full"]': 'ranges = ["full"]',
    "full_masses_kg = [0.0, 2.0, 4.0, 6.0, 8.0]": "full_masses_kg = [0.0, 4.0, 8.0]",
    "average_s = 1.0": "average_s = 0.5",
}
# several command lines in one process: most of its time it imports
SCRIPT = """
import io, json, sys
from contextlib import redirect_stderr, redirect_stdout
from hdbench_cli.main import main
told = []
for words in json.load(sys.stdin):
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            main(words)
        except SystemExit as end:
            told.append((end.code, out.getvalue(), err.getvalue()))
print(json.dumps(told))
"""


def bench(daq):
    """Return the profile of a bench whose sensor is on the example's amplifier."""
    text = with_daq(daq, "seneca-z-sg")
    for old, new in SHORT.items():
        assert old in text
        text = text.replace(old, new)
    return text


def answered(folder):
    """Install the package beside hdbench; return what commands with it answer."""
    shutil.copytree(ROOT / "examples" / "driver", folder / "source")
    words = ["--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--target"]
    install = [sys.executable, "-m", "pip", "install", *words, folder / "site", folder / "source"]
    subprocess.run(install, check=True, timeout=120)
    (folder / "bench.toml").write_text(bench(DAQ))
    (folder / "wrong.toml").write_text(bench(f"{DAQ}baud = 9600\n"))
    own = ["--profile", "bench.toml"]
    commands = {
        "calibrate": [*own, "--yes", "--no-input", "--no-report", "--json"],
        "doctor": own,
        "run-ripple": [*own, "--yes"],
        "profile": ["check", "wrong.toml"],
    }
    places = [str(folder / "site"), *filter(None, sys.path)]
    done = ended(
        [sys.executable, "-c", SCRIPT],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(places)},
        input=json.dumps([[name, *words] for name, words in commands.items()]),
        cwd=folder,
    )
    assert done.returncode == 0, done.stderr
    return dict(zip(commands, json.loads(done.stdout), strict=True))


def test_an_installed_driver_calibrates_and_is_named_and_its_profile_is_held_against_it(tmp_path):
    told = answered(tmp_path)
    code, body, errors = told["calibrate"]
    assert code == 0, errors
    gain = json.loads(body)["gain_nm_per_v"]
    # the plant as modelled has the profile's gain, each clamping its own by 2 % (one sigma)
    expected = load_profile("seneca-z-sg").data.sensor.gain_nm_per_v
    assert abs(gain["value"] - expected) < 0.04 * expected
    assert gain["std"] > 0.0
    # doctor names the driver and its package, and reaches the device
    assert "example-bridge (hdbench-example-bridge 0.1.0)" in told["doctor"][1]
    assert "Example BR-1 sim-0" in told["doctor"][1]
    # a motion is refused from the profile alone
    code, _, errors = told["run-ripple"]
    assert code == 2
    assert "has no output in this profile" in errors
    # a wrong key of the driver's own table
    code, _, errors = told["profile"]
    assert code != 0
    assert "did you mean 'daq.baud_bd'?" in errors
    assert "wrong.toml:" in errors


def test_the_example_is_short():
    files = [*ROOT.glob("examples/driver/*/*.py"), ROOT / "examples/driver/pyproject.toml"]
    assert sum(len(file.read_text().splitlines()) for file in files) < 250
