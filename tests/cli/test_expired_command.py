"""An expired calibration is refused before anything moves or is written, unless it is allowed."""

import json

import pytest


@pytest.mark.parametrize("command", ["run-ripple", "run-misalignment"])
def test_even_a_dry_run_refuses_an_expired_calibration(command, tmp_path, hdbench):
    old = tmp_path / "old"
    old.mkdir()
    manifest = {"schema": "hdbench/run/1", "ended_utc": "2001-01-01T00:00:00Z"}
    (old / "run.json").write_text(json.dumps(manifest))
    gain = {"value": 6.6, "std": 0.08, "dof": 3.0}
    body = {"schema": "hdbench/calibration/1", "gain_nm_per_v": gain}
    (old / "result.json").write_text(json.dumps(body))
    words = (command, "--calibration", old, "--out", tmp_path / "runs", "--yes")
    for more in ((), ("--dry-run",)):
        assert "--allow-expired" in hdbench(*words, *more, code=4)[1]
    assert not (tmp_path / "runs").exists()
    assert "EXPIRED" in hdbench(*words, "--dry-run", "--allow-expired")[0]
