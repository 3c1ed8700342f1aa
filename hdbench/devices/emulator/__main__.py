"""The emulator of one session: its order on stdin, its address on stdout, one JSON line each."""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def main() -> int:
    """Serve the bench described on stdin until stdin ends."""
    # Ctrl-C may reach the whole process group; this process outlives it to stop the motor
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # nothing beyond the first line is read here: the end of what follows is the session's
    with open(0, "rb", buffering=0, closefd=False) as lines:
        order: dict[str, Any] = json.loads(lines.readline())

    from hdbench.devices.emulator.serving import EmulatorSettings, emulate
    from hdbench.errors import HdbenchError
    from hdbench.profile.loader import profile_from_json

    try:
        profile = profile_from_json(order["profile"])
        record = Path(order["record"]) if order["record"] else None
        settings = EmulatorSettings(
            pace=order["pace"], record=record, lifeline=0, wire=order["wire"]
        )
        emulate(profile, order["plant"], order["seed"], settings, ready=_say)
    except HdbenchError as error:
        _say({"error": error.to_dict()})
        return error.exit_code
    return 0


def _say(message: Mapping[str, object]) -> None:
    sys.stdout.write(json.dumps(dict(message)) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
