"""An expired calibration ends a run before anything moves or is written."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hdbench.errors import DataError
from hdbench.profile import load_profile
from hdbench.session import BenchOptions, run_experiment


def test_a_run_with_an_expired_calibration_leaves_no_folder(tmp_path: Path) -> None:
    old = tmp_path / "old"
    old.mkdir()
    manifest = {"schema": "hdbench/run/1", "ended_utc": "2001-01-01T00:00:00Z"}
    (old / "run.json").write_text(json.dumps(manifest))
    gain = {"value": 6.6, "std": 0.08, "dof": 3.0}
    body = {"schema": "hdbench/calibration/1", "gain_nm_per_v": gain}
    (old / "result.json").write_text(json.dumps(body))
    options = BenchOptions(out=tmp_path / "runs", calibration=old)
    told: list[str] = []
    with pytest.raises(DataError, match="expired"):
        run_experiment(
            "ripple", load_profile("cim-tr-97-06"), options, lambda text, _share: told.append(text)
        )
    assert not (tmp_path / "runs").exists()
    assert told == []
