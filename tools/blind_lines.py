"""Files of one JSON object per line that may be cut short and go on later."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

__all__ = ["end_line", "read_lines"]


def read_lines(path: Path) -> list[dict[str, Any]]:
    """Return the whole lines of a file; one cut short by a stop is left out and asked again."""
    out = []
    if path.exists():
        for line in path.read_text().splitlines():
            try:
                out.append(json.loads(line))
            except json.JSONDecodeError:
                continue
    return out


def end_line(path: Path) -> None:
    """End a line that a kill cut short, so that the next one stands alone."""
    if path.exists() and path.stat().st_size and not path.read_bytes().endswith(b"\n"):
        with path.open("a") as file:
            file.write("\n")
