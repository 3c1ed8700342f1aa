"""An expired calibration is refused on the command line, unless that is asked for."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hdbench_cli.main import main


@pytest.mark.parametrize("command", ["run-ripple", "run-misalignment"])
def test_even_a_dry_run_refuses_an_expired_calibration(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    manifest = {"schema": "hdbench/run/1", "ended_utc": "2001-01-01T00:00:00Z"}
    (tmp_path / "run.json").write_text(json.dumps(manifest))
    gain = {"value": 6.6, "std": 0.08, "dof": 3.0}
    body = {"schema": "hdbench/calibration/1", "gain_nm_per_v": gain}
    (tmp_path / "result.json").write_text(json.dumps(body))
    words = [command, "--dry-run", "--calibration", str(tmp_path)]
    with pytest.raises(SystemExit) as end:
        main(words)
    assert end.value.code == 4
    assert "--allow-expired" in capsys.readouterr().err
    with pytest.raises(SystemExit) as end:
        main([*words, "--allow-expired"])
    assert end.value.code == 0
    assert "EXPIRED" in capsys.readouterr().out
