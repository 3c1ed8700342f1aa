"""Fixtures: what a test leaves behind fails it, a host that is held up does not."""

import os
import threading
import time
from pathlib import Path

import pytest

from hdbench.devices.host import control

# what ends by itself after a test, such as a server's last turn, s
_PATIENCE_S = 5.0
_DESCRIPTORS = Path("/proc/self/fd")
_WIRES = ("socket:", "pipe:", "anon_inode:", "/dev/pts/", "/dev/ptmx")


def _open() -> set[str]:
    """Return sockets, pipes and terminals that are open, and threads that run."""
    running = {f"thread {thread.name} ({thread.ident})" for thread in threading.enumerate()}
    for number in os.listdir(_DESCRIPTORS) if _DESCRIPTORS.exists() else ():
        try:
            target = os.readlink(_DESCRIPTORS / number)
        except OSError:
            continue
        if target.startswith(_WIRES):
            running.add(f"descriptor {number}: {target}")
    return running


@pytest.fixture
def patient_control(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a busy machine hold up the host that writes a reference; test_hosted has its limits."""
    monkeypatch.setattr(control, "_LATE_S", 5.0)
    monkeypatch.setattr(control, "_ABSENT_S", 5.0)


@pytest.fixture(autouse=True)
def nothing_stays_open():
    """Fail where a test leaves a connection or a thread to the next one, which may meet it."""
    before = _open()
    yield
    until_s = time.monotonic() + _PATIENCE_S
    while left := _open() - before:
        if time.monotonic() > until_s:
            pytest.fail(f"left behind: {', '.join(sorted(left))}")
        time.sleep(0.01)
