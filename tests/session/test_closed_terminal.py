"""A terminal that is closed while the motor turns: the run stops it and says SIGHUP, exit 129."""

import json
import os
import sys
import time

import pytest
from faults import kit
from nodekit import until
from terminal import Person

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="terminals of Linux")


def test_a_closed_terminal_ends_a_run_as_a_hangup_and_not_as_a_fault_of_the_disk(tmp_path):
    """What a closed terminal refuses to take is no error of the run."""
    profile, out = kit.short_profile(tmp_path), tmp_path / "runs"
    words = ["run-ripple", "--profile", str(profile), "--no-report", "--yes", "--out", str(out)]
    with kit.served(tmp_path, profile) as bench:
        person = Person([*words, "--address", bench.address])

        def turning() -> bool:
            person.look(0.05)
            events = bench.history()
            return bool(events) and abs(events[-1]["velocity_rad_s"]) > 5.0

        until(turning, 60.0)
        os.close(person.master)
        assert person.process.wait(60) == 129
        _, _, moving = bench.after(time.monotonic())
    assert moving == ""
    manifest = json.loads(next(out.glob("*/run.json")).read_text())
    assert manifest["status"] == "incomplete"
