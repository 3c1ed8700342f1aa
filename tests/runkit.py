"""Folders of runs as an earlier session left them."""

import json
from pathlib import Path
from typing import Any


def write_run(path: Path, kind: str, result: dict[str, Any] | None = None, **manifest: Any) -> Path:
    """Write the folder of a complete run; `manifest` holds the keys of run.json that matter."""
    path.mkdir(parents=True)
    body = {"schema": "hdbench/run/1", "run_id": path.name, "kind": kind, "status": "complete"}
    body |= {"files": {}, "profile": {"name": "p", "sha256": "0"}, "details": {}}
    (path / "run.json").write_text(json.dumps({**body, **manifest}))
    if result is not None:
        (path / "result.json").write_text(json.dumps({"schema": f"hdbench/{kind}/1", **result}))
    return path
