"""A terminal that is closed while the motor turns: the run stops it and says SIGHUP, exit 129."""

import json
import os
import select
import sys
import time
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from faults import kit

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="terminals of Linux")


def test_a_closed_terminal_ends_a_run_as_a_hangup_and_not_as_a_fault_of_the_disk(tmp_path):
    """What a closed terminal refuses to take is no error of the run."""
    import pty

    profile = kit.short_profile(tmp_path)
    out = tmp_path / "runs"
    words = ["run-ripple", "--profile", str(profile), "--no-report", "--yes", "--out", str(out)]
    with kit.served(tmp_path, profile) as bench:
        pid, terminal = pty.fork()
        if not pid:
            command = [sys.executable, "-m", "hdbench_cli", *words, "--address", bench.address]
            os.execv(sys.executable, command)
        until_s = time.monotonic() + 60.0
        turning = False
        while not turning and time.monotonic() < until_s:
            if select.select([terminal], (), (), 0.05)[0]:
                os.read(terminal, 4096)
            events = bench.history()
            turning = bool(events) and abs(events[-1]["velocity_rad_s"]) > 5.0
        os.close(terminal)
        _, status = os.waitpid(pid, 0)
        _, _, moving = bench.after(time.monotonic())
    assert turning
    assert os.waitstatus_to_exitcode(status) == 129
    assert moving == ""
    manifest = json.loads(next(out.glob("*/run.json")).read_text())
    assert manifest["status"] == "incomplete"
