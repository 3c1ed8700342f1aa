"""An expired calibration is refused before anything moves or is written, unless it is allowed."""

import pytest
from runkit import write_run


@pytest.mark.parametrize("command", ["run-ripple", "run-misalignment"])
def test_even_a_dry_run_refuses_an_expired_calibration(command, tmp_path, hdbench):
    gain = {"gain_nm_per_v": {"value": 6.6, "std": 0.08, "dof": 3.0}}
    ended = "2001-01-01T00:00:00Z"
    old = write_run(tmp_path / "old", "calibration", gain, ended_utc=ended)
    words = (command, "--calibration", old, "--out", tmp_path / "runs", "--yes")
    for more in ((), ("--dry-run",)):
        assert "--allow-expired" in hdbench(*words, *more, code=4)[1]
    assert not (tmp_path / "runs").exists()
    assert "EXPIRED" in hdbench(*words, "--dry-run", "--allow-expired")[0]
