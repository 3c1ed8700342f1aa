"""The command that is useful after one that has ended."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def next_line(command: str) -> str:
    """Return the line that tells the next command."""
    return f"next    {command}" if command else ""


def _words(command: str, options: Mapping[str, str | Path | None]) -> str:
    given = [f"{name} {shlex.quote(str(value))}" for name, value in options.items() if value]
    return " ".join([command, *given])


def after_run(
    kind: str,
    folder: Path,
    result: Mapping[str, Any],
    *,
    profile_name: str | None = None,
    calibration: Path | None = None,
) -> str:
    """Return what to do after an experiment."""
    bench: dict[str, str | Path | None] = {"--profile": profile_name}
    if kind == "calibration" and result.get("accepted") is not False:
        return _words("hdbench run-misalignment", {"--calibration": folder, **bench})
    if kind == "misalignment":
        scaled = {"--calibration": calibration, **bench}
        return _words("hdbench run-ripple", {"--misalignment": folder, **scaled})
    return f"hdbench diagnose {shlex.quote(str(folder))}"


def after_import(kind: str, out: Path, columns: tuple[str, ...], profile_name: str | None) -> str:
    """Return what to do with a file that was brought in; a drive not named has no profile."""
    file = shlex.quote(str(out))
    bench = {"--profile": profile_name}
    if kind == "loads":
        return _words(f"hdbench calibrate --from {file}", bench)
    if not {"motor_velocity_rad_s", "tacho_v"} & set(columns):
        return ""
    if profile_name is None:
        return f"hdbench profile new drive --from {file} --out drive.toml"
    return _words(f"hdbench diagnose {file}", bench)


def after_tune(model: Path) -> str:
    """Return what to do with a tuned model."""
    return f"hdbench response --model {shlex.quote(str(model))} --velocity 50"
