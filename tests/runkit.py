"""Results and folders of runs as an earlier session left them, and a command line run in place."""

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner


def quantity(value: float, std: float, dof: float | None = None) -> dict[str, float | None]:
    return {"value": value, "std": std, "dof": dof}


def misalignment_result(
    amplitude: float, std: float = 0.01, phase: float = 0.3, **more: Any
) -> dict[str, Any]:
    """Return the keys of a misalignment that the contract names."""
    peak = {"peak_to_peak_nm": quantity(2.0 * amplitude, 2.0 * std, 3.0)}
    return {
        "amplitude_nm": quantity(amplitude, std, 3.0),
        **peak,
        "phase_rad": quantity(phase, 0.004 / amplitude, 1000.0),
        "before": peak,
        "after": {"peak_to_peak_nm": quantity(0.01, 0.005, 20.0)},
        "output_turns": 4.0,
        "mean_torque_nm": 0.0,
        "motor_velocity_rad_s": 60.0,
        "filter": {"order": 0.01},
        **more,
    }


def write_run(path: Path, kind: str, result: dict[str, Any] | None = None, **manifest: Any) -> Path:
    """Write the folder of a complete run; `manifest` holds the keys of run.json that matter."""
    path.mkdir(parents=True)
    body = {"schema": "hdbench/run/1", "run_id": path.name, "kind": kind, "status": "complete"}
    body |= {"files": {}, "profile": {"name": "p", "sha256": "0"}, "details": {}}
    (path / "run.json").write_text(json.dumps({**body, **manifest}))
    if result is not None:
        (path / "result.json").write_text(json.dumps({"schema": f"hdbench/{kind}/1", **result}))
    return path


def ran(*words: object, code: int = 0) -> str:
    """Run a command line in this process, for what a module makes once; return its stdout."""
    from hdbench_cli.main import main

    with CliRunner(env={"NO_COLOR": "1"}).isolation() as streams:
        with pytest.raises(SystemExit) as end:
            main([str(word) for word in words])
        assert end.value.code == code, streams[1].getvalue().decode()
        return streams[0].getvalue().decode()
